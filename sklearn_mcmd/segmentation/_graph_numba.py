"""Links between neighbors in three dimensions and the growth of regions, compiled."""

import numpy as np
from numba import njit

from sklearn_mcmd.planes._plane_numba import kth_smallest
from sklearn_mcmd.segmentation._graph import MAD_TO_SD, N_DEVIATIONS, _grow

__all__ = ["grow", "link_neighbors_3d", "measure_neighbors_3d"]

grow = njit(cache=True, nogil=True)(_grow)


@njit(cache=True, nogil=True, error_model="numpy")
def measure_neighbors_3d(points, normals, indices, start, offset, limit):
    """`_measure_numpy` of `_graph`, one point at a time.

    Parameters
    ----------
    points, normals : float64 (n, 3)
    indices : (m, k) of the points from row `start` on, themselves first
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
        limit[row] = middle + N_DEVIATIONS * (MAD_TO_SD * _middle(deviations))


@njit(cache=True, nogil=True, error_model="numpy")
def link_neighbors_3d(
    points, normals, start, offset, limit, min_cosine, max_gap, most, majority, links
):  # fmt: skip
    """`_link_numpy` of `_graph`, one point at a time.

    Parameters
    ----------
    points, normals : float64 (n, 3)
    start : row of the first of the points
    offset, limit : float64 (n,)
    min_cosine, max_gap, most : float
    majority : tuple of 2 int, from `majority_of`
    links : int32 (m, width), the neighbors, nearest first; those that may be added are left
    """
    width = links.shape[1]
    n_fitting, nearest = majority
    around = np.empty(width + 1)
    keys = around.view(np.int64)  # limits are not negative: their bits are in their order
    for row in range(len(links)):
        i = start + row
        x, y, z = points[i]
        nx, ny, nz = normals[i]
        largest = limit[i]
        if most < np.inf:
            around[0] = limit[i]
            for a in range(width):
                around[a + 1] = limit[links[row, a]]
            keys[0] = kth_smallest(keys, width + 1, (width + 1) // 4 + 1)
            largest = min(largest, most * around[0])
        n_agreeing = n_links = 0
        if n_fitting == 0 or abs(offset[i]) <= largest:
            for a in range(width):
                j = links[row, a]
                gx, gy, gz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
                n = normals[j]
                away = abs(gx * nx + gy * ny + gz * nz - offset[i])
                if away <= largest and abs(n[0] * nx + n[1] * ny + n[2] * nz) >= min_cosine:
                    n_agreeing += 1 if a < nearest else 0
                    if np.sqrt(gx * gx + gy * gy + gz * gz) <= max_gap:
                        links[row, n_links] = j
                        n_links += 1
        if n_agreeing < n_fitting:
            n_links = 0
        links[row, n_links:] = -1


@njit(cache=True, nogil=True)
def _insert(ordered, size, value):
    """Put a value among the first `size` of an array, which ascend."""
    while size > 0 and ordered[size - 1] > value:
        ordered[size] = ordered[size - 1]
        size -= 1
    ordered[size] = value


@njit(cache=True, nogil=True)
def _middle(ordered):
    """Median of ascending values."""
    half = len(ordered) // 2
    if len(ordered) % 2:
        return ordered[half]
    return 0.5 * (ordered[half - 1] + ordered[half])


@njit(cache=True, nogil=True)
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
