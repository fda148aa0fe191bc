"""Links between neighbors, and the growth of regions along them, compiled; any dimension."""

import numpy as np

from sklearn_mcmd.planes._moments_numba import kth_smallest
from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["grow", "link_rows"]


def link_rows(points, around, planes, floor, limits, start, radius, links):
    """Fill the links of the points from row `start` on, and the distances of the last neighbors.

    Parameters
    ----------
    points : float64 (n, d)
    around : Neighborhoods of the rows to be linked
    planes : Planes of all points
    floor : float64 (n,), what rounding adds to distances
    limits : LinkLimits
    start : row of the first of the points
    radius : float64 (m,), filled
    links : int32 (m, width), filled
    """
    room = np.empty((2, links.shape[1]))
    # Python makes the arrays, since Numba takes long to compile what makes them.
    centroids, normals, bits = planes.centroids, planes.normals, room.view(np.int64)
    _link_rows(
        points, around, centroids, normals, floor, limits, start, radius, links, *room, *bits
    )


@kernel(cache=True)
def _link_rows(
    points, around, centroids, normals, floor, limits, start, radius, links, heights, apart,
    height_bits, apart_bits,
):  # fmt: skip
    indices, sizes, d = around.indices, around.sizes, points.shape[1]
    for row in range(len(links)):
        i, size, n_links, last = start + row, sizes[row], 0, 0.0
        for a in range(size):
            heights[a] = abs(_height(points, indices[row, a], centroids, normals, i))
        limit = limits.max_distance
        if limit < 0.0:  # bits of numbers that are not negative sort like the numbers
            middle = _median(height_bits, apart, apart_bits, size)
            for a in range(size):
                apart[a] = abs(heights[a] - middle)
            limit = middle + limits.spread * _median(apart_bits, apart, apart_bits, size)
            limit += floor[i]
        for a in range(size):
            j, square, cosine = indices[row, a], 0.0, 0.0
            for axis in range(d):
                gap = points[j, axis] - points[i, axis]
                square += gap * gap
                cosine += normals[i, axis] * normals[j, axis]
            distance = np.sqrt(square)
            last = max(last, distance)
            fits = j != i and heights[a] <= limit and distance <= limits.max_gap
            if fits and abs(cosine) >= limits.min_cosine:
                links[row, n_links] = j
                n_links += 1
        radius[row] = last
        links[row, n_links:] = -1


@kernel
def _height(points, j, centroids, normals, i):
    height = 0.0
    for axis in range(points.shape[1]):
        height += (points[j, axis] - centroids[i, axis]) * normals[i, axis]
    return height


@kernel
def _median(bits, numbers, number_bits, size):
    """The median of numbers that are not negative, by their bits; of an even number the mean."""
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
