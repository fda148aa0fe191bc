"""Links between neighbors, and the growth of regions along them, compiled; any dimension."""

import numpy as np

from sklearn_mcmd.planes._moments_numba import kth_smallest
from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["grow", "link_rows", "measure_rows"]


def measure_rows(points, around, planes, spread, start, limit, radius):
    """Fill the paper's distances from the planes of the points from row `start` on.

    They are the median of the neighbors' distances, and `spread` times the median of what these
    differ from it. `radius` (m,) becomes the distances of the last neighbors.
    """
    room = np.empty((2, around.indices.shape[1]))
    # Python makes the arrays, since Numba takes long to compile what makes them.
    bits = room.view(np.int64)
    _measure_rows(
        points, around, planes.centroids, planes.normals, spread, start, limit, radius, *room, *bits
    )


@kernel(cache=True)
def _measure_rows(
    points, around, centroids, normals, spread, start, limit, radius, heights, apart,
    height_bits, apart_bits,
):  # fmt: skip
    for row in range(len(limit)):
        i, size, last = start + row, around.sizes[row], 0.0
        for a in range(size):
            j, square = around.indices[row, a], 0.0
            for axis in range(points.shape[1]):
                gap = points[j, axis] - points[i, axis]
                square += gap * gap
            last = max(last, square)
            heights[a] = abs(_height(points, j, centroids, normals, i))
        middle = _median(height_bits, apart, apart_bits, size)
        for a in range(size):
            apart[a] = abs(heights[a] - middle)
        limit[row] = middle + spread * _median(apart_bits, apart, apart_bits, size)
        radius[row] = np.sqrt(last)


def link_rows(points, around, planes, limit, limits, start, links):
    """Fill the links of the points from row `start` on.

    Parameters
    ----------
    points : float64 (n, d)
    around : Neighborhoods of the rows to be linked
    planes : Planes of all points
    limit : float64 (n,), largest distances from planes
    limits : GrowthLimits
    start : row of the first of the points
    links : int32 (m, width), filled
    """
    _link_rows(points, around, planes.centroids, planes.normals, limit, limits, start, links)


@kernel(cache=True)
def _link_rows(points, around, centroids, normals, limit, limits, start, links):
    for row in range(len(links)):
        i, n_links = start + row, 0
        for a in range(around.sizes[row]):
            j, square, cosine = around.indices[row, a], 0.0, 0.0
            for axis in range(points.shape[1]):
                gap = points[j, axis] - points[i, axis]
                square += gap * gap
                cosine += normals[i, axis] * normals[j, axis]
            fits = j != i and np.sqrt(square) <= limits.max_gap
            fits &= abs(cosine) >= limits.min_cosine
            fits &= abs(_height(points, j, centroids, normals, i)) <= limit[i]
            if limits.mutual:
                fits &= abs(_height(points, i, centroids, normals, j)) <= limit[j]
            if fits:
                links[row, n_links] = j
                n_links += 1
        links[row, n_links:] = -1


@kernel
def _height(points, j, centroids, normals, i):
    height = 0.0
    for axis in range(points.shape[1]):
        height += (points[j, axis] - centroids[i, axis]) * normals[i, axis]
    return height


@kernel
def _median(bits, numbers, number_bits, size):
    """The median of numbers that are not negative, by their bits, which sort like the numbers."""
    lower = kth_smallest(bits, size, (size + 1) // 2)
    upper = kth_smallest(bits, size, size // 2 + 1)
    number_bits[0] = lower
    low = numbers[0]
    number_bits[0] = upper
    return 0.5 * (low + numbers[0])


@kernel(cache=True)
def grow(links, seeds):
    """Labels of regions, as of `grow_regions`."""
    n, width = links.shape
    labels = np.full(n, -1, np.int32)
    waiting = np.empty(n, np.int32)  # the current seed list, S_c
    region = 0
    for seed in seeds:
        if labels[seed] >= 0:
            continue
        labels[seed] = region
        waiting[0] = seed
        n_waiting = 1
        while n_waiting > 0:
            n_waiting -= 1
            i = waiting[n_waiting]
            for a in range(width):
                j = links[i, a]
                if j < 0:
                    break
                if labels[j] < 0:
                    labels[j] = region
                    waiting[n_waiting] = j
                    n_waiting += 1
        region += 1
    return labels
