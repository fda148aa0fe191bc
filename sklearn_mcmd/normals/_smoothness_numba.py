"""The smoothness of ``_smoothness``, compiled."""

import numpy as np

from sklearn_mcmd.normals._quadrics_numba import decompose, quadric_moments, work_arrays
from sklearn_mcmd.planes._moments_numba import FASTMATH, principal_axes, weighted_covariance
from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["fit_whole_planes"]


def fit_whole_planes(points, around, limits, planes, directions, deviation, left, ordinary):
    """Fill the results of `whole_planes`."""
    k = around.indices.shape[1]
    arrays, equations = work_arrays(4, k)
    room = arrays[:3], arrays[3], np.ones(k), *equations
    out = planes, directions, deviation, left, ordinary
    _whole_planes(points, around, limits, room, *out)


@kernel(cache=True)
def _whole_planes(points, around, limits, room, planes, directions, deviation, left, ordinary):
    indices, sizes, d = around.indices, around.sizes, points.shape[1]
    terms = d * (d + 1) // 2
    local, height, weight, moments, right, forward = room
    for i in range(len(indices)):
        size = sizes[i]
        origin = indices[i, 0]
        for j in range(size):
            for axis in range(d):
                local[axis, j] = points[indices[i, j], axis] - points[origin, axis]
        mean, covariance = weighted_covariance(local, size, weight)
        values, axes = principal_axes(covariance, d)
        for axis in range(d):
            planes.centroids[i, axis] = points[origin, axis] + mean[axis]
            planes.eigenvalues[i, axis] = values[axis]
            planes.normals[i, axis] = axes[0][axis]
            directions[i, axis] = axes[d - 1][axis]
        extent = np.sqrt(values[d - 1])
        deviation[i] = left[i] = np.inf
        ordinary[i] = False
        if size < 2 * terms or extent == 0.0:
            continue
        total = quadric_moments(local, size, d, mean, axes, extent, moments, right, height)
        squares, determined = decompose(moments, right, forward, total, limits.pivot)
        plane = np.sqrt(total / (size - d))
        deviation[i] = plane * extent
        if not determined:
            continue
        quadric = np.sqrt(squares / (size - terms))
        left[i] = quadric * extent
        if plane <= limits.most_ratio[size] * quadric:
            deviations = np.sqrt(total / size)
            farthest, first, third = _tails(height, size)
            geary = first / size / deviations
            ordinary[i] = (
                farthest <= limits.farthest[size] * deviations
                and abs(third) / size <= limits.most_skew[size] * deviations**3
                and abs(geary - limits.geary_of_normal) <= limits.geary[size]
            )


@kernel(fastmath=FASTMATH)
def _tails(height, size):
    """The largest absolute height, and sums of the first and third powers."""
    farthest = first = third = 0.0
    for j in range(size):
        absolute = abs(height[j])
        farthest = max(farthest, absolute)
        first += absolute
        third += height[j] * height[j] * height[j]
    return farthest, first, third
