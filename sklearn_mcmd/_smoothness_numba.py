"""The smoothness of ``_smoothness`` in three dimensions, compiled."""

import numpy as np
from numba import njit

from sklearn_mcmd._plane_numba import FASTMATH, eigh_3d, weighted_covariance
from sklearn_mcmd._smoothness import ALL_FLAT, CURVED, PIVOT, QUADRIC

__all__ = ["smooth_planes_3d"]

TERMS = 6


@njit(cache=True, nogil=True, error_model="numpy")
def smooth_planes_3d(
    points, indices, sizes, scale, smooth, centroids, eigenvalues, normals, directions, deviation,
    left,
):  # fmt: skip
    """Fill the planes of all members where they make a smooth surface; see `smooth_planes`."""
    k = indices.shape[1]
    local, weight = np.empty((3, k)), np.ones(k)
    terms, moments = np.empty(TERMS), np.empty((TERMS, TERMS))
    right, forward = np.empty(TERMS), np.empty(TERMS)
    for i in range(len(indices)):
        size = sizes[i]
        smooth[i] = False
        if size < 2 * TERMS or scale[i] <= 0.0:
            continue
        first = indices[i, 0]
        for j in range(size):
            for axis in range(3):
                local[axis, j] = points[indices[i, j], axis] - points[first, axis]
        mean, covariance = weighted_covariance(local, size, weight)
        values, axes = eigh_3d(covariance)
        extent = np.sqrt(values[2])
        if extent == 0.0:
            continue
        total = _moments(local, size, mean, axes, extent, terms, moments, right)
        noise = (scale[i] / extent) ** 2
        plane = total / max(size - 3, 1)
        squares, determined = _residual(moments, right, forward, total)
        quadric = squares / max(size - TERMS, 1)
        curved = determined and (quadric <= CURVED**2 * noise or quadric <= QUADRIC * plane)
        if not (curved or plane <= ALL_FLAT**2 * noise):
            continue
        smooth[i] = True
        deviation[i] = np.sqrt(plane) * extent
        left[i] = np.sqrt(min(quadric, plane) if determined else plane) * extent
        for axis in range(3):
            centroids[i, axis] = points[first, axis] + mean[axis]
            eigenvalues[i, axis] = values[axis]
            normals[i, axis] = axes[0][axis]
            directions[i, axis] = axes[2][axis]


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def _moments(local, size, mean, axes, extent, terms, moments, right):
    """Normal equations of the quadric (lower triangle) and the sum of squared heights."""
    moments[:] = 0.0
    right[:] = 0.0
    total = 0.0
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = axes
    scale = 1.0 / extent
    for j in range(size):
        x, y, z = local[0, j] - mean[0], local[1, j] - mean[1], local[2, j] - mean[2]
        height = (ax * x + ay * y + az * z) * scale
        u = (bx * x + by * y + bz * z) * scale
        v = (cx * x + cy * y + cz * z) * scale
        total += height * height
        terms[0], terms[1], terms[2] = 1.0, u, v
        terms[3], terms[4], terms[5] = u * u, u * v, v * v
        for a in range(TERMS):
            right[a] += terms[a] * height
            for b in range(a + 1):
                moments[a, b] += terms[a] * terms[b]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _residual(moments, right, forward, total):
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
        if not pivot > PIVOT * diagonal:
            return total, False
        moments[i, i] = np.sqrt(pivot)
        forward[i] = value / moments[i, i]
        total -= forward[i] * forward[i]
    return max(total, 0.0), True
