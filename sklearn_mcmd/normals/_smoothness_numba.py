"""The smoothness of ``_smoothness`` in three dimensions, compiled."""

import numpy as np

from sklearn_mcmd.normals._quadrics_numba import TERMS, decompose, quadric_moments, work_arrays
from sklearn_mcmd.planes._kernels import kernel
from sklearn_mcmd.planes._moments_numba import FASTMATH, eigh_3d, weighted_covariance

__all__ = ["whole_planes_3d"]


def whole_planes_3d(points, around, limits, planes, directions, deviation, left, ordinary):
    """Fill the results of `whole_planes`; of the axes only the first and the last.

    `around` are Neighborhoods. Of `planes`, centroids, eigenvalues and normals are filled.
    """
    k = around.indices.shape[1]
    arrays, equations = work_arrays(4, k)
    room = arrays[:3], arrays[3], np.ones(k), *equations
    out = planes, directions, deviation, left, ordinary
    _whole_planes(points, around, limits, room, *out)


@kernel(cache=True)
def _whole_planes(points, around, limits, room, planes, directions, deviation, left, ordinary):
    indices, sizes = around.indices, around.sizes
    local, height, weight, moments, right, forward = room
    for i in range(len(indices)):
        size = sizes[i]
        origin = indices[i, 0]
        for j in range(size):
            for axis in range(3):
                local[axis, j] = points[indices[i, j], axis] - points[origin, axis]
        mean, covariance = weighted_covariance(local, size, weight)
        values, axes = eigh_3d(covariance)
        for axis in range(3):
            planes.centroids[i, axis] = points[origin, axis] + mean[axis]
            planes.eigenvalues[i, axis] = values[axis]
            planes.normals[i, axis] = axes[0][axis]
            directions[i, axis] = axes[2][axis]
        extent = np.sqrt(values[2])
        deviation[i] = left[i] = np.inf
        ordinary[i] = False
        if size < 2 * TERMS or extent == 0.0:
            continue
        total = quadric_moments(local, size, mean, axes, extent, moments, right, height)
        squares, determined = decompose(moments, right, forward, total, limits.pivot)
        plane = np.sqrt(total / (size - 3))
        deviation[i] = plane * extent
        if not determined:
            continue
        quadric = np.sqrt(squares / (size - TERMS))
        left[i] = quadric * extent
        if values[1] <= limits.least_width**2 * values[2]:
            continue
        if plane <= limits.perfect:
            ordinary[i] = True
        elif plane <= limits.most_ratio[size] * quadric:
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
