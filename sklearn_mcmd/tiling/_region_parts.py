"""The table of regions of which cells have parts, from what each cell tells of its own."""

import numpy as np

from sklearn_mcmd.segmentation._merge_coplanar import pooled, region_planes
from sklearn_mcmd.segmentation._region_sums import median_by_region, region_sizes
from sklearn_mcmd.segmentation._region_table import (
    FIELDS,
    are_flat,
    flat_table,
    frame_of,
    outline_of,
    region_table,
)

NUMBERS = [field for field in FIELDS if field[0] != "outline"]
SUMS = [("distinct", "f8"), ("usual", "f8"), ("reach", "f8"), ("covariance", "f8", (3, 3))]


def parts_of_regions(segments, own):
    """What `joined_table` asks of a cell, of each of its regions: rows of a table with sums, and
    corners of outlines. `own` is bool (n,), which of the points of `Segments` the cell has."""
    n_regions = int(segments.labels.max(initial=-1)) + 1
    regions, labels = np.unique(np.append(segments.labels[own], -1), return_inverse=True)
    regions, labels, n = regions[1:], labels[:-1] - 1, len(regions) - 1  # of those with own points
    points, planes = segments.index.points[own], segments.planes.take(np.flatnonzero(own))
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
    return {"parts": parts, "corners": np.concatenate(corners)}


def joined_table(results, cells, starts, numbers):
    """The `regions_` of all cells, of whose regions ``numbers[starts[cell] + i]`` is the number, -1
    of those that are none."""
    parts = np.concatenate([results.read(cell, "parts") for cell in cells])
    corners = [results.read(cell, "corners") for cell in cells]
    for start, some in zip(starts, corners, strict=False):
        some[:, 0] += start
    corners = np.concatenate(corners)
    kept = (numbers >= 0) & (parts["points"] > 0)
    corners = corners[kept[corners[:, 0].astype(int)]]
    region_of_corner = numbers[corners[:, 0].astype(int)]
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
    table, _ = flat_table(moments, distinct)
    flat = are_flat(moments, *medians.T)
    n_parts = np.bincount(group, minlength=n)
    order = np.argsort(region_of_corner, kind="stable")
    rings = np.split(corners[order, 1:], np.cumsum(np.bincount(region_of_corner, minlength=n))[:-1])
    for region, (row, ring) in enumerate(zip(table, rings, strict=True)):
        part = parts[largest[region]]
        if n_parts[region] == 1:
            for name, _ in NUMBERS:
                row[name] = part[name]
        else:
            _tell_joined(row, part, flat[region])
        local = (ring - row["centroid"]) @ frame_of(row["normal"]).T
        area, row["outline"] = outline_of(local, row["centroid"], row["normal"])
        row["area"] = part["area"] if n_parts[region] == 1 else area
    return table


def _tell_joined(row, part, is_flat):
    """Tell of a region of several parts what its sums do not: its kind, and how much larger its
    errors are than those of even noise, as its largest part has it."""
    row["kind"] = "plane" if is_flat else "curved"
    if not is_flat and part["kind"] == "cylinder":
        for name in ("kind", "rms", "radius", "axis", "axis_point"):
            row[name] = part[name]
    alone = part["rms"] / np.sqrt(max(part["distinct"], 1.0))
    effect = max(1.0, part["height_error"] / alone) if alone > 0 else 1.0
    row["height_error"] *= effect
    row["normal_error"] = min(effect * row["normal_error"], 90.0)
