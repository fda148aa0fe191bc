"""The verdicts of ``_judging``, compiled: one neighborhood after another, any dimension."""

import numpy as np
from numba import njit

from sklearn_mcmd._borrowing import LEAST_KEPT, MOST_SPARSE
from sklearn_mcmd._judging import COMMON, HALF, OWN, QUARTER, SURFACE
from sklearn_mcmd._plane_numba import kth_smallest

__all__ = ["extents_of_neighborhoods", "judge_neighborhoods", "quantile_of_neighbors"]

LARGEST = np.finfo(np.float64).max


@njit(cache=True, nogil=True, error_model="numpy")
def judge_neighborhoods(
    queries, distance, scale, centroids, normals, removed, radius, least_scale, indices, sizes,
    all_centroids, all_normals, all_scale, all_spacing, all_radius, all_credible,
    ruler, noise, cutoff, borrow, most_rough, scores, owners, usual_spacing,
):  # fmt: skip
    """Fill scores, owners and usual_spacing; see `judge`."""
    values = np.empty(indices.shape[1])
    keys = values.view(np.int64)
    d = queries.shape[1]
    for i in range(len(queries)):
        neighbors, size = indices[i], sizes[i]
        usual_spacing[i] = _quantile(all_spacing, neighbors, size, HALF, values, keys)
        owners[i] = -1
        if ruler == OWN:
            scores[i] = distance[i]
        else:
            sigma = noise
            if ruler != COMMON:
                around = _quantile(all_radius, neighbors, size, HALF, values, keys)
                n_credible = 0
                for j in range(size):
                    n_credible += all_credible[neighbors[j]]
                on_surface = n_credible >= SURFACE * size
                credible = (
                    scale[i] <= most_rough * radius[i]
                    and radius[i] <= MOST_SPARSE * around
                    and removed[i] <= 1.0 - LEAST_KEPT
                )
                if on_surface and credible:
                    least = _quantile(all_scale, neighbors, size, QUARTER, values, keys)
                    sigma = max(scale[i], least)
                else:
                    usual = _quantile(all_scale, neighbors, size, HALF, values, keys)
                    sigma = min(scale[i], usual) if on_surface else max(scale[i], usual)
            own = 0.0
            for axis in range(d):
                own += (queries[i, axis] - centroids[i, axis]) * normals[i, axis]
            scores[i] = _ratio(abs(own), max(sigma, least_scale[i]))
        if borrow and scores[i] > cutoff:
            for j in range(size):
                row = neighbors[j]
                if not all_credible[row]:
                    continue
                height = reach = 0.0
                for axis in range(d):
                    deviation = queries[i, axis] - all_centroids[row, axis]
                    height += deviation * all_normals[row, axis]
                    reach += deviation * deviation
                if np.sqrt(reach) <= all_radius[row]:
                    sigma = noise if ruler == COMMON else all_scale[row]
                    borrowed = abs(height) / max(sigma, least_scale[i])
                    if borrowed < scores[i]:
                        scores[i], owners[i] = borrowed, row


@njit(cache=True, nogil=True)
def quantile_of_neighbors(all_values, indices, sizes, q, out):
    """Fill `out` with the q-quantile of the neighbors' values."""
    values = np.empty(indices.shape[1])
    keys = values.view(np.int64)
    for i in range(len(out)):
        out[i] = _quantile(all_values, indices[i], sizes[i], q, values, keys)


@njit(cache=True, nogil=True)
def extents_of_neighborhoods(points, queries, indices, sizes, spacing, radius):
    """Fill the mean distance of the neighbors and that of the last."""
    for i in range(len(queries)):
        total = last = 0.0
        for j in range(sizes[i]):
            square = 0.0
            for axis in range(queries.shape[1]):
                gap = points[indices[i, j], axis] - queries[i, axis]
                square += gap * gap
            total += np.sqrt(square)
            last = max(last, square)
        spacing[i], radius[i] = total / sizes[i], np.sqrt(last)


@njit(cache=True, nogil=True)
def _quantile(all_values, neighbors, size, q, values, keys):
    """The value at the rank int(q * size), from 0, of numbers that are not negative.

    Their bits, which `keys` shares with `values`, are in their order.
    """
    for j in range(size):
        values[j] = all_values[neighbors[j]]
    keys[0] = kth_smallest(keys, size, int(q * size) + 1)
    return values[0]


@njit(cache=True, nogil=True, error_model="numpy")
def _ratio(numerator, denominator):
    quotient = numerator / denominator
    if np.isnan(quotient):
        return 0.0
    return min(quotient, LARGEST)
