"""``find_lenders`` of ``_neighbor_planes``, compiled."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["find_lenders"]


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
        n = _localize(points, queries[i], around.indices[i], size, limits.patch, patch)
        lenders[i] = -1
        least_cost, best_first = np.inf, False
        for j in range(size):
            row = around.indices[i, j]
            if not planes.scale[row] > 0.0:
                continue
            height = reach = 0.0
            for axis in range(d):
                gap = queries[i, axis] - planes.centroids[row, axis]
                height += gap * planes.normals[row, axis]
                reach += gap * gap
            if not np.sqrt(reach) <= planes.radius[row]:
                continue
            variance = planes.scale[row] * planes.scale[row]
            distance = height * height / variance
            first = (
                variance <= most[i] * most[i] and distance <= limits.explained * limits.explained
            )
            if best_first and not first:
                continue
            _others(patch, n, planes.normals[row], height, heights)
            cost = np.log(variance) - 2.0 * np.log(planes.kept[row])
            cost += 0.5 * (distance + _weighted(heights, n, variance, limits.explained))
            if cost < np.inf and ((first and not best_first) or cost < least_cost):
                lenders[i] = row
                least_cost, best_first = cost, first


@kernel
def _localize(points, query, row, size, share, patch):
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


@kernel
def _others(patch, n, normal, height, heights):
    """Fill the heights of the patch above a plane."""
    for j in range(n):
        heights[j] = height
    for axis in range(len(normal)):
        for j in range(n):
            heights[j] += normal[axis] * patch[axis, j]


@kernel
def _weighted(heights, n, variance, explained):
    """Weighted mean of squared distances in standard deviations, each limited."""
    total = 0.0
    for j in range(n):
        total += (n - j) * min(heights[j] * heights[j] / variance, explained * explained)
    return total / max(0.5 * n * (n + 1), 1.0)
