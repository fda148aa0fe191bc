"""Heights over the ground, where points have the class ground."""

from math import isfinite
from numbers import Real
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io._classes import GROUND, classes_of, ground_in
from sklearn_mcmd.io._point_cloud import PointFileError

AT_ONCE = 100_000  # points whose nearest are asked for at once
NONE_JUDGED = "no points are judged: all are withheld, of other classes, or at other heights"


class GroundLimits(NamedTuple):
    """What tells the height of the ground."""

    n_nearest: int = 3  # points nearest in plan, as of a triangle of the triangulated ground


class HeightRange(NamedTuple):
    """Which points are judged by their height over the ground, and whether groups below it are."""

    above: float | None = None
    below: float | None = None
    low_groups: bool = False

    @classmethod
    def of(cls, above, below, low_groups):
        """The limits, None if no heights are asked for; raises for what is no height."""
        for name, value in {"above": above, "below": below}.items():
            if value is not None and not (isinstance(value, Real) and isfinite(value)):
                raise ValueError(f"{name}={value!r} must be a finite number, or None.")
        above, below = (None if value is None else float(value) for value in (above, below))
        if above is not None and below is not None and above >= below:
            raise ParameterError(f"$above={above:g} must be less than $below={below:g}.")
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
    """Points of the ground, of which those nearest in plan can be asked for."""

    def __init__(self, xyz):
        xyz = xyz[np.lexsort(xyz.T[::-1])]
        # Of those at one place in plan only the lowest can be among the nearest.
        kept = np.ones(len(xyz), bool)
        self._n_nearest = m = GroundLimits().n_nearest
        kept[m:] = (xyz[m:, :2] != xyz[:-m, :2]).any(axis=1)
        # The tree's answer where there are too few points is their number: infinitely high.
        self._heights = np.append(xyz[kept, 2], np.inf)
        self._tree = cKDTree(xyz[kept, :2], balanced_tree=False)

    def nearest(self, xyz):
        """Distances in plan (m, 3) of the nearest ground points, and their heights.

        Of equally distant ones the lowest come first, whatever the order of the ground is.
        """
        distances, heights = np.empty((2, len(xyz), self._n_nearest))
        for first in range(0, len(xyz), AT_ONCE):
            rows = slice(first, first + AT_ONCE)
            distances[rows], heights[rows] = self._nearest(xyz[rows, :2])
        return distances, heights

    def _nearest(self, plan):
        n, m, rows = self._tree.n, self._n_nearest, np.arange(len(plan))
        (distances, heights), k = np.empty((2, len(plan), m)), m + 1
        while len(rows):
            away, near = self._tree.query(plan[rows], np.arange(1, max(m, min(k, n)) + 1))
            there = self._heights[near]
            ties = np.flatnonzero((away[:, 1:] == away[:, :-1]).any(axis=1))
            order = np.lexsort((there[ties], away[ties]))
            there[ties] = np.take_along_axis(there[ties], order, axis=1)
            # Others may be as near as the third where the last is.
            whole = away[:, -1] > away[:, m - 1] if k < n else np.ones(len(rows), bool)
            distances[rows[whole]] = away[whole, :m]
            heights[rows[whole]] = there[whole, :m]
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
    least = GroundLimits().n_nearest
    if n_points < least:
        raise PointFileError(
            f"heights over the ground are asked for, and fewer than {least} points have the "
            f"class {GROUND} (ground)"
        )


def heights_over_ground(xyz, ground):
    """Height of points over the mean of the three points of `ground`, a mask, nearest in plan."""
    _, near = Ground(xyz[ground]).nearest(xyz)
    return xyz[:, 2] - near.mean(axis=1)
