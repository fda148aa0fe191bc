"""Narrow regions that are parts of one cylinder, such as strips of posts, trunks and bins."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._indexed_cloud import distinct_numbers
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._quadrics import n_terms, work_arrays
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.segmentation._graph import answers_of, by_place, n_within_median
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits
from sklearn_mcmd.segmentation._narrow_faces import NarrowFaceLimits
from sklearn_mcmd.segmentation._region_sums import n_regions_of, region_moments, sums_by_region

N_PARAMETERS = 5  # of a cylinder


class FitLimits(NamedTuple):
    """When a fit ends. They reach kernels as arguments, which would freeze imported constants."""

    n_steps: int = 8  # most steps from each start; from a good one two or three suffice
    least_gain: float = 1e-6  # share of the sum of squares that a step must gain
    # Keeps the equations of a flat strip, whose radius is infinite, from being singular.
    ridge: float = 1e-12


class CylinderLimits(NamedTuple):
    """When cylinders are fitted."""

    # A cylinder is fitted again, and pairs are tried again, when a region has grown by this factor.
    # All fits together then take only about as long as the last one or two.
    growth: float = 2.0
    least_size: int = 10  # twice the parameters of a cylinder: with fewer points any one fits


class Cylinder(NamedTuple):
    """A circular cylinder without ends."""

    point: np.ndarray  # of the axis
    axis: np.ndarray  # unit vector
    radius: float

    def distances(self, points):
        """Signed distances of points (n, 3) from the surface, positive outside."""
        # Each by itself, whereas a product of matrices depends on where in them a point is.
        gaps = [points[:, i] - self.point[i] for i in range(3)]
        along = gaps[0] * self.axis[0] + gaps[1] * self.axis[1] + gaps[2] * self.axis[2]
        x, y, z = (gap - along * step for gap, step in zip(gaps, self.axis, strict=True))
        return np.sqrt(x * x + y * y + z * z) - self.radius


def fit_cylinder(points, normals):
    """Fit a cylinder to points by least squares of their distances (Gauss-Newton).

    The search for the axis starts from three directions. The longest extent of the points is right
    for a pole, and the second extent for a wide strip of a column. The direction most nearly
    perpendicular to all normals, of either sign, is right for pieces as high as wide; where all are
    equal, as of points that borrowed one plane, it is any. Points of an
    exact plane have no best cylinder and get a poor one: compare it with their plane. There must be
    at least six points. Returns the sum of squares and the `Cylinder`.
    """
    center = points.mean(axis=0)
    local = points - center
    scale = np.sqrt(np.square(local).sum() / len(local))
    if not scale > 0:
        return 0.0, Cylinder(center, np.array([0.0, 0.0, 1.0]), 0.0)
    local /= scale
    extents = np.linalg.eigh(local.T @ local)[1]
    across, turns = np.linalg.eigh(normals.T @ normals)
    axes = [extents[:, 2], extents[:, 1], turns[:, 0]]
    limits = FitLimits()
    starts = np.stack(axes if across[1] > limits.ridge * len(points) else axes[:2])
    fit = compiled_function("segmentation._regions_numba", "fit_cylinder")
    (new,), equations = work_arrays(1, n_terms(3))
    model, equations = np.zeros(7), (*equations, new)
    total = fit(local, starts, limits, equations, model)
    return total * scale**2, Cylinder(center + scale * model[:3], model[3:6], scale * model[6])


@dataclass
class _Part:
    """A narrow region, or several joined.

    It is curved if two conditions hold. Its plane leaves more than `most_noise` times the root mean
    square that its cylinder leaves. And three times the latter, on both sides, fits into the
    neighborhoods' radius: this distinguishes a surface from a volume, such as foliage.
    """

    rows: np.ndarray  # of its points, in an order that depends on nothing but their places
    floor: float  # mean square below which deviations are rounding
    ceiling: float  # mean square above which they are those of a volume
    plane: float  # mean square about the plane, by degrees of freedom,
    curve: float  # and about the cylinder: infinite where there are too few points,
    cylinder: Cylinder  # which have any

    @property
    def size(self):
        return len(self.rows)

    @property
    def curved(self):
        left = max(self.curve, self.floor)
        return left <= self.ceiling and self.plane > JoinLimits().most_noise ** 2 * left

    def shares(self, points):
        """Distances of points from the cylinder, as shares of the largest of its own."""
        limit = ExplainLimits().explained * np.sqrt(max(self.curve, self.floor))
        return np.abs(self.cylinder.distances(points)) / limit


@dataclass(frozen=True)
class CylinderParts:
    """Joins narrow regions that touch if one cylinder explains them.

    Two parts are joined if two conditions hold. One cylinder leaves less of both than two planes
    do, with fewer parameters. And of each part it leaves at most `most_noise` times what the best
    model of that part alone leaves: so the noise is measured on the parts themselves.
    """

    index: NeighborIndex  # of points in three dimensions
    planes: Planes
    floor: np.ndarray  # (n,), the least standard deviation of a plane: what rounding amounts to
    max_gap: float  # largest distance of points that touch, which also are near neighbors
    n_jobs: int | None

    def grow(self, labels):
        """Labels (n,), changed, -1 for none, in which parts of one cylinder share their smallest
        label, and the labels of those that are curved.

        Curved regions also take in points without region on their cylinders, and are joined if they
        then touch. The planes of a post's points run off it, onto the ground or into a tree's
        foliage; the cylinder does not.
        """
        parts = self._narrow_parts(labels)
        fresh, tried = set(parts), dict[tuple, tuple]()
        while fresh:
            fresh |= self._join(labels, parts, fresh, tried)
            fresh = self._claim(labels, parts, fresh & set(parts))
        return labels, sorted(name for name in parts if parts[name].curved)

    def _narrow_parts(self, labels):
        """The parts that may be joined, by label."""
        n_regions, points = n_regions_of(labels), self.index.points
        moments = region_moments(points, labels, n_regions)
        reach = sums_by_region(self.planes.radius, labels, n_regions)
        reach /= np.maximum(moments.sizes, 1)
        values = np.maximum(np.linalg.eigvalsh(moments.covariances), 0.0)
        # Those wider than a disk that reaches as far as a strip's points have good normals, and
        # growth follows them. Points spread evenly over a width deviate by its root 12th.
        wide = np.sqrt(12 * values[:, 1]) > 2 * NarrowFaceLimits().reach * reach
        rows = np.flatnonzero(np.append(~wide & (moments.sizes >= 4), False)[labels])
        rows = by_place(points, rows)
        rows = rows[np.argsort(labels[rows], kind="stable")]
        names, starts = np.unique(labels[rows], return_index=True)
        groups = np.split(rows, starts[1:]) if len(rows) else []
        parts = answers_of(self._part, groups, self.n_jobs)
        return dict(zip(names.tolist(), parts, strict=True))

    def _around(self, rows):
        """The nearer half of the neighbors of rows; a row replaces neighbors beyond the gap."""
        k = n_within_median(self.index.n_neighbors) + 1
        around = self.index.query_own(rows, k).indices
        if self.max_gap == np.inf:
            return around
        gaps = self.index.points[around] - self.index.points[rows][:, None]
        near = np.sqrt(np.square(gaps).sum(axis=-1)) <= self.max_gap  # as links are
        return np.where(near, around, rows[:, None]).astype(np.int32)

    def _part(self, rows):
        """The `_Part` that some rows are."""
        points, n = self.index.points[rows], len(rows)
        deviations = points - points.mean(axis=0)
        plane = max(np.linalg.eigvalsh(deviations.T @ deviations)[0], 0.0) / (n - 3)
        curve, cylinder = np.inf, Cylinder(points[0], np.array([0.0, 0.0, 1.0]), 0.0)
        if n >= CylinderLimits().least_size:
            curve, cylinder = fit_cylinder(points, self.planes.normals[rows])
            curve /= n - N_PARAMETERS
        reach = self.planes.radius[rows].mean()
        return _Part(
            rows=rows,
            floor=self.floor[rows].max() ** 2,
            # Three deviations on both sides are as long as the radius.
            ceiling=(reach / (2 * ExplainLimits().explained)) ** 2,
            plane=plane,
            curve=curve,
            cylinder=cylinder,
        )

    def _join(self, labels, parts, fresh, tried):
        """Join `parts`, in place, until no more can be joined; the names of changed ones."""
        changed = set()
        while True:  # each round joins at least two parts
            pairs = []
            for pair in self._touching(labels, parts, fresh):
                key = tuple(parts[name].size for name in pair)  # parts only gain points
                if tried.get(pair) != key:
                    tried[pair] = key
                    pairs.append(pair)
            are_one = answers_of(
                lambda pair: self._are_one(parts[pair[0]], parts[pair[1]]), pairs, self.n_jobs
            )
            pairs = [pair for pair, is_one in zip(pairs, are_one, strict=True) if is_one]
            if not pairs:
                break
            fresh = self._pool(labels, parts, np.array(pairs))
            changed |= fresh
        return changed

    def _touching(self, labels, parts, fresh):
        """Pairs of a fresh part and another part in which it has a neighbor, in order."""
        names = sorted(fresh & set(parts))
        if not names:
            return []
        rows = np.concatenate([parts[name].rows for name in names])
        name_of_row = np.repeat(names, [parts[name].size for name in names])
        around = labels[self._around(rows)]
        row, column = np.nonzero((around != name_of_row[:, None]) & (around >= 0))
        first, second = name_of_row[row].astype(np.int64), around[row, column].astype(np.int64)
        # Pairs are sorted as single numbers, which is much faster than as rows.
        pairs = distinct_numbers(np.minimum(first, second) << 32 | np.maximum(first, second))
        pairs = zip((pairs >> 32).tolist(), (pairs & (2**32 - 1)).tolist(), strict=True)
        return [(a, b) for a, b in pairs if a in parts and b in parts]

    def _are_one(self, first, second):
        """Whether one cylinder explains two parts as well as two planes do, and each of them."""
        n, limits = first.size + second.size, CylinderLimits()
        if n < limits.least_size:
            return False
        small, large = sorted((first, second), key=lambda part: part.size)
        if large.curved and large.size >= limits.growth * small.size:
            # A small part hardly moves the cylinder of a large one. If most of it lies off that
            # cylinder, no fit is needed. This saves a fit of the large part for each neighbor.
            near = large.shares(self.index.points[small.rows]) <= 1
            if 2 * np.count_nonzero(near) <= len(near):
                return False
        floor, ceiling = max(first.floor, second.floor), max(first.ceiling, second.ceiling)
        rows = np.concatenate([first.rows, second.rows])
        total, cylinder = fit_cylinder(self.index.points[rows], self.planes.normals[rows])
        # Both variances by degrees of freedom: two planes have 3 numbers each.
        apart = sum(part.plane * (part.size - 3) for part in (first, second)) / (n - 6)
        if not total / (n - N_PARAMETERS) <= min(max(apart, floor), ceiling):
            return False
        for part in (first, second):
            left = np.square(cylinder.distances(self.index.points[part.rows])).mean()
            if left > JoinLimits().most_noise ** 2 * max(min(part.plane, part.curve), floor):
                return False
        return True

    def _pool(self, labels, parts, pairs):
        """Join the parts of `pairs`, also along chains of pairs; the names of the joined ones."""
        names, ends = np.unique(pairs, return_inverse=True)
        ends = ends.reshape(-1, 2)
        graph = coo_array((np.ones(len(ends)), ends.T), shape=(len(names), len(names)))
        _, chain = connected_components(graph, directed=False)
        pooled = set()
        for number in range(chain.max() + 1):
            group = [parts.pop(name) for name in names[chain == number].tolist()]
            rows = np.concatenate([part.rows for part in group])
            name = int(names[chain == number][0])
            labels[rows] = name
            parts[name] = self._part(rows)
            pooled.add(name)
        return pooled

    def _claim(self, labels, parts, fresh):
        """Give points without region to the cylinder that they touch and lie on best: the names of
        the parts that grew. Claimed points lead to others, until a part has grown enough."""
        curved = [name for name in sorted(fresh) if parts[name].curved]
        edges = {name: distinct_numbers(self._around(parts[name].rows)) for name in curved}
        gained: dict[int, list] = {name: [] for name in edges}
        while edges:
            claimed, owner = self._claims_of(labels, parts, edges)
            labels[claimed] = owner
            edges = {}
            for name in np.unique(owner).tolist():
                rows = by_place(self.index.points, claimed[owner == name])
                gained[name].append(rows)
                if sum(map(len, gained[name])) < (CylinderLimits().growth - 1) * parts[name].size:
                    edges[name] = distinct_numbers(self._around(rows))
        grown = [name for name, rows in gained.items() if rows]

        def fit(name):
            return self._part(np.concatenate([parts[name].rows, *gained[name]]))

        parts.update(zip(grown, answers_of(fit, grown, self.n_jobs), strict=True))
        return set(grown)

    def _claims_of(self, labels, parts, edges):
        """Rows without region among `edges`, name -> rows in order, and the part that each lies on
        best."""
        claims = [(np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0))]
        free = distinct_numbers(np.concatenate(list(edges.values())))
        free = free[labels[free] < 0]
        points = self.index.points[free]
        for name, touching in edges.items():
            at = np.searchsorted(free, touching)
            at = at[np.append(free, -1)[at] == touching]  # those that are free
            share = parts[name].shares(points[at])
            rows = free[at[share <= 1]]
            claims.append((rows, np.full(len(rows), name), share[share <= 1]))
        rows, names, shares = map(np.concatenate, zip(*claims, strict=True))
        order = np.lexsort((names, shares, rows))
        first = order[np.flatnonzero(np.diff(rows[order], prepend=-1))]
        return rows[first], names[first]
