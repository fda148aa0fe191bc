"""``_folds``, compiled."""

import numpy as np

from sklearn_mcmd.normals._quadrics_numba import (
    ORIGIN,
    TERMS,
    back_substitute,
    decompose,
    deviate,
    frame,
    localize,
    quadric_moments,
    vector,
)
from sklearn_mcmd.planes._moments_numba import (
    FASTMATH,
    kth_smallest,
    principal_axes,
    weighted_covariance,
)
from sklearn_mcmd.runtime._kernels import kernel

TINY = np.finfo(np.float64).tiny  # least variance


@kernel(cache=True)
def find_folded(points, around, planes, tangents, faces, limits, room, folded):
    """Fill `folded` as `are_folded` returns it."""
    local, work, weight, first, second, keys, lower, right, solution = room
    d = points.shape[1]
    for i in range(len(folded)):
        size = around.sizes[i]
        localize(points, around.indices[i], size, planes.centroids[i], local)
        face = vector(faces.normals[i])
        level = 0.0
        for axis in range(d):
            level += face[axis] * (faces.centroids[i, axis] - planes.centroids[i, axis])
        _height(local, size, face, level, first)
        off = limits.off * faces.scale[i]
        _fit_two(local, size, d, off, limits.rounds, weight, first, second)
        n_best = int(limits.best * size)
        by_planes = _least(first, size, n_best, work, keys)

        axes = frame(planes.normals[i], tangents[i])
        extent = np.sqrt(max(planes.eigenvalues[i, d - 1], TINY))
        quadric_moments(local, size, d, ORIGIN, axes, extent, lower, right, first)
        decompose(lower, right, solution, 0.0, 0.0)
        back_substitute(lower, solution)
        deviate(local, size, axes, extent, solution, first)
        by_quadric = extent * extent * _least(first, size, n_best, work, keys)
        folded[i] = by_quadric > limits.evidence * by_planes


@kernel
def _fit_two(local, size, d, off, rounds, weight, first, second):
    """Overwrite the heights over one plane, `first`, with those over the nearer of two."""
    n_second = 0
    for j in range(size):
        second[j] = np.inf
        weight[j] = 1.0 if abs(first[j]) > off else 0.0
        n_second += 1 if abs(first[j]) > off else 0
    if n_second >= d:
        _heights_over_fitted(local, size, d, weight, second)
        for _ in range(rounds):
            n_second = 0
            for j in range(size):
                nearer = abs(second[j]) < abs(first[j])
                weight[j] = 1.0 if nearer else 0.0
                n_second += 1 if nearer else 0
            if n_second < d or size - n_second < d:
                break
            _heights_over_fitted(local, size, d, weight, second)
            for j in range(size):
                weight[j] = 1.0 - weight[j]
            _heights_over_fitted(local, size, d, weight, first)
    for j in range(size):
        first[j] = min(abs(first[j]), abs(second[j]))


@kernel
def _heights_over_fitted(local, size, d, weight, heights):
    """Fill the heights over the plane of the weighted members."""
    mean, covariance = weighted_covariance(local, size, weight)
    _, axes = principal_axes(covariance, d)
    x, y, z = axes[0]
    _height(local, size, axes[0], x * mean[0] + y * mean[1] + z * mean[2], heights)


@kernel(cache=True)
def find_quadric_normals(
    points, queries, around, planes, tangents, pivot, room, normals, centroids, tilt
):
    """Fill normals and centroids of `quadric_normals`, and the errors for a noise of one."""
    local, heights, lower, right, solution, first, second = room
    d = points.shape[1]
    for i in range(len(queries)):
        size = around.sizes[i]
        localize(points, around.indices[i], size, planes.centroids[i], local)
        axes = frame(planes.normals[i], tangents[i])
        normal, tangent, other = axes
        extent = np.sqrt(max(planes.eigenvalues[i, d - 1], TINY))
        quadric_moments(local, size, d, ORIGIN, axes, extent, lower, right, heights)
        _, determined = decompose(lower, right, solution, 0.0, pivot)
        tilt[i] = np.inf
        for axis in range(d):
            normals[i, axis], centroids[i, axis] = normal[axis], planes.centroids[i, axis]
        if not determined:
            continue
        back_substitute(lower, solution)

        u = v = 0.0
        for axis in range(d):
            gap = (queries[i, axis] - planes.centroids[i, axis]) / extent
            u += tangent[axis] * gap
            v += other[axis] * gap
        farthest = _farthest(local, size, tangent, other) / (extent * extent)
        length = u * u + v * v
        if length > farthest:
            share = np.sqrt(farthest / length)
            u, v = share * u, share * v
        one, su, sv = solution[0], solution[1], solution[2]
        uu, uv, vv = solution[3], solution[4], solution[5]
        height = one + su * u + sv * v + uu * u * u + uv * u * v + vv * v * v
        su, sv = su + 2.0 * uu * u + uv * v, sv + uv * u + 2.0 * vv * v
        steep = 1.0 + su * su + sv * sv
        for axis in range(d):
            slope = su * tangent[axis] + sv * other[axis]
            normals[i, axis] = (normal[axis] - slope) / np.sqrt(steep)
            flat = u * tangent[axis] + v * other[axis]
            centroids[i, axis] += extent * (flat + height * normal[axis])
        _gradient(lower, u, v, first, second)
        if d == 2:
            second[:] = 0.0
        variance = 0.0
        for row in range(TERMS):
            along = first[row] * su + second[row] * sv
            variance += first[row] ** 2 + second[row] ** 2 - along * along / steep
        tilt[i] = np.sqrt(variance / steep) / extent


@kernel(fastmath=FASTMATH)
def _height(local, size, normal, level, heights):
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz = normal
    for j in range(size):
        heights[j] = nx * x[j] + ny * y[j] + nz * z[j] - level


@kernel(fastmath=FASTMATH)
def _farthest(local, size, tangent, other):
    """Largest squared distance of a member from the mean, in the plane."""
    x, y, z = local[0], local[1], local[2]
    ax, ay, az = tangent
    bx, by, bz = other
    farthest = 0.0
    for j in range(size):
        u = ax * x[j] + ay * y[j] + az * z[j]
        v = bx * x[j] + by * y[j] + bz * z[j]
        farthest = max(farthest, u * u + v * v)
    return farthest


@kernel
def _gradient(lower, u, v, first, second):
    """The inverse of L times the derivatives of the terms by u and by v."""
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
def _least(heights, size, n_best, work, keys):
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
    keys[0] = most
    return total + (n_best - n_less) * work[0]
