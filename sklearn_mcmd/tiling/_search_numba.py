"""The nearest points of queries, merged from cell after cell; compiled."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["merge_nearest"]


def merge_nearest(nearest, queries, asking, near, points, numbers):
    """Take points that are nearer to some queries, `asking`, than what is known, in place.

    Known are the nearest of each: squares of distances (m, k), ascending, inf where there is none;
    coordinates (m, k, 3); and numbers (m, k). The points (n, 3) have numbers, and `near` are rows
    of those that are nearest to each who asks, the nearest first.
    """
    k = nearest[0].shape[1]
    # Python makes the arrays, since Numba takes long to compile what makes them.
    merged = np.empty(k), np.empty((k, 3)), np.empty(k, nearest[2].dtype)
    _merge_nearest(*nearest, queries, asking, near, points, numbers, *merged)


@kernel(cache=True)
def _merge_nearest(
    squares, nearest, known, queries, asking, near, points, numbers,
    merged, merged_points, merged_numbers,
):  # fmt: skip
    k, width = squares.shape[1], near.shape[1]
    for a in range(len(asking)):
        i, old, new = asking[a], 0, 0
        square = _square(points, near[a, 0], queries, i)
        for j in range(k):
            takes = False
            if new < width:
                takes = square < squares[i, old]
                if square == squares[i, old] and np.isfinite(square):
                    takes = _is_before(points[near[a, new]], nearest[i, old])
            if takes:
                row = near[a, new]
                merged[j], merged_numbers[j] = square, numbers[row]
                for axis in range(3):
                    merged_points[j, axis] = points[row, axis]
                new += 1
                if new < width:
                    square = _square(points, near[a, new], queries, i)
            else:
                merged[j], merged_numbers[j] = squares[i, old], known[i, old]
                for axis in range(3):
                    merged_points[j, axis] = nearest[i, old, axis]
                old += 1
        if new:
            for j in range(k):
                squares[i, j], known[i, j] = merged[j], merged_numbers[j]
                for axis in range(3):
                    nearest[i, j, axis] = merged_points[j, axis]


@kernel
def _square(points, row, queries, i):
    square = 0.0
    for axis in range(3):
        gap = points[row, axis] - queries[i, axis]
        square += gap * gap
    return square


@kernel
def _is_before(point, other):
    """Whether coordinates come first in their order."""
    for axis in range(3):
        if point[axis] != other[axis]:
            return point[axis] < other[axis]
    return False
