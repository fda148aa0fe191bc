"""Links between neighbors in three dimensions and the growth of regions, compiled."""

import numpy as np
from numba import njit

from sklearn_mcmd._region_graph import MAD_TO_SD, N_DEVIATIONS, _grow

__all__ = ["grow", "link_neighbors_3d", "measure_neighbors_3d"]

grow = njit(cache=True, nogil=True)(_grow)


@njit(cache=True, nogil=True, error_model="numpy")
def measure_neighbors_3d(points, normals, indices, start, offset, limit):
    """`_measure_numpy` of `_region_graph`, one point at a time.

    Parameters
    ----------
    points, normals : float64 (n, 3)
    indices : (m, k) of the points from row `start` on, themselves first
    offset, limit : float64 (m,), filled
    """
    k = indices.shape[1]
    away, work = np.empty(k), np.empty(k)
    for row in range(len(indices)):
        x, y, z = points[start + row]
        nx, ny, nz = normals[start + row]
        for a in range(k):
            p = points[indices[row, a]]
            away[a] = (p[0] - x) * nx + (p[1] - y) * ny + (p[2] - z) * nz
            work[a] = away[a]
        middle = _median(work)
        offset[row] = middle
        for a in range(k):
            away[a] = abs(away[a] - middle)
            work[a] = away[a]
        middle = _median(work)
        for a in range(k):
            work[a] = abs(away[a] - middle)
        limit[row] = middle + N_DEVIATIONS * (MAD_TO_SD * _median(work))


@njit(cache=True, nogil=True, error_model="numpy")
def link_neighbors_3d(
    points, normals, start, offset, limit, min_cosine, max_gap, most, majority, links
):  # fmt: skip
    """`_link_numpy` of `_region_graph`, one point at a time.

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
    for row in range(len(links)):
        i = start + row
        x, y, z = points[i]
        nx, ny, nz = normals[i]
        largest = limit[i]
        if most < np.inf:
            around[0] = limit[i]
            for a in range(width):
                around[a + 1] = limit[links[row, a]]
            around.sort()
            largest = min(largest, most * around[(width + 1) // 4])
        n_agreeing = n_links = 0
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
        if n_agreeing < n_fitting or (n_fitting > 0 and abs(offset[i]) > largest):
            n_links = 0
        links[row, n_links:] = -1


@njit(cache=True, nogil=True)
def _median(values):
    """Median of an array, which is reordered (Hoare's selection)."""
    size = len(values)
    half = size // 2
    low, high = 0, size - 1
    while low < high:
        pivot = values[half]
        a, b = low, high
        while a <= b:
            while values[a] < pivot:
                a += 1
            while pivot < values[b]:
                b -= 1
            if a <= b:
                values[a], values[b] = values[b], values[a]
                a += 1
                b -= 1
        if b < half:
            low = a
        if half < a:
            high = b
    upper = values[half]
    if size % 2:
        return upper
    lower = values[0]
    for a in range(1, half):
        lower = max(lower, values[a])
    return 0.5 * (lower + upper)
