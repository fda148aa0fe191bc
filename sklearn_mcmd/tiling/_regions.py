"""Regions of clouds larger than memory: cells find their own, and share points with others."""

from functools import partial
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.io._region_files import SUFFIXES, write_regions
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.normals._sides import TreeLimits
from sklearn_mcmd.planes._indexed_cloud import distinct_numbers
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.segmentation._estimator import RegionGrowing, numbers_by_size
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits, RegionPlanes, pooled
from sklearn_mcmd.segmentation._region_sums import (
    Groups,
    Moments,
    median_by_region,
    region_moments,
    region_sizes,
)
from sklearn_mcmd.segmentation._region_table import (
    FIELDS,
    Rounded,
    are_flat,
    enlarge_errors,
    flat_table,
    frame_of,
    outline_of,
    region_table,
)
from sklearn_mcmd.tiling._base import (
    AT_ONCE,
    TiledVerb,
    hops_of,
    in_halo,
    overlaps,
    warm_up,
    without_sides,
)
from sklearn_mcmd.tiling._halo import HOPS_MORE, WIDTH

LEAST_SHARED = 10  # points that regions of two cells share at least, if they are one,
LEAST_SHARE = 0.7  # and this share of the smaller one's points in the overlap
LEAST_SEEN = 0.25  # share of a region that another cell sees, if it is to join what touches there
LARGEST = 20  # regions whose points are counted in the report
NUMBERS = [field for field in FIELDS if field[0] != "outline"]
SAMPLE = 1_000  # points of a part, at most, that tell how the plane of a joined region bows
SUMS = [("distinct", "f8"), ("usual", "f8"), ("reach", "f8"), ("covariance", "f8", (3, 3))]


class TiledRegions(TiledVerb):
    """Regions of cells, joined where they share points."""

    names = ("final",)

    def __init__(self, estimator, colors, regions):
        if estimator.normal_estimator is None:
            normals = RobustNormalEstimator(random_state=estimator.random_state, n_jobs=1)
            estimator.set_params(normal_estimator=normals)
        self.normals = without_sides(estimator.normal_estimator)
        super().__init__(estimator, self.normals)
        self.colors, self.table = colors, regions and Path(regions)
        if self.table and self.table.suffix.lower() not in SUFFIXES:
            raise ValueError(f"regions={str(regions)!r} must end in {', '.join(SUFFIXES)}.")
        self.others = [self.table] if self.table else []

    def prepare(self, catalog):
        warm_up(self.estimator)

    def find(self, run):
        keep = partial(keep_regions, with_table=bool(self.table))
        growing = PartGrowing(**self.estimator.get_params(deep=False))
        asked = {"hops": hops_of(self.normals) + HOPS_MORE, "width": WIDTH}
        run.do(self.task, estimator=growing, keep=keep, **asked)
        counts = [report["n_regions"] for report in run.reports(self.task)]
        starts, parts = np.cumsum([0, *counts]), zip(run.found("results"), counts, strict=True)
        own = (np.bincount(labels[labels >= 0], minlength=n) for labels, n in parts)
        sizes = np.concatenate([np.empty(0), *own])
        group = join_regions(run, starts, sizes)
        totals = np.bincount(group, sizes)
        number = numbers_by_size(totals, self.estimator.min_region_size)
        numbers = number[np.append(group, -1)]
        for cell, labels in enumerate(run.found("results")):
            final = numbers[np.where(labels < 0, -1, starts[cell] + labels)]
            run.results.keep(cell, "final", {"final": final})
        if self.table:
            place = run.outputs[0][0].with_name(f"regions{self.table.suffix.lower()}")
            write_regions(place, joined_table(run, starts, numbers[:-1]))
            run.others.append((place, self.table))
        kept = np.sort(totals[number[:-1] >= 0])[::-1].astype(int).tolist()
        self.found = {"n_regions": len(kept), "n_inside": sum(kept), "largest": kept[:LARGEST]}

    def make(self, cloud, values, xyz):
        from sklearn_mcmd.plotting._still import with_regions

        return with_regions(cloud, values[:, 0], self.colors), None

    def report(self, run, total):
        return {"removed_fraction": 0.0, **self.found}


class PartGrowing(RegionGrowing):
    """Keeps the `Segments` of a part of a cloud, and tells nothing else."""

    def fit(self, X, y=None):
        self.segments_ = self._segment(X)
        return self


def keep_regions(job, cell, part, fitted, cloud, with_table):
    """As `Job.keep`."""
    segments = fitted.segments_
    labels = segments.labels[segments.neighbor_index.places].astype(np.int32)
    found = {"results": labels[part.own, None], "n_regions": int(labels.max(initial=-1)) + 1}
    found["halo"], found["touching"] = in_halo(part, labels), touching_regions(cloud, labels)
    found["seen"] = np.bincount(labels[labels >= 0], minlength=found["n_regions"])
    if with_table:
        found |= parts_of_regions(segments, part.own[segments.neighbor_index.rows])
    return found


def join_regions(run, starts, sizes):
    """The joined region of each region of each cell, from 0 on: those that are one share points.

    ``starts[cell]`` is the number of its first region; `sizes` (n,) are the own points of all, and
    a region without any joins none.
    """
    n, pairs_of, counts_of = len(sizes), [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for cell, home, _, at, labels in overlaps(run):
        theirs = run.results.mapped(home, "results")[at, 0].astype(np.int64)
        both = np.stack([starts[cell] + labels, starts[home] + theirs])
        one, other = np.sort(both[:, (labels >= 0) & (theirs >= 0)], axis=0)
        new, counts = np.unique(one * n + other, return_counts=True)
        pairs_of.append(new)
        counts_of.append(counts)
    codes, of = np.unique(np.concatenate(pairs_of), return_inverse=True)
    shared = np.bincount(of, np.concatenate(counts_of), len(codes))
    pairs = np.stack(np.divmod(codes, max(n, 1)))
    # In the overlap of the cells of a pair, the points of the smaller one.
    cells = np.searchsorted(starts, pairs, side="right")
    asked = (np.unique(key, return_inverse=True)[1] for key in pairs * len(starts) + cells[::-1])
    least = np.minimum(*(np.bincount(of, shared)[of] for of in asked))
    kept = (shared >= LEAST_SHARED) & (shared > LEAST_SHARE * least)
    kept &= (sizes[pairs] > 0).all(axis=0)
    pairs = pairs[:, kept & ~_are_hardly_seen(run, starts, pairs, cells, shared * kept)]
    graph = coo_array((np.ones(pairs.shape[1], bool), pairs), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def _are_hardly_seen(run, starts, pairs, cells, shared):
    """Which pairs of regions, which share so many points, are not one. The cell of the one has
    another that touches it and shares more with the other, whose cell sees little of the one."""
    n, are = int(starts[-1]), np.zeros(len(shared), bool)
    seen, beside = np.concatenate(list(run.found("seen"))), [np.empty((0, 2), np.int64)]
    beside += [start + both for start, both in zip(starts, run.found("touching"), strict=False)]
    touching = np.concatenate(beside) @ [n, 1]
    for one, other in (0, 1), (1, 0):
        order = np.lexsort((-shared, cells[one], pairs[other]))
        name, group = pairs[one, order], pairs[other, order] * len(starts) + cells[one, order]
        little = shared[order] < LEAST_SEEN * seen[name]
        for lag in range(1, len(order)):
            alike = group[lag:] == group[:-lag]  # the stronger ones before it
            if not alike.any():
                break
            codes = np.sort(np.stack([name[lag:], name[:-lag]]), axis=0).T @ [n, 1]
            are[order[lag:][little[lag:] & alike & np.isin(codes, touching)]] = True
    return are


def touching_regions(cloud, labels):
    """Pairs (m, 2) of labels of neighbors, the smaller first; -1 is no label."""
    of, codes = np.full(len(cloud.points), -1, np.int64), [np.empty(0, np.int64)]
    of[cloud.places] = labels
    k, n = min(TreeLimits().n_neighbors, len(of)), int(labels.max(initial=-1)) + 1
    for rows in slices(len(of), AT_ONCE):
        near = of[cloud.neighbors(rows, k, 0)]
        less, more = np.minimum(near[:, :1], near), np.maximum(near[:, :1], near)
        codes.append(distinct_numbers((less * n + more)[(less >= 0) & (less < more)]))
    return np.stack(np.divmod(distinct_numbers(np.concatenate(codes)), max(n, 1)), axis=1)


def parts_of_regions(segments, own):
    """What `joined_table` asks of a cell, of each of its regions: rows of a table with sums, and
    corners of outlines. `own` is bool (n,), which of the points of `Segments` the cell has."""
    n_regions = int(segments.labels.max(initial=-1)) + 1
    regions, labels = np.unique(np.append(segments.labels[own], -1), return_inverse=True)
    regions, labels, n = regions[1:], labels[:-1] - 1, len(regions) - 1  # of those with own points
    points, planes = segments.neighbor_index.points[own], segments.planes.take(np.flatnonzero(own))
    copies = None if segments.copies is None else segments.copies[own]
    region_planes = RegionPlanes.of(region_moments(points, labels, n, copies))
    table = region_table(points, labels, planes, region_planes, segments.step)
    parts = np.zeros(n_regions, SUMS + NUMBERS)
    for name, _ in NUMBERS:
        parts[name][regions] = table[name]
    parts["covariance"][regions] = region_planes.covariances
    parts["distinct"][regions] = region_sizes(labels, n)
    for name, values in {"usual": planes.scale, "reach": planes.radius}.items():
        parts[name][regions] = median_by_region(values, labels, n)
    corners, samples = [np.empty((0, 4))], [np.empty((0, 4))]
    for region, rows, outline in zip(
        regions, Groups.of(labels).split(), table["outline"], strict=True
    ):
        ring = outline.partition("((")[2].rstrip(")").replace(",", " ").split()
        some = points[rows[:: -(-len(rows) // SAMPLE)]]
        for found, xyz in (corners, np.array(ring, float).reshape(-1, 3)[:-1]), (samples, some):
            found.append(np.column_stack([np.full(len(xyz), region), xyz]))
    return {
        "parts": parts,
        "corners": np.concatenate(corners),
        "samples": np.concatenate(samples),
    }


def joined_table(run, starts, numbers):
    """The `regions_` of all cells, of whose regions ``numbers[starts[cell] + i]`` is the number, -1
    of those that are none."""
    parts = np.concatenate(list(run.found("parts")))
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
    own = Moments(sizes.astype(float), centroids, covariances)
    moments, medians = pooled(own, medians, group)
    planes = RegionPlanes.of(moments)
    distinct = np.bincount(group, parts["distinct"], n)
    step = run.constants["steps"][0]
    table, noise = flat_table(planes, distinct, step)
    flat = are_flat(planes, *medians.T)
    n_parts = np.bincount(group, minlength=n)
    rings, samples = (
        _points_of_regions(run, starts, numbers, name, n) for name in ("corners", "samples")
    )
    for region, (row, ring) in enumerate(zip(table, rings, strict=True)):
        part = parts[largest[region]]
        if n_parts[region] == 1:
            for name, _ in NUMBERS:
                row[name] = part[name]
        else:
            _tell_joined(row, part, flat[region])
            local, each = samples[region] - row["centroid"], distinct[region] / len(samples[region])
            rounded = Rounded(step, planes.covariances[region])
            enlarge_errors(row, local, planes.axes[region], noise[region], rounded, each)
        local = (ring - row["centroid"]) @ frame_of(row["normal"]).T
        area, row["outline"] = outline_of(local, row["centroid"], row["normal"])
        row["area"] = part["area"] if n_parts[region] == 1 else area
    return table


def _points_of_regions(run, starts, numbers, name, n):
    """The points (m, 3) of each of n joined regions that parts of these have under a name."""
    parts = [
        (numbers[start + some[:, 0].astype(np.int64)], some[:, 1:])
        for start, some in zip(starts, run.found(name), strict=False)
    ]
    region, points = map(np.concatenate, zip(*parts, strict=True))
    order = np.argsort(region, kind="stable")[np.count_nonzero(region < 0) :]
    counts = np.bincount(region[region >= 0], minlength=n)
    return np.split(points[order], np.cumsum(counts)[:-1])


def _tell_joined(row, part, is_flat):
    """Tell the kind of a region of several parts; a cylinder is that of the largest."""
    row["kind"] = "plane" if is_flat else "curved"
    if part["kind"] == "cylinder" and row["rms"] > JoinLimits().most_noise * part["rms"]:
        for name in ("kind", "rms", "radius", "axis", "axis_point"):
            row[name] = part[name]
