"""The table of regions of which cells have parts, from what each cell tells of its own."""

import numpy as np

from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits, pooled, region_planes
from sklearn_mcmd.segmentation._region_sums import Groups, median_by_region, region_sizes
from sklearn_mcmd.segmentation._region_table import (
    FIELDS,
    are_flat,
    enlarge_errors,
    flat_table,
    frame_of,
    outline_of,
    region_table,
)

NUMBERS = [field for field in FIELDS if field[0] != "outline"]
SAMPLE = 1_000  # points of a part, at most, that tell how the plane of a joined region bows
SUMS = [("distinct", "f8"), ("usual", "f8"), ("reach", "f8"), ("covariance", "f8", (3, 3))]


def parts_of_regions(segments, own):
    """What `joined_table` asks of a cell, of each of its regions: rows of a table with sums, and
    corners of outlines. `own` is bool (n,), which of the points of `Segments` the cell has."""
    n_regions = int(segments.labels.max(initial=-1)) + 1
    regions, labels = np.unique(np.append(segments.labels[own], -1), return_inverse=True)
    regions, labels, n = regions[1:], labels[:-1] - 1, len(regions) - 1  # of those with own points
    points, planes = segments.neighbor_index.points[own], segments.planes.take(np.flatnonzero(own))
    copies = None if segments.copies is None else segments.copies[own]
    moments, parts = region_planes(points, labels, n, copies), np.zeros(n_regions, SUMS + NUMBERS)
    table = region_table(points, labels, planes, moments)
    for name, _ in NUMBERS:
        parts[name][regions] = table[name]
    parts["covariance"][regions], parts["distinct"][regions] = moments[2], region_sizes(labels, n)
    for name, values in {"usual": planes.scale, "reach": planes.radius}.items():
        parts[name][regions] = median_by_region(values, labels, n)
    corners = [np.empty((0, 4))]
    for region, outline in zip(regions, table["outline"], strict=True):
        if not outline.endswith("EMPTY"):
            ring = outline[outline.index("((") + 2 : -2].split(", ")[:-1]
            ring = np.array([corner.split() for corner in ring], float)
            corners.append(np.column_stack([np.full(len(ring), region), ring]))
    samples = [np.empty((0, 4))]
    for region, rows in zip(regions, Groups.of(labels).split(), strict=True):
        rows = rows[:: -(-len(rows) // SAMPLE)]
        samples.append(np.column_stack([np.full(len(rows), region), points[rows]]))
    both = {"corners": corners, "samples": samples}
    return {"parts": parts} | {name: np.concatenate(values) for name, values in both.items()}


def joined_table(results, cells, starts, numbers):
    """The `regions_` of all cells, of whose regions ``numbers[starts[cell] + i]`` is the number, -1
    of those that are none."""
    parts = np.concatenate([results.read(cell, "parts") for cell in cells])
    kept = (numbers >= 0) & (parts["points"] > 0)
    parts, group = parts[kept], numbers[kept]
    n = int(group.max(initial=-1)) + 1
    if n == 0:
        return np.zeros(0, FIELDS)
    # Of each region, the largest part stands for it where no sum does.
    largest = np.lexsort((-parts["points"], group))
    largest = largest[np.searchsorted(group[largest], np.arange(n))]
    medians = np.column_stack([parts["usual"], parts["reach"]])
    sizes, centroids, covariances = (parts[name] for name in ("points", "centroid", "covariance"))
    planes, medians = pooled(sizes.astype(float), centroids, covariances, medians, group)
    sizes, centroids, covariances = planes
    values, axes = np.linalg.eigh(covariances)
    moments = sizes, centroids, covariances, np.maximum(values, 0.0), axes
    distinct = np.bincount(group, parts["distinct"], n)
    table, noise = flat_table(moments, distinct)
    flat = are_flat(moments, *medians.T)
    n_parts = np.bincount(group, minlength=n)
    rings, samples = (
        _points_of_regions(results, cells, starts, numbers, name, n)
        for name in ("corners", "samples")
    )
    for region, (row, ring) in enumerate(zip(table, rings, strict=True)):
        part = parts[largest[region]]
        if n_parts[region] == 1:
            for name, _ in NUMBERS:
                row[name] = part[name]
        else:
            _tell_joined(row, part, flat[region])
            local, each = samples[region] - row["centroid"], distinct[region] / len(samples[region])
            given = local @ axes[region][:, 1:], local @ row["normal"], noise[region]
            enlarge_errors(row, *given, each=each)
        local = (ring - row["centroid"]) @ frame_of(row["normal"]).T
        area, row["outline"] = outline_of(local, row["centroid"], row["normal"])
        row["area"] = part["area"] if n_parts[region] == 1 else area
    return table


def _points_of_regions(results, cells, starts, numbers, name, n):
    """The points (m, 3) of each of n joined regions that parts of these have under a name."""
    points = [results.read(cell, name) for cell in cells]
    region = np.concatenate(
        [
            numbers[start + some[:, 0].astype(np.int64)]
            for start, some in zip(starts, points, strict=False)
        ]
    )
    points = np.concatenate(points)[:, 1:]
    order = np.argsort(region, kind="stable")[np.count_nonzero(region < 0) :]
    counts = np.bincount(region[region >= 0], minlength=n)
    return np.split(points[order], np.cumsum(counts)[:-1])


def _tell_joined(row, part, is_flat):
    """Tell the kind of a region of several parts; a cylinder is that of the largest."""
    row["kind"] = "plane" if is_flat else "curved"
    if part["kind"] == "cylinder" and row["rms"] > JoinLimits().most_noise * part["rms"]:
        for name in ("kind", "rms", "radius", "axis", "axis_point"):
            row[name] = part[name]
