"""The smoothness of ``_smoothness`` in three dimensions, compiled."""

import numpy as np

from sklearn_mcmd.planes._kernels import kernel
from sklearn_mcmd.planes._moments_numba import FASTMATH, eigh_3d, weighted_covariance

__all__ = ["decompose", "quadric_moments", "whole_planes_3d"]

TERMS = 6


def whole_planes_3d(points, around, limits, planes, directions, deviation, left, ordinary):
    """Fill the results of `whole_planes`; of the axes only the first and the last.

    `around` are Neighborhoods. Of `planes`, centroids, eigenvalues and normals are filled.
    """
    k = around.indices.shape[1]
    # Python makes the arrays, since Numba takes long to compile what makes them.
    room = (
        np.empty((3, k)),
        np.ones(k),
        np.empty(k),
        np.empty((TERMS, TERMS)),
        *np.empty((2, TERMS)),
    )
    out = planes, directions, deviation, left, ordinary
    _whole_planes(points, around, limits, room, *out)


@kernel(cache=True)
def _whole_planes(points, around, limits, room, planes, directions, deviation, left, ordinary):
    indices, sizes = around.indices, around.sizes
    local, weight, height, moments, right, forward = room
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


@kernel(fastmath=FASTMATH)
def quadric_moments(local, size, mean, axes, extent, moments, right, heights):
    """Normal equations of the quadric (lower triangle) and the sum of squared heights.

    The terms are 1, u, v, uu, uv and vv. The sums are numbers and not arrays, because compilers
    vectorize these.
    """
    x, y, z = local[0], local[1], local[2]
    mx, my, mz = mean
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes
    scale = 1.0 / extent
    su = sv = suu = suv = svv = suuu = suuv = suvv = svvv = 0.0
    suuuu = suuuv = suuvv = suvvv = svvvv = 0.0
    sh = shu = shv = shuu = shuv = shvv = shh = 0.0
    for j in range(size):
        dx, dy, dz = x[j] - mx, y[j] - my, z[j] - mz
        h = (ax * dx + ay * dy + az * dz) * scale
        u = (bx * dx + by * dy + bz * dz) * scale
        v = (cx * dx + cy * dy + cz * dz) * scale
        uu, uv, vv = u * u, u * v, v * v
        heights[j] = h
        su += u
        sv += v
        suu += uu
        suv += uv
        svv += vv
        suuu += uu * u
        suuv += uu * v
        suvv += u * vv
        svvv += vv * v
        suuuu += uu * uu
        suuuv += uu * uv
        suuvv += uu * vv
        suvvv += uv * vv
        svvvv += vv * vv
        sh += h
        shu += h * u
        shv += h * v
        shuu += h * uu
        shuv += h * uv
        shvv += h * vv
        shh += h * h
    moments[0, 0] = size
    moments[1, 0], moments[1, 1] = su, suu
    moments[2, 0], moments[2, 1], moments[2, 2] = sv, suv, svv
    moments[3, 0], moments[3, 1], moments[3, 2], moments[3, 3] = suu, suuu, suuv, suuuu
    moments[4, 0], moments[4, 1], moments[4, 2] = suv, suuv, suvv
    moments[4, 3], moments[4, 4] = suuuv, suuvv
    moments[5, 0], moments[5, 1], moments[5, 2] = svv, suvv, svvv
    moments[5, 3], moments[5, 4], moments[5, 5] = suuvv, suvvv, svvvv
    right[0], right[1], right[2], right[3], right[4], right[5] = sh, shu, shv, shuu, shuv, shvv
    return shh


@kernel
def decompose(moments, right, forward, total, least_pivot):
    """Squares left, and whether the members determine the quadric; overwrites the moments."""
    for i in range(TERMS):
        diagonal = moments[i, i]
        for j in range(i):
            dot = moments[i, j]
            for m in range(j):
                dot -= moments[i, m] * moments[j, m]
            moments[i, j] = dot / moments[j, j]
        pivot, value = diagonal, right[i]
        for m in range(i):
            pivot -= moments[i, m] * moments[i, m]
            value -= moments[i, m] * forward[m]
        if not pivot > least_pivot * diagonal:
            return total, False
        moments[i, i] = np.sqrt(pivot)
        forward[i] = value / moments[i, i]
        total -= forward[i] * forward[i]
    return max(total, 0.0), True
