"""Groups of points: what they look like, and how far they stand off."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.runtime._chunks import slices

GROUPS_AT_ONCE = 4096  # whose axes are found at once, in 500 bytes each
LENGTH = np.sqrt(12)  # of a line, in standard deviations of points that lie evenly on it


class ShapeLimits(NamedTuple):
    """What a group looks like."""

    # A group is flat if its standard deviation along its longest axis is this many times the one
    # off its plane, and straight if it is this many times the one along the next axis.
    thin: float = 3.0
    # Pieces of one thing are no farther apart than this many times both lengths together, nor are
    # they in the geometric mean of that and of how far they are from what is real.
    apart: float = 5.0


class Shapes(NamedTuple):
    """What g groups look like: flat, straight, or else round."""

    flat: np.ndarray  # bool (g,)
    # bool (g,): the group and each of its halves, in the same direction, so that two clumps are not
    straight: np.ndarray
    length: np.ndarray  # (g,), along the longest axis, as if points lay evenly along it
    size: np.ndarray  # (g,), the standard deviation along that axis, or a straight group's length
    centers: np.ndarray  # (g, d)
    normals: np.ndarray  # (g, d), NaN of what is thin across, and may be in any plane
    thickness: np.ndarray  # (g,), the standard deviation off the plane

    @classmethod
    def of(cls, points, group):
        """Of points whose order is settled, since sums depend on it. `group` is from 0 on."""
        rounding = 8 * np.finfo(float).eps * np.abs(points).max(initial=0.0)
        order, parts = np.argsort(group, kind="stable"), []
        ends = np.append(0, np.cumsum(np.bincount(group)))
        for part in slices(max(len(ends) - 1, 1), GROUPS_AT_ONCE):
            rows = order[ends[part.start] : ends[min(part.stop, len(ends) - 1)]]
            parts.append(cls._of(points[rows], group[rows] - part.start, rounding))
        return cls(*map(np.concatenate, zip(*parts, strict=True)))

    @classmethod
    def _of(cls, points, group, rounding):
        counts, d = np.bincount(group), points.shape[1]
        centers, deviations, axes = _axes(points, group, counts)
        thickness = _with_error(deviations[:, 0], counts, d)
        straight, along = are_straight(deviations, counts), deviations[:, -1]
        normals = np.where(straight[:, None], np.nan, axes[:, :, 0])
        rows = np.flatnonzero(straight[group])
        if len(rows):
            of_row = group[rows]
            places = np.einsum("nd,nd->n", points[rows] - centers[of_row], axes[of_row, :, -1])
            lowest, highest = gaps_of_groups(of_row, places), -gaps_of_groups(of_row, -places)
            half = 2 * of_row + (places - lowest[of_row] > highest[of_row] - places)
            in_halves = np.bincount(half, minlength=2 * len(counts))
            _, halves, half_axes = _axes(points[rows], half, in_halves)
            long_axes = np.repeat(axes[..., -1], 2, axis=0)
            cosines = np.abs(np.einsum("hd,hd->h", half_axes[..., -1], long_axes))
            # By more than arctan(1 / thin), 18 degrees, as the diagonal of so thin a box is.
            turned = ShapeLimits().thin > np.hypot(1.0, ShapeLimits().thin) * cosines
            both = are_straight(halves, in_halves) & ~turned
            straight &= both.reshape(-1, 2).all(axis=1)
        return cls(
            flat=_are_thin(thickness, along, counts > d),
            straight=straight,
            length=LENGTH * along,
            size=np.where(straight, LENGTH * along, along),
            centers=centers,
            normals=normals,
            thickness=np.hypot(thickness, rounding),
        )

    def are_coplanar(self, a, b, points_of_a, points_of_b):
        """Whether groups a and b (m,) have one plane, which explains a point (m, d) of each."""
        cosines = np.abs(np.einsum("md,md->m", self.normals[a], self.normals[b]))
        alike = cosines >= np.cos(np.radians(SurfaceLimits().angle))
        return alike & self._explain(a, points_of_b) & self._explain(b, points_of_a)

    def _explain(self, groups, points):
        off = np.einsum("md,md->m", points - self.centers[groups], self.normals[groups])
        return np.abs(off) <= ExplainLimits().explained * self.thickness[groups]


def are_straight(deviations, counts):
    """Which of some points are straight, by their standard deviations along their axes (g, d)."""
    across = _with_error(deviations[:, -2], counts, 2)
    return _are_thin(across, deviations[:, -1], counts > 2)


def _with_error(deviations, counts, n_needed):
    """Standard deviations (g,) with their standard errors: they have as many degrees of freedom as
    points beyond those that a plane or a line needs. So few are thin by chance."""
    spare = np.maximum(counts - n_needed, 1)
    return deviations * np.sqrt(counts / spare) * (1 + 1 / np.sqrt(2 * spare))


def _are_thin(across, along, enough):
    return enough & (along > 0) & (ShapeLimits().thin * across <= along)


def _axes(points, group, counts):
    """Centers of groups, and their standard deviations along their axes, ascending, and these."""
    d, counts = points.shape[1], np.maximum(counts, 1)
    covariance = np.zeros((len(counts), d, d))
    means = [np.bincount(group, points[:, i], len(counts)) / counts for i in range(d)]
    centers = np.stack(means, axis=1)
    away = points - centers[group]
    for i in range(d):
        for j in range(i + 1):
            products = away[:, i] * away[:, j]
            covariance[:, i, j] = np.bincount(group, products, len(counts)) / counts
    values, axes = np.linalg.eigh(covariance)
    return centers, np.sqrt(np.maximum(values, 0.0)), axes


def gaps_of_groups(group, gaps):
    """The least of the gaps of the points of each group."""
    least = np.full(group.max(initial=-1) + 1, np.inf)
    np.minimum.at(least, group, gaps)
    return least


class Things(NamedTuple):
    """What is real beside the surfaces, and how sparse it is."""

    search: NearestPoints  # of its n points
    spacing: np.ndarray  # (n,), the mean distance to others off the surfaces

    def beside(self, queries, n_near, n_jobs):
        """Distances (m,) of queries from it, and the spacing that it has there, of so many."""
        if not self.search.n:
            return np.full(len(queries), np.inf), np.zeros(len(queries))
        gaps, near = self.search.query(queries, min(n_near, self.search.n), n_jobs)
        return gaps[:, 0], np.median(self.spacing[near], axis=1)


def separation_of_groups(points, group, usual, gaps, beside_things=None):
    """Gap of the group of each point (m,) over the size of the group, and whether it is straight.

    `usual` (m,) are the usual spacings around the points, and `gaps` (m,) those to the nearest
    that is real. From a thing, as `beside` tells, a group stands off by the spacing of that, if
    this is larger than its size. All points of the groups are given: they may have any number.
    """
    group = numbered(group)
    # Sums are taken in the order of coordinates, so they do not depend on that of the points.
    order = np.lexsort(points.T[::-1])
    of_ordered = group[order]
    shapes = Shapes.of(points[order], of_ordered)
    spacing = np.bincount(of_ordered, usual[order]) / np.bincount(of_ordered)
    size = np.maximum(spacing, shapes.size)[group]
    apart = ratio(gaps, size)
    if beside_things is not None:
        from_thing, spacing_there = beside_things
        apart = np.minimum(apart, ratio(from_thing, np.maximum(size, spacing_there)))
    return gaps_of_groups(group, apart)[group], shapes.straight[group]


def gaps_between_groups(points, group, n_jobs):
    """Distances (m,) of the points of groups, numbers from 1 on, to the nearest point that is of
    another group or of none, 0; inf if there is none, and of points of none."""
    gaps = np.full(len(points), np.inf)
    # The numbers of two groups differ in one bit at least, so one of the searches is of the other:
    # as many searches as the number of groups has bits, instead of one for each group.
    for bit in range(int(group.max(initial=0)).bit_length()):
        is_set = (group >> bit & 1).astype(bool)
        for asked, answering in ((is_set, ~is_set), (~is_set, is_set)):
            rows, search = np.flatnonzero(asked & (group > 0)), NearestPoints(points, answering)
            if len(rows) and search.n:
                gaps[rows] = np.minimum(gaps[rows], search.query(points[rows], 1, n_jobs)[0][:, 0])
    return gaps


def numbered(groups):
    """Groups as numbers from 0 on: int32."""
    return np.unique(groups, return_inverse=True)[1].astype(np.int32)
