"""The nearest points of queries, merged from cell after cell; compiled."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel


@kernel(cache=True)
def merge_nearest(known, queries, rows, near, points, numbers, merged):
    """Take points that are nearer to some queries, the `rows`, than what is known, in place.

    Known are the nearest of each: squares of distances (m, k), ascending, inf where there is none;
    coordinates (m, k, 3); and numbers (m, k). The points (n, 3) have numbers, and `near` are those
    that are nearest to each of the rows, the nearest first; `merged` is room for one of `known`.
    """
    squares, known_points, known_numbers = known
    merged_squares, merged_points, merged_numbers = merged
    k, width = squares.shape[1], near.shape[1]
    for a in range(len(rows)):
        i, old, new = rows[a], 0, 0
        square = _square(points, near[a, 0], queries, i)
        for j in range(k):
            takes = False
            if new < width:
                takes = square < squares[i, old]
                if square == squares[i, old] and np.isfinite(square):
                    takes = _is_before(points[near[a, new]], known_points[i, old])
            if takes:
                row = near[a, new]
                merged_squares[j], merged_numbers[j] = square, numbers[row]
                for axis in range(3):
                    merged_points[j, axis] = points[row, axis]
                new += 1
                if new < width:
                    square = _square(points, near[a, new], queries, i)
            else:
                merged_squares[j], merged_numbers[j] = squares[i, old], known_numbers[i, old]
                for axis in range(3):
                    merged_points[j, axis] = known_points[i, old, axis]
                old += 1
        if new:
            for j in range(k):
                squares[i, j], known_numbers[i, j] = merged_squares[j], merged_numbers[j]
                for axis in range(3):
                    known_points[i, j, axis] = merged_points[j, axis]


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
