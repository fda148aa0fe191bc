"""Least eigenvalues of the trials of Algorithm 1 in any dimension, bounded from below; compiled."""

import numpy as np

from sklearn_mcmd.planes._moments_numba import FASTMATH, kth_smallest
from sklearn_mcmd.runtime._kernels import kernel


@kernel(cache=True)
def bound_trials(columns, sizes, n_support, trials, limits, room, out):
    """Fill `TrialBounds` of the minimal subsets of neighborhoods, columns (B, d, k)."""
    normals, offsets, bounds = out
    distance_step, rank_tolerance, least_ridge = limits
    matrix, order, keys, bits, member, moments = room
    n_sets, d, k = columns.shape
    for b in range(n_sets):
        size, x = sizes[b], columns[b]
        for t in range(len(trials)):
            normal, bounds[b, t] = normals[b, t], np.nan
            first = _fill_edges(x, trials[t], size, matrix)
            if first < 0 or not _find_normal(matrix, order, rank_tolerance, normal):
                continue
            offset = 0.0
            for axis in range(d):
                offset -= normal[axis] * x[axis, first]
            offsets[b, t] = offset
            _measure(x, size, normal, offset, keys)
            for j in range(size):
                # The distance in steps, and in the last digits the position, as `_nearest_members`.
                keys[j] = np.rint(abs(keys[j]) / distance_step) * k + j
            # Positive numbers sort like their bits.
            limit = kth_smallest(bits, size, n_support[b])
            for j in range(size):
                member[j] = 1.0 if bits[j] <= limit else 0.0
            _fill_moments(x, size, member, float(n_support[b]), moments, matrix)
            bounds[b, t] = _least_bound(matrix, least_ridge, moments)


@kernel
def _fill_edges(x, trial, size, matrix):
    """Fill the vectors from the first of a minimal subset to its others; returns the first, -1 of
    a trial that is too short."""
    d, n, first = len(x), 0, np.int64(-1)
    for position in trial:
        if position >= size:
            continue
        if first < 0:
            first = np.int64(position)
            continue
        for axis in range(d):
            matrix[n, axis] = x[axis, position] - x[axis, first]
        n += 1
        if n == d - 1:
            return first
    return np.int64(-1)


@kernel
def _find_normal(matrix, order, rank_tolerance, normal):
    """Fill the unit vector at right angles to d - 1 vectors; whether they surely span a plane.

    Gauss's elimination takes the largest number that is left, of all rows and axes, as pivot.
    """
    d, largest = matrix.shape[1], 0.0
    for axis in range(d):
        order[axis] = axis
    for step in range(d - 1):
        pivot, row, axis = 0.0, step, step
        for i in range(step, d - 1):
            for a in range(step, d):
                if abs(matrix[i, order[a]]) > pivot:
                    pivot, row, axis = abs(matrix[i, order[a]]), i, a
        largest = max(largest, pivot)
        if not pivot > rank_tolerance * largest:
            return False
        order[step], order[axis] = order[axis], order[step]
        for a in range(d):
            matrix[step, a], matrix[row, a] = matrix[row, a], matrix[step, a]
        for i in range(step + 1, d - 1):
            factor = matrix[i, order[step]] / matrix[step, order[step]]
            for a in range(step, d):
                matrix[i, order[a]] -= factor * matrix[step, order[a]]
    square = normal[order[d - 1]] = 1.0
    for step in range(d - 2, -1, -1):
        total = 0.0
        for a in range(step + 1, d):
            total += matrix[step, order[a]] * normal[order[a]]
        normal[order[step]] = value = -total / matrix[step, order[step]]
        square += value * value
    for axis in range(d):
        normal[axis] /= np.sqrt(square)
    return True


@kernel(fastmath=FASTMATH)
def _measure(x, size, normal, offset, distances):
    for j in range(size):
        distances[j] = offset
    for axis in range(len(x)):
        for j in range(size):
            distances[j] += normal[axis] * x[axis, j]


@kernel(fastmath=FASTMATH)
def _fill_moments(x, size, member, n, means, covariance):
    """Fill the means and the lower half of the covariance of the members."""
    for a in range(len(x)):
        total = 0.0
        for j in range(size):
            total += member[j] * x[a, j]
        means[a] = total / n
        for c in range(a + 1):
            total = 0.0
            for j in range(size):
                total += member[j] * x[a, j] * x[c, j]
            covariance[a, c] = total / n - means[a] * means[c]


@kernel
def _least_bound(covariance, least_ridge, column):
    """What the least eigenvalue is not below: one over the sum of the inverses of all.

    That is the squared norm of the inverse of Cholesky's factor; the ridge is above rounding.
    """
    d, trace, total = len(covariance), 0.0, 0.0
    for a in range(d):
        trace += covariance[a, a]
    ridge = least_ridge * max(trace, 1e-200)  # above zero for points in one place, too
    for a in range(d):
        covariance[a, a] += ridge
        for c in range(a + 1):
            value = covariance[a, c]
            for e in range(c):
                value -= covariance[a, e] * covariance[c, e]
            if c < a:
                covariance[a, c] = value / covariance[c, c]
            elif value > 0.0:
                covariance[a, a] = np.sqrt(value)
            else:
                return -np.inf
    for c in range(d):  # the columns of the inverse
        for a in range(c, d):
            value = 1.0 if a == c else 0.0
            for e in range(c, a):
                value -= covariance[a, e] * column[e]
            column[a] = value / covariance[a, a]
            total += column[a] * column[a]
    return 1.0 / total - 2.0 * ridge
