"""Heights over the ground, where points have the class ground."""

from numbers import Real
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd.io._classes import GROUND, classes_of, ground_in
from sklearn_mcmd.io._point_cloud import PointFileError

__all__ = [
    "CORNERS",
    "NONE_JUDGED",
    "Ground",
    "HeightLimits",
    "check_ground",
    "depths_of_groups",
    "ground_of",
    "group_depths",
    "heights_over_ground",
]

CORNERS = 3  # of a triangle of ground points, as of the ground's triangulation
# Nearest points that a point of a group may be linked to, as in surfaces. With fewer a group may
# fall apart, and its parts are smaller than it.
LINKED = 16
AT_ONCE = 100_000  # points whose nearest are asked for at once
NONE_JUDGED = "no points are judged: all are withheld, of other classes, or at other heights"


class HeightLimits(NamedTuple):
    """Which points are judged by their height over the ground, and whether groups below it are."""

    above: float | None = None
    below: float | None = None
    low_groups: bool = False

    @classmethod
    def of(cls, above, below, low_groups):
        """The limits, None if no heights are asked for; raises for what is no height."""
        for name, value in {"above": above, "below": below}.items():
            if value is not None and not (isinstance(value, Real) and np.isfinite(value)):
                raise ValueError(f"{name}={value!r} must be a finite number, or None.")
        above, below = (None if value is None else float(value) for value in (above, below))
        limits = cls(above, below, bool(low_groups))
        return None if limits == cls() else limits

    def judged(self, heights):
        """Which points are judged."""
        judged = np.ones(len(heights), bool)
        if self.above is not None:
            judged &= heights > self.above
        if self.below is not None:
            judged &= heights < self.below
        return judged


class Ground:
    """Points of the ground, of which those nearest in plan can be asked for.

    Where there are fewer than three, the others are infinitely far and high.
    """

    def __init__(self, xyz):
        xyz = xyz[np.lexsort(xyz.T[::-1])]
        # Of those at one place in plan only the lowest can be among the nearest.
        kept = np.ones(len(xyz), bool)
        kept[CORNERS:] = (xyz[CORNERS:, :2] != xyz[:-CORNERS, :2]).any(axis=1)
        self._heights = np.append(xyz[kept, 2], np.inf)
        self._tree = cKDTree(xyz[kept, :2], balanced_tree=False)

    def nearest(self, xyz):
        """Distances in plan (m, 3) of the nearest ground points, and their heights.

        Of equally distant ones the lowest come first, whatever the order of the ground is.
        """
        distances, heights = np.empty((len(xyz), CORNERS)), np.empty((len(xyz), CORNERS))
        for first in range(0, len(xyz), AT_ONCE):
            some = slice(first, first + AT_ONCE)
            distances[some], heights[some] = self._nearest(xyz[some, :2])
        return distances, heights

    def _nearest(self, plan):
        distances, heights = np.empty((len(plan), CORNERS)), np.empty((len(plan), CORNERS))
        n, k, rows = self._tree.n, CORNERS + 1, np.arange(len(plan))
        while len(rows):
            away, near = self._tree.query(plan[rows], np.arange(1, max(CORNERS, min(k, n)) + 1))
            there = self._heights[near]
            ties = np.flatnonzero((away[:, 1:] == away[:, :-1]).any(axis=1))
            order = np.lexsort((there[ties], away[ties]))
            there[ties] = np.take_along_axis(there[ties], order, axis=1)
            # Others may be as near as the third where the last is.
            whole = away[:, -1] > away[:, CORNERS - 1] if k < n else np.ones(len(rows), bool)
            distances[rows[whole]] = away[whole, :CORNERS]
            heights[rows[whole]] = there[whole, :CORNERS]
            rows, k = rows[~whole], 2 * k
        return distances, heights


def ground_of(cloud):
    """A mask of the points of the ground, none of those marked withheld. Raise if there is none."""
    classes_of(cloud)
    ground = ground_in(cloud)
    check_ground(np.count_nonzero(ground))
    return ground


def check_ground(n_points):
    """Raise if there are too few points of the ground."""
    if n_points < CORNERS:
        raise PointFileError(
            f"heights over the ground are asked for, and fewer than {CORNERS} points have the "
            f"class {GROUND} (ground)"
        )


def heights_over_ground(xyz, ground):
    """Height of each point over the mean of the three ground points that are nearest in plan.

    Of equally distant ones the lowest count. `ground` is a mask of the points.
    """
    _, near = Ground(xyz[ground]).nearest(xyz)
    return xyz[:, 2] - near.mean(axis=1)


def depths_of_groups(xyz, ground, candidates):
    """How deep below ground the group of each candidate lies, in units of the group's size.

    A point is below ground if it is lower than the three ground points nearest in plan by more than
    these are away in plan. Points below ground are linked to those of their nearest neighbors that
    are closer than the ground is above them. What is linked is a group. Its depth is that of its
    highest point. Its size is the standard deviation along its longest axis, as of the detector's
    groups, but no less than the distance in plan to the third nearest ground point.

    `ground` and `candidates` are masks of the points. What is not below ground has 0.
    """
    away, near = Ground(xyz[ground]).nearest(xyz)
    depth, away = near.min(axis=1) - xyz[:, 2], away[:, -1]
    rows = np.flatnonzero(candidates & (depth > away))
    result = np.zeros(len(xyz))
    result[rows] = group_depths(xyz[rows], depth[rows], away[rows])
    return result


def group_depths(points, depth, away):
    """How deep the group of each point lies, in units of its size, whatever their order is.

    The points (n, 3) are all that are below ground: how far, says `depth`, and how far each is from
    the third nearest point of it in plan, `away`.
    """
    n, result = len(points), np.empty(len(points))
    if not n:
        return result
    order = np.lexsort(points.T)
    points, depth, away = points[order], depth[order], away[order]
    n_groups, group = connected_components(_links(points, depth), directed=False)
    highest = np.full(n_groups, np.inf)
    np.minimum.at(highest, group, depth)
    size = np.maximum(
        _longest_deviations(points, group, n_groups), np.bincount(group, away) / np.bincount(group)
    )
    with np.errstate(divide="ignore"):
        result[order] = (highest / size)[group]
    return result


def _links(points, depth):
    """The graph of points and those of their nearest that are closer than the ground is above."""
    tree, n = cKDTree(points, balanced_tree=False), len(points)
    near = np.arange(1, min(LINKED, n) + 1)
    links = []
    for first in range(0, n, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        distances, others = tree.query(points[some], near)
        own, column = np.nonzero(distances < depth[some, None])
        links.append(np.stack([first + own, others[own, column]]).astype(np.int32))
    own, others = np.concatenate(links, axis=1)
    return coo_array((np.ones(len(own), bool), (own, others)), shape=(n, n))


def _longest_deviations(points, group, n_groups):
    """The standard deviation of each group along its longest axis."""
    counts = np.bincount(group, minlength=n_groups)
    centers = np.stack([np.bincount(group, axis) / counts for axis in points.T], axis=1)
    away = points - centers[group]
    covariance = np.empty((n_groups, 3, 3))
    for i in range(3):
        for j in range(3):
            covariance[:, i, j] = np.bincount(group, away[:, i] * away[:, j]) / counts
    return np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[:, -1], 0.0))
