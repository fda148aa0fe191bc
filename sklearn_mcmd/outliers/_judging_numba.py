"""The verdicts of ``_judging``, compiled: one neighborhood after another, any dimension."""

import numpy as np
from numba import njit

from sklearn_mcmd.outliers._judging import COMMON, HALF, OWN, QUARTER, SURFACE
from sklearn_mcmd.planes._around_numba import quantile
from sklearn_mcmd.planes._explaining import LEAST_KEPT, MOST_SPARSE

__all__ = ["judge_neighborhoods"]

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
        usual_spacing[i] = quantile(all_spacing, neighbors, size, HALF, values, keys)
        owners[i] = -1
        if ruler == OWN:
            scores[i] = distance[i]
        else:
            sigma = noise
            if ruler != COMMON:
                around = quantile(all_radius, neighbors, size, HALF, values, keys)
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
                    least = quantile(all_scale, neighbors, size, QUARTER, values, keys)
                    sigma = max(scale[i], least)
                else:
                    usual = quantile(all_scale, neighbors, size, HALF, values, keys)
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


@njit(cache=True, nogil=True, error_model="numpy")
def _ratio(numerator, denominator):
    quotient = numerator / denominator
    if np.isnan(quotient):
        return 0.0
    return min(quotient, LARGEST)
