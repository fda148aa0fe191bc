"""Heights of neighbors above planes in three dimensions and the growth of regions, compiled."""

import numpy as np

from sklearn_mcmd.planes._kernels import kernel
from sklearn_mcmd.segmentation._graph import _grow

__all__ = ["grow", "measure_neighbors_3d"]

grow = kernel(_grow, cache=True)


@kernel(cache=True, error_model="numpy")
def measure_neighbors_3d(points, normals, indices, start, rule, offset, limit):
    """`_measure_numpy` of `_graph`, one point at a time.

    Parameters
    ----------
    points, normals : float64 (n, 3)
    indices : (m, k) of the points from row `start` on, themselves first
    rule : RuleA
    offset, limit : float64 (m,), filled
    """
    k = indices.shape[1]
    heights, away, deviations = np.empty(k), np.empty(k), np.empty(k)
    for row in range(len(indices)):
        x, y, z = points[start + row]
        nx, ny, nz = normals[start + row]
        for a in range(k):
            p = points[indices[row, a]]
            _insert(heights, a, (p[0] - x) * nx + (p[1] - y) * ny + (p[2] - z) * nz)
        offset[row] = _middle(heights)
        _sort_deviations(heights, offset[row], away)
        middle = _middle(away)
        _sort_deviations(away, middle, deviations)
        limit[row] = middle + rule.n_deviations * (rule.mad_to_sd * _middle(deviations))


@kernel(cache=True)
def _insert(ordered, size, value):
    """Put a value among the first `size` of an array, which ascend."""
    while size > 0 and ordered[size - 1] > value:
        ordered[size] = ordered[size - 1]
        size -= 1
    ordered[size] = value


@kernel(cache=True)
def _middle(ordered):
    """Median of ascending values."""
    half = len(ordered) // 2
    if len(ordered) % 2:
        return ordered[half]
    return 0.5 * (ordered[half - 1] + ordered[half])


@kernel(cache=True)
def _sort_deviations(ordered, middle, deviations):
    """Ascending absolute differences of ascending values from a number in their range."""
    size = len(ordered)
    above = 0
    while above < size and ordered[above] < middle:
        above += 1
    below = above - 1
    for a in range(size):
        if above == size or (below >= 0 and middle - ordered[below] <= ordered[above] - middle):
            deviations[a] = middle - ordered[below]
            below -= 1
        else:
            deviations[a] = ordered[above] - middle
            above += 1
