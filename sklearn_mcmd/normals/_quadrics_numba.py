"""Quadrics over planes, compiled: equations, solutions, heights, and whether these are noise.

In 2D the third coordinate, and v with it, is zero. The terms of v then have the coefficient 0.

A compiler takes one form of a loop where arrays may share memory, and another where they do not,
and the two add numbers in another order. For parts of one array it always takes the same form.
So all arrays of a kernel with one number for each member are rows of one.
"""

import numpy as np

from sklearn_mcmd.planes._moments_numba import FASTMATH, principal_axes, weighted_covariance
from sklearn_mcmd.runtime._kernels import kernel

TERMS = 6  # of a quadric over a plane in 3D
ORIGIN = 0.0, 0.0, 0.0  # the mean of members that are centered


@kernel
def localize(points, members, size, origin, local):
    """Fill the coordinates of members from an origin."""
    for j in range(size):
        for axis in range(len(origin)):
            local[axis, j] = points[members[j], axis] - origin[axis]


@kernel(fastmath=FASTMATH)
def quadric_moments(local, size, d, mean, axes, extent, moments, right, heights):
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
    if d == 2:
        moments[2, 2] = moments[4, 4] = moments[5, 5] = 1.0
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


@kernel(fastmath=FASTMATH)
def deviate(local, size, axes, radius, coefficients, deviations):
    """Heights of the members above the quadric, in radii."""
    x, y, z = local[0], local[1], local[2]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes
    scale = 1.0 / radius
    one, first, second = coefficients[0], coefficients[1], coefficients[2]
    uu, uv, vv = coefficients[3], coefficients[4], coefficients[5]
    for j in range(size):
        h = (ax * x[j] + ay * y[j] + az * z[j]) * scale
        u = (bx * x[j] + by * y[j] + bz * z[j]) * scale
        v = (cx * x[j] + cy * y[j] + cz * z[j]) * scale
        quadric = one + first * u + second * v + uu * u * u + uv * u * v + vv * v * v
        deviations[j] = h - quadric


@kernel
def back_substitute(lower, solution):
    """Solve L' x = solution in place."""
    for i in range(TERMS - 1, -1, -1):
        value = solution[i]
        for j in range(i + 1, TERMS):
            value -= lower[j, i] * solution[j]
        solution[i] = value / lower[i, i]


@kernel
def vector(values):
    return values[0], values[1], values[2] if len(values) > 2 else 0.0


@kernel
def frame(normal, tangents):
    """The normal and the axes of u and v."""
    last = vector(tangents[1]) if len(tangents) > 1 else (0.0, 0.0, 1.0)
    return vector(normal), vector(tangents[0]), last


@kernel(cache=True)
def fit_whole_planes(points, around, limits, room, planes, directions, deviation, left, ordinary):
    """Fill the results of `whole_planes`."""
    indices, sizes, d = around.indices, around.sizes, points.shape[1]
    terms = d * (d + 1) // 2
    local, height, weight, moments, right, forward = room
    for i in range(len(indices)):
        size, origin = sizes[i], indices[i, 0]
        localize(points, indices[i], size, points[origin], local)
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
