"""Links between neighbors in three dimensions and the growth of regions, compiled."""

import numpy as np
from numba import njit

from sklearn_mcmd._region_graph import MAD_TO_SD, N_DEVIATIONS, _grow

__all__ = ["grow", "link_neighbors_3d"]

grow = njit(cache=True, nogil=True)(_grow)


@njit(cache=True, nogil=True, error_model="numpy")
def link_neighbors_3d(
    points, normals, indices, distances, start, floor,
    min_cosine, max_distance, max_gap, majority, links, offset,
):  # fmt: skip
    """`_link_numpy` of `_region_graph`, one point at a time.

    Parameters
    ----------
    points, normals : float64 (n, 3)
    indices, distances : (m, k) of the points from row `start` on, nearest first
    floor : float64 (m,)
    min_cosine : float
    max_distance : float, negative for the automatic one
    max_gap : float
    majority : tuple of 2 int, from `majority_of`
    links : int32 (m, width), filled
    offset : float64 (m,), filled
    """
    k, width = indices.shape[1], links.shape[1]
    n_fitting, nearest = majority
    heights, away, work = np.empty(k), np.empty(k), np.empty(k)
    for row in range(len(indices)):
        i = start + row
        x, y, z = points[i]
        nx, ny, nz = normals[i]
        for a in range(k):
            p = points[indices[row, a]]
            heights[a] = (p[0] - x) * nx + (p[1] - y) * ny + (p[2] - z) * nz
            work[a] = heights[a]
        middle = _median(work)
        offset[row] = middle
        for a in range(k):
            away[a] = abs(heights[a] - middle)
            work[a] = away[a]
        limit = max_distance
        if max_distance < 0:
            middle = _median(work)
            for a in range(k):
                work[a] = abs(away[a] - middle)
            limit = max(middle + N_DEVIATIONS * (MAD_TO_SD * _median(work)), floor[row])
        n_agreeing = n_links = 0
        links[row] = -1
        for a in range(1, max(nearest, width) + 1):
            j = indices[row, a]
            n = normals[j]
            cosine = abs(n[0] * nx + n[1] * ny + n[2] * nz)
            if away[a] <= limit and cosine >= min_cosine:
                n_agreeing += 1 if a <= nearest else 0
                if a <= width and distances[row, a] <= max_gap:
                    links[row, n_links] = j
                    n_links += 1
        if n_agreeing < n_fitting:
            links[row] = -1


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
