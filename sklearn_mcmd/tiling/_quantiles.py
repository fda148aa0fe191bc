"""Ranks among the numbers and points of all cells."""

import numpy as np

__all__ = ["evenly_along_x", "exceeded_by"]


def exceeded_by(parts, share):
    """The number that a share of numbers exceeds, of which all are in memory: 16 bytes for each.

    ``parts()`` iterates over arrays of float64.
    """
    numbers = np.concatenate(list(parts()))
    np.negative(numbers, out=numbers)
    return -np.percentile(numbers, 100 * share, overwrite_input=True)


def evenly_along_x(points, step):
    """Rows of every step-th of distinct points (n, 3) in the order of their coordinates."""
    x, ranks = np.array(points[:, 0]), np.arange(0, len(points), step)
    ordered = np.sort(x)
    wanted = ordered[ranks]
    before = np.searchsorted(ordered, wanted)
    del ordered
    # Only points with such an x are sorted by all coordinates.
    rows = np.flatnonzero(wanted[np.searchsorted(wanted[:-1], x)] == x)
    rows = rows[np.lexsort(points[rows].T[::-1])]
    return rows[np.searchsorted(x[rows], wanted) + ranks - before]
