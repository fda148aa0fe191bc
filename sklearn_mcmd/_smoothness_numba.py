"""The smoothness of ``_smoothness`` in three dimensions, compiled."""

import numpy as np
from numba import njit

from sklearn_mcmd._plane_numba import FASTMATH, eigh_3d, weighted_covariance
from sklearn_mcmd._smoothness import (
    AS_FLAT,
    FARTHEST,
    LEAST_GEARY,
    LEAST_KURTOSIS,
    LEAST_WIDTH,
    MIDDLE,
    MOST_IN_MIDDLE,
    MOST_SKEW,
    PERFECT,
    PIVOT,
)

__all__ = ["whole_planes_3d"]

TERMS = 6


@njit(cache=True, nogil=True, error_model="numpy")
def whole_planes_3d(
    points, indices, sizes, centroids, eigenvalues, normals, directions, deviation, left, ordinary
):  # fmt: skip
    """Fill what `whole_planes` returns, of the axes the first and the last."""
    k = indices.shape[1]
    local, weight, height = np.empty((3, k)), np.ones(k), np.empty(k)
    terms, moments = np.empty(TERMS), np.empty((TERMS, TERMS))
    right, forward = np.empty(TERMS), np.empty(TERMS)
    for i in range(len(indices)):
        size = sizes[i]
        first = indices[i, 0]
        for j in range(size):
            for axis in range(3):
                local[axis, j] = points[indices[i, j], axis] - points[first, axis]
        mean, covariance = weighted_covariance(local, size, weight)
        values, axes = eigh_3d(covariance)
        for axis in range(3):
            centroids[i, axis] = points[first, axis] + mean[axis]
            eigenvalues[i, axis] = values[axis]
            normals[i, axis] = axes[0][axis]
            directions[i, axis] = axes[2][axis]
        extent = np.sqrt(values[2])
        deviation[i] = left[i] = np.inf
        ordinary[i] = False
        if size < 2 * TERMS or extent == 0.0:
            continue
        total = _moments(local, size, mean, axes, extent, terms, moments, right, height)
        squares, determined = _residual(moments, right, forward, total)
        plane = np.sqrt(total / (size - 3))
        deviation[i] = plane * extent
        if not determined:
            continue
        quadric = np.sqrt(squares / (size - TERMS))
        left[i] = quadric * extent
        if values[1] <= LEAST_WIDTH**2 * values[2]:
            continue
        if plane <= PERFECT:
            ordinary[i] = True
        elif plane <= AS_FLAT * quadric:
            variance = total / size
            tails = _tails(height, size, MIDDLE**2 * variance)
            n_inside, total_height, third, fourth, farthest = tails
            ordinary[i] = (
                farthest <= FARTHEST**2 * variance
                and n_inside <= MOST_IN_MIDDLE * size
                and total_height / size >= LEAST_GEARY * np.sqrt(variance)
                and abs(third) / size <= MOST_SKEW * variance**1.5
                and fourth / size >= LEAST_KURTOSIS * variance**2
            )


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def _tails(height, size, middle):
    """Members in the middle, sums of first, third and fourth powers, and the largest square."""
    n_inside = first = third = fourth = farthest = 0.0
    for j in range(size):
        square = height[j] * height[j]
        n_inside += 1.0 if square <= middle else 0.0
        first += abs(height[j])
        third += square * height[j]
        fourth += square * square
        farthest = max(farthest, square)
    return n_inside, first, third, fourth, farthest


@njit(cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def _moments(local, size, mean, axes, extent, terms, moments, right, heights):
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
        heights[j] = height
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
