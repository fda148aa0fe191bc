"""Bend or crease? A quadric, and two planes that meet in a line, fitted to the same members.

Both have six numbers. The line tells which members are of which plane: were each of the nearer one,
the noise would be sorted, and two planes would always leave less.

Numba lets a function without `fastmath` inherit it from the caller for which it is first compiled.
So what solves equations says ``fastmath=False``.
"""

import numpy as np

from sklearn_mcmd.planes._moments_numba import FASTMATH, principal_axes, vector, weighted_covariance
from sklearn_mcmd.planes._quadrics_numba import (
    ORIGIN,
    TERMS,
    TINY,
    back_substitute,
    decompose,
    deviate,
    height_over,
    least_squares,
    localize,
    quadric_moments,
)
from sklearn_mcmd.runtime._kernels import kernel

N_PLANE, N_QUADRIC = np.int64(3), np.int64(TERMS)  # what takes plain numbers is compiled for each
ROUNDS = 8  # times at most that the line tells the sides of two planes; two or three suffice
RIDGE = 1e-12  # share of the weights, added to equations that may determine nothing


@kernel(fastmath=False)
def fit_quadric(local, size, d, axes, extent, weight, deviations, equations):
    """Fill the distances of centered members, in extents, from the quadric over the plane of the
    axes that fits them best, by its slopes at their places."""
    lower, right, solution = equations
    quadric_moments(local, size, d, ORIGIN, axes, extent, lower, right, deviations, weight)
    ridge = RIDGE * lower[0, 0]
    for i in range(TERMS):
        lower[i, i] += ridge
    solution[:] = 0.0  # of what nothing determines
    # No pivot is too small here: the ridge keeps all of them.
    decompose(lower, right, solution, 0.0, 0.0)
    back_substitute(lower, solution)
    deviate(local, size, axes, extent, solution, deviations)
    x, y, z = local[0], local[1], local[2]
    _, (bx, by, bz), (cx, cy, cz) = axes
    su, sv = solution[1], solution[2]
    uu, uv, vv = solution[3] / extent, solution[4] / extent, solution[5] / extent
    for j in range(size):
        u = bx * x[j] + by * y[j] + bz * z[j]
        v = cx * x[j] + cy * y[j] + cz * z[j]
        # The slopes at (u, v); a height over a slope is longer than the distance from it.
        first, second = su + 2.0 * uu * u + uv * v, sv + uv * u + 2.0 * vv * v
        deviations[j] /= np.sqrt(1.0 + first * first + second * second)


@kernel(fastmath=False)
def fit_sides(local, size, d, axes, extent, weight, second, shares, heights):
    """Fill the distances (2, size) of members, in extents, above the planes nearest to both sides;
    True unless a side has no more members than a plane goes through."""
    n_second = 0
    for j in range(size):
        n_second += second[j]
    if min(n_second, size - n_second) <= d:
        return False
    up = axes[0]
    for side in range(2):
        for j in range(size):
            shares[j] = weight[j] if second[j] == (side == 1) else 0.0
        mean, covariance = weighted_covariance(local, size, shares)
        x, y, z = principal_axes(covariance, d)[1][0]
        scale = (1.0 if x * up[0] + y * up[1] + z * up[2] >= 0.0 else -1.0) / extent
        x, y, z = scale * x, scale * y, scale * z
        level = x * mean[0] + y * mean[1] + z * mean[2]
        height_over(local, size, (x, y, z), level, heights[side])
    return True


@kernel(fastmath=False)
def fit_crease(members, sides, shares, heights, deviations):
    """Least sum of squares about two planes that meet in a line, which tells the sides; inf if
    there are no two.

    The first row of `sides` has the members of one side at first, the others what the line tells:
    the last time, and the best time, of which `deviations` has the heights. Most members tell
    whether the crease is a ridge or a valley. Of `heights` (2, size) are the planes as fitted last.
    """
    _, size, _, _, _, weight = members
    first, told, best = sides
    least, sign = np.inf, 0.0
    for turn in range(ROUNDS + 1):
        second = told if turn else first
        if not fit_sides(*members, second, shares, heights):
            break
        if turn == 0:
            below = 0
            for j in range(size):
                below += first[j] == (heights[1, j] < heights[0, j])
            # On a ridge each side lies below the plane of the other.
            sign = 1.0 if 2 * below > size else -1.0
        left, same = 0.0, turn > 0
        for j in range(size):
            beyond = sign * (heights[0, j] - heights[1, j]) > 0.0
            same &= beyond == told[j]
            told[j] = beyond
            off = heights[1, j] if beyond else heights[0, j]
            left += weight[j] * off * off
        if turn > 0 and left < least:
            least = left
            for j in range(size):
                best[j] = told[j]
                deviations[j] = heights[1, j] if told[j] else heights[0, j]
        if same:
            break
    return least


@kernel(fastmath=FASTMATH)
def half_bic(mean_square, size, n_numbers):
    """Half of the Bayesian information criterion (BIC) of a model."""
    return 0.5 * (size * np.log(mean_square + TINY) + n_numbers * np.log(size))


@kernel
def design_effect(deviations, weights, cells):
    """By what factor the sums of cells vary more than those of independent deviations do."""
    # The sum of a cell has the variance of its deviations together, if these are independent: then
    # squares of sums and sums of squares are alike.
    squares = total = sums = 0.0
    for i in range(len(deviations)):
        if i > 0 and cells[i] != cells[i - 1]:
            sums += total * total
            total = 0.0
        total += deviations[i] * np.sqrt(weights[i])
        squares += weights[i] * deviations[i] * deviations[i]
    sums += total * total
    return max(sums / squares, 1.0) if squares > 0.0 else 1.0


@kernel(fastmath=FASTMATH)
def center(local, size, d, mean):
    """Move members to their mean, which is filled."""
    for axis in range(d):
        total = 0.0
        for j in range(size):
            total += local[axis, j]
        mean[axis] = total / size
        for j in range(size):
            local[axis, j] -= mean[axis]


@kernel
def mean_axes(first, second):
    """The mean of two normals of either sign, and two directions across it."""
    sign = (
        1.0 if first[0] * second[0] + first[1] * second[1] + first[2] * second[2] >= 0.0 else -1.0
    )
    x, y, z = first[0] + sign * second[0], first[1] + sign * second[1], first[2] + sign * second[2]
    scale = 1.0 / np.sqrt(x * x + y * y + z * z)
    up = (scale * x, scale * y, scale * z)
    u, v = across(up)
    return up, u, v


@kernel
def across(axis):
    """Two directions across an axis; of one in 2D the second is the third coordinate's."""
    x, y, z = axis
    if abs(z) <= abs(x) and abs(z) <= abs(y):
        a, b, c = y, -x, 0.0
    elif abs(x) <= abs(y):
        a, b, c = 0.0, z, -y
    else:
        a, b, c = -z, 0.0, x
    scale = 1.0 / np.sqrt(a * a + b * b + c * c)
    a, b, c = scale * a, scale * b, scale * c
    return (a, b, c), (y * c - z * b, z * a - x * c, x * b - y * a)


@kernel(cache=True)
def find_folded(points, around, planes, faces, limits, room, folded):
    """Fill `folded` as `are_folded` returns it."""
    local, heights, weight, shares, deviations, work, keys, sides, equations = room
    second = sides[0]
    d = points.shape[1]
    for i in range(len(folded)):
        size = around.sizes[i]
        localize(points, around.indices[i], size, planes.centroids[i], local)
        face, level = vector(faces.normals[i]), 0.0
        for axis in range(d):
            level += face[axis] * (faces.centroids[i, axis] - planes.centroids[i, axis])
        height_over(local, size, face, level, deviations)
        n_second = 0
        for j in range(size):
            second[j] = abs(deviations[j]) > limits.off * faces.scale[i]
            weight[j] = 1.0 if second[j] else 0.0
            n_second += second[j]
        folded[i] = False
        if n_second <= d:  # no second plane
            continue
        # Step 1: the quadric and both planes are fitted in the mean of their axes, which favors
        # neither, by what lies off the robust plane first.
        _, covariance = weighted_covariance(local, size, weight)
        weight[:size] = 1.0
        axes = mean_axes(face, principal_axes(covariance, d)[1][0])
        extent = np.sqrt(max(planes.eigenvalues[i, d - 1], TINY))
        members = local, size, d, axes, extent, weight
        left = fit_crease(members, sides, shares, heights, deviations)
        if left < np.inf:
            # Step 2: of both, the squares of the best members tell.
            for j in range(size):  # three faces may meet
                deviations[j] = min(abs(heights[0, j]), abs(heights[1, j]))
            n_best = int(limits.best * size)
            by_planes = least_squares(deviations, size, n_best, work, keys)
            fit_quadric(*members, deviations, equations)
            by_quadric = least_squares(deviations, size, n_best, work, keys)
            folded[i] = by_quadric > limits.evidence * by_planes
