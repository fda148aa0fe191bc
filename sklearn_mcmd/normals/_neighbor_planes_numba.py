"""``find_lenders`` of ``_neighbor_planes``, compiled."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["cost_of_plane", "find_lenders", "height_over", "localize"]


def find_lenders(points, queries, around, planes, most, limits, lenders):
    """Fill `lenders` as `find_lenders` of ``_neighbor_planes`` returns them."""
    arrays = np.empty((queries.shape[1] + 1, around.indices.shape[1]))
    _find_lenders(points, queries, around, planes, most, limits, arrays, lenders)


@kernel(cache=True)
def _find_lenders(points, queries, around, planes, most, limits, arrays, lenders):
    d = queries.shape[1]
    patch, heights = arrays[:d], arrays[d]
    for i in range(len(queries)):
        size = around.sizes[i]
        n = localize(points, queries[i], around.indices[i], size, limits.patch, patch)
        lenders[i] = -1
        least_cost, best_first = np.inf, False
        for j in range(size):
            row = around.indices[i, j]
            height = height_over(planes, row, queries[i])
            variance = planes.scale[row] * planes.scale[row]
            distance = height * height / variance
            first = (
                variance <= most[i] * most[i] and distance <= limits.explained * limits.explained
            )
            if not distance < np.inf or (best_first and not first):
                continue
            cost = cost_of_plane(planes, row, height, limits, patch, n, heights)
            if cost < np.inf and ((first and not best_first) or cost < least_cost):
                lenders[i] = row
                least_cost, best_first = cost, first


@kernel(inline="always")
def height_over(planes, row, query):
    """Height of a query above the plane of a row; inf where that is none, or does not reach it."""
    height = reach = 0.0
    for axis in range(len(query)):
        gap = query[axis] - planes.centroids[row, axis]
        height += gap * planes.normals[row, axis]
        reach += gap * gap
    reached = planes.scale[row] > 0.0 and np.sqrt(reach) <= planes.radius[row]
    return height if reached else np.inf


@kernel(inline="always")
def cost_of_plane(planes, row, height, limits, patch, n, heights):
    """Minus the logarithm of how likely the plane of a row is that of a patch, whose query is at
    this height above it."""
    variance = planes.scale[row] * planes.scale[row]
    _others(patch, n, planes.normals[row], height, heights)
    cost = np.log(variance) - 2.0 * np.log(planes.kept[row])
    distances = height * height / variance + _weighted(heights, n, variance, limits.explained)
    return cost + 0.5 * distances


@kernel(inline="always")
def localize(points, query, row, size, share, patch):
    """Fill the coordinates of the patch from the query, and return its number of points."""
    same = True
    for axis in range(len(query)):
        same &= points[row[0], axis] == query[axis]
    start = 1 if same else 0
    n = min(max(1, int(share * size)), size - start)
    for j in range(n):
        for axis in range(len(query)):
            patch[axis, j] = points[row[start + j], axis] - query[axis]
    return n


@kernel(inline="always")
def _others(patch, n, normal, height, heights):
    """Fill the heights of the patch above a plane."""
    for j in range(n):
        heights[j] = height
    for axis in range(len(normal)):
        for j in range(n):
            heights[j] += normal[axis] * patch[axis, j]


@kernel(inline="always")
def _weighted(heights, n, variance, explained):
    """Weighted mean of squared distances in standard deviations, each limited."""
    total, most = 0.0, explained * explained * variance
    for j in range(n):
        total += (n - j) * min(heights[j] * heights[j], most)
    return total / (max(0.5 * n * (n + 1), 1.0) * variance)
