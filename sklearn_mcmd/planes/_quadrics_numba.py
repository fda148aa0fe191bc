"""Quadrics over planes, compiled: what they leave of noise, folds, tangents and curvatures.

In 2D the third coordinate, and v with it, is zero. The terms of v then have the coefficient 0.

A compiler takes one form of a loop where arrays may share memory, and another where they do not,
and the two add numbers in another order. For parts of one array it always takes the same form.
So all arrays of a kernel with one number for each member are rows of one.
"""

import numpy as np

from sklearn_mcmd.planes._moments_numba import (
    FASTMATH,
    kth_smallest,
    principal_axes,
    vector,
    weighted_covariance,
)
from sklearn_mcmd.runtime._kernels import kernel

TERMS = 6  # of a quadric over a plane in 3D
ORIGIN = 0.0, 0.0, 0.0  # the mean of members that are centered
TINY = np.finfo(np.float64).tiny  # least variance


@kernel
def localize(points, members, size, origin, local):
    """Fill the coordinates of members from an origin."""
    for j in range(size):
        for axis in range(len(origin)):
            local[axis, j] = points[members[j], axis] - origin[axis]


@kernel(fastmath=FASTMATH)
def quadric_moments(local, size, d, mean, axes, extent, moments, right, heights, weight=None):
    """Normal equations of the quadric (lower triangle) and the sum of squared heights.

    The terms are 1, u, v, uu, uv and vv. The sums are numbers and not arrays, because compilers
    vectorize these. Without `weight` each member counts one.
    """
    x, y, z = local[0], local[1], local[2]
    mx, my, mz = mean
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes
    scale = 1.0 / extent
    total = su = sv = suu = suv = svv = suuu = suuv = suvv = svvv = 0.0
    suuuu = suuuv = suuvv = suvvv = svvvv = 0.0
    sh = shu = shv = shuu = shuv = shvv = shh = 0.0
    for j in range(size):
        w = 1.0 if weight is None else weight[j]
        dx, dy, dz = x[j] - mx, y[j] - my, z[j] - mz
        h = (ax * dx + ay * dy + az * dz) * scale
        u = (bx * dx + by * dy + bz * dz) * scale
        v = (cx * dx + cy * dy + cz * dz) * scale
        wh, wu, wv = w * h, w * u, w * v
        uu, uv, vv = wu * u, wu * v, wv * v
        heights[j] = h
        total += w
        su += wu
        sv += wv
        suu += uu
        suv += uv
        svv += vv
        suuu += uu * u
        suuv += uu * v
        suvv += u * vv
        svvv += vv * v
        suuuu += uu * (u * u)
        suuuv += uu * (u * v)
        suuvv += uu * (v * v)
        suvvv += uv * (v * v)
        svvvv += vv * (v * v)
        sh += wh
        shu += wh * u
        shv += wh * v
        shuu += h * uu
        shuv += h * uv
        shvv += h * vv
        shh += wh * h
    moments[0, 0] = size if weight is None else total
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
    """Squares left, and whether the members determine the quadric; overwrites the moments.

    They become Cholesky's factor L, and ``forward`` solves L x = right.
    """
    for i in range(TERMS):
        diagonal = moments[i, i]
        for j in range(i):
            dot = moments[i, j]
            for m in range(j):
                dot -= moments[i, m] * moments[j, m]
            moments[i, j] = dot / moments[j, j]
        # What the terms before leave of this one: a small share of it is rounding.
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
def frame(normal, tangents):
    """The normal and the axes of u and v."""
    last = vector(tangents[1]) if len(tangents) > 1 else (0.0, 0.0, 1.0)
    return vector(normal), vector(tangents[0]), last


@kernel(cache=True)
def fit_whole_planes(points, around, limits, room, planes, directions, out):
    """Fill `out`, a `QuadricFit`, and the planes and directions of `whole_planes`."""
    deviation, left, ordinary = out
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
        # Divisors are degrees of freedom: members less the numbers that were fitted.
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
            # Three tests of normality: the farthest, skewness, and Geary's ratio.
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


@kernel(cache=True)
def find_quadric_normals(points, queries, around, planes, tangents, pivot, room, out):
    """Fill normals and centroids of `quadric_normals`, and the errors for a noise of one."""
    normals, centroids, tilt = out
    local, heights, lower, right, solution, first, second = room
    d = points.shape[1]
    for i in range(len(queries)):
        size = around.sizes[i]
        localize(points, around.indices[i], size, planes.centroids[i], local)
        axes = frame(planes.normals[i], tangents[i])
        normal, u_axis, v_axis = axes
        extent = np.sqrt(max(planes.eigenvalues[i, d - 1], TINY))
        quadric_moments(local, size, d, ORIGIN, axes, extent, lower, right, heights)
        _, determined = decompose(lower, right, solution, 0.0, pivot)
        tilt[i] = np.inf
        for axis in range(d):
            normals[i, axis], centroids[i, axis] = normal[axis], planes.centroids[i, axis]
        if not determined:
            continue
        back_substitute(lower, solution)

        # Step 1: where the query is in the plane, no farther off the mean than any member.
        u = v = 0.0
        for axis in range(d):
            gap = (queries[i, axis] - planes.centroids[i, axis]) / extent
            u += u_axis[axis] * gap
            v += v_axis[axis] * gap
        farthest = _farthest(local, size, u_axis, v_axis) / (extent * extent)
        length = u * u + v * v
        if length > farthest:
            share = np.sqrt(farthest / length)
            u, v = share * u, share * v
        # Step 2: the quadric's height and slopes there are those of its tangent plane.
        one, su, sv = solution[0], solution[1], solution[2]
        uu, uv, vv = solution[3], solution[4], solution[5]
        height = one + su * u + sv * v + uu * u * u + uv * u * v + vv * v * v
        su, sv = su + 2.0 * uu * u + uv * v, sv + uv * u + 2.0 * vv * v
        steep = 1.0 + su * su + sv * sv
        for axis in range(d):
            slope = su * u_axis[axis] + sv * v_axis[axis]
            normals[i, axis] = (normal[axis] - slope) / np.sqrt(steep)
            flat = u * u_axis[axis] + v * v_axis[axis]
            centroids[i, axis] += extent * (flat + height * normal[axis])
        # Step 3: the error of the slopes, from the cofactors of the solution. A slope changes the
        # normal by its part across the normal, over the normal's length.
        _gradient(lower, u, v, first, second)
        if d == 2:
            second[:] = 0.0
        variance = 0.0
        for row in range(TERMS):
            along = first[row] * su + second[row] * sv
            variance += first[row] ** 2 + second[row] ** 2 - along * along / steep
        tilt[i] = np.sqrt(variance / steep) / extent


@kernel(fastmath=FASTMATH)
def height_over(local, size, normal, level, heights):
    """Fill the heights of members above a plane."""
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz = normal
    for j in range(size):
        heights[j] = nx * x[j] + ny * y[j] + nz * z[j] - level


@kernel(fastmath=FASTMATH)
def _farthest(local, size, u_axis, v_axis):
    """Largest squared distance of a member from the mean, in the plane."""
    x, y, z = local[0], local[1], local[2]
    ax, ay, az = u_axis
    bx, by, bz = v_axis
    farthest = 0.0
    for j in range(size):
        u = ax * x[j] + ay * y[j] + az * z[j]
        v = bx * x[j] + by * y[j] + bz * z[j]
        farthest = max(farthest, u * u + v * v)
    return farthest


@kernel
def _gradient(lower, u, v, first, second):
    """The inverse of L times the derivatives of the terms by u and by v."""
    # Of 1, u, v, uu, uv and vv.
    first[0] = second[0] = 0.0
    first[1], first[2], first[3], first[4], first[5] = 1.0, 0.0, 2.0 * u, v, 0.0
    second[1], second[2], second[3], second[4], second[5] = 0.0, 1.0, 0.0, u, 2.0 * v
    for row in range(TERMS):
        for column in range(row):
            first[row] -= lower[row, column] * first[column]
            second[row] -= lower[row, column] * second[column]
        first[row] /= lower[row, row]
        second[row] /= lower[row, row]


@kernel
def least_squares(heights, size, n_best, work, keys):
    """Sum of the least squares of the heights; `keys` are the bits of `work` as integers."""
    for j in range(size):
        work[j] = heights[j] * heights[j]
    if n_best < 1:
        return 0.0
    most = kth_smallest(keys, size, n_best)
    n_less, total = 0, 0.0
    for j in range(size):
        if keys[j] < most:
            n_less += 1
            total += work[j]
    keys[0] = most  # whose number is then the first of `work`; equal ones fill up
    return total + (n_best - n_less) * work[0]


@kernel(cache=True)
def fit_jets(points, around, queries, tangents, planes, floor, limits, room, jets):
    """Fill `Jets` that are undetermined with quadrics of the members that belong to surfaces.

    `floor` (m,) is the least standard deviation of the noise, in units of the points.
    """
    indices, sizes = around.indices, around.sizes
    local, chosen, deviations, heights, used, lower, right, solution = room
    for i in range(len(indices)):
        size, radius = sizes[i], planes.radius[i]
        if not (planes.scale[i] > 0.0 and radius > 0.0):
            continue
        localize(points, indices[i], size, queries[i], local)
        axes = frame(planes.normals[i], tangents[i])
        solution[:] = 0.0
        for axis in range(3):
            solution[0] += axes[0][axis] * (planes.centroids[i, axis] - queries[i, axis]) / radius
        deviate(local, size, axes, radius, solution, deviations)
        noise = planes.scale[i] / radius
        used[:] = False
        for _ in range(1 + limits.rounds):
            n_used, changed = _choose(
                local, size, deviations, limits.explained * noise, used, chosen
            )
            if not changed:
                break
            jets.n_used[i] = 0
            if n_used < limits.least_members:
                break
            quadric_moments(chosen, n_used, 3, ORIGIN, axes, radius, lower, right, heights)
            _, determined = decompose(lower, right, solution, 0.0, limits.pivot)
            if not determined:
                break
            jets.n_used[i] = n_used
            back_substitute(lower, solution)
            deviate(local, size, axes, radius, solution, deviations)
            squares = 0.0
            for j in range(size):
                if used[j]:
                    squares += deviations[j] * deviations[j]
            noise = limits.truncation * np.sqrt(squares / (n_used - TERMS))
            noise = max(noise, floor[i] / radius)
            _store(jets, i, solution, lower, noise)


@kernel
def _choose(local, size, deviations, most, used, chosen):
    """Copy the members within the largest deviation; their number, and whether any is new."""
    n_used, changed = 0, False
    for j in range(size):
        inside = abs(deviations[j]) <= most
        changed |= inside != used[j]
        used[j] = inside
        if inside:
            for axis in range(3):
                chosen[axis, n_used] = local[axis, j]
            n_used += 1
    return n_used, changed


@kernel
def _store(jets, i, solution, lower, noise):
    jets.noise[i] = noise
    jets.slopes[i, 0], jets.slopes[i, 1] = solution[1], solution[2]
    place = 0
    for row in range(3):
        jets.bends[i, row] = solution[3 + row]
        for column in range(row + 1):
            jets.factors[i, place] = lower[3 + row, 3 + column]
            place += 1
