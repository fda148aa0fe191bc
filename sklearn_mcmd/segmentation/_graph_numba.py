"""Links between neighbors in three dimensions and the growth of regions, compiled."""

import numpy as np

from sklearn_mcmd.planes._kernels import kernel
from sklearn_mcmd.segmentation._graph import _grow

__all__ = ["grow", "link_neighbors_3d", "measure_neighbors_3d"]

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


@kernel(cache=True, error_model="numpy")
def link_neighbors_3d(points, planes, start, limits, links):
    """`_link_numpy` of `_graph`, one point at a time.

    Parameters
    ----------
    points : float64 (n, 3)
    planes : LinkPlanes
    start : row of the first of the points
    limits : LinkLimits
    links : int32 (m, width), the neighbors, nearest first; those that may be added are left
    """
    normals, offset, limit, quiet = planes.normals, planes.offset, planes.limit, planes.quiet
    for row in range(len(links)):
        i = start + row
        x, y, z = points[i]
        nx, ny, nz = normals[i]
        n_links = 0
        for a in range(links.shape[1]):
            j = links[row, a]
            gx, gy, gz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
            n = normals[j]
            away = abs(gx * nx + gy * ny + gz * nz - offset[i])
            fits = away <= limit[i]
            fits &= abs(n[0] * nx + n[1] * ny + n[2] * nz) >= limits.min_cosine
            fits &= np.sqrt(gx * gx + gy * gy + gz * gz) <= limits.max_gap
            if limits.mutual:
                back = abs(gx * n[0] + gy * n[1] + gz * n[2] + offset[j])
                fits &= back <= limit[j] and quiet[i] and quiet[j]
            if fits:
                links[row, n_links] = j
                n_links += 1
        links[row, n_links:] = -1


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
