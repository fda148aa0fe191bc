"""Quadrics over planes, fitted by least squares: equations and solutions.

This NumPy form works in any dimension; ``_quadrics_numba`` repeats it in three.
"""

import numpy as np
from scipy.special import chdtri

__all__ = [
    "PIVOT",
    "back_substituted",
    "decompose",
    "least_members",
    "n_terms",
    "noise_quantiles",
    "quadric_terms",
    "tangents_of",
]

# Least pivot of the quadric's equations. With less, as on two scan lines, the members do not
# determine the quadric.
PIVOT = 1e-6


def n_terms(d):
    """Number of terms of a quadric over a plane."""
    return 1 + (d - 1) + d * (d - 1) // 2


def least_members(d):
    """Least number of members at which a quadric leaves as many degrees of freedom as it takes."""
    return 2 * n_terms(d)


def noise_quantiles(share, sizes, d):
    """What quadrics leave of neighborhoods of noise of one, at most, in a share of cases: (m,).

    The least of many deviations is small by chance. Divided by this, it tells the noise.
    """
    quantiles = np.ones(int(np.max(sizes, initial=0)) + 1)
    counts = np.flatnonzero(np.bincount(sizes))
    freedom = counts - n_terms(d)
    counts, freedom = counts[freedom > 0], freedom[freedom > 0]
    quantiles[counts] = np.sqrt(chdtri(freedom, 1 - share) / freedom)
    return quantiles[sizes]


def quadric_terms(flat):
    """The terms of a quadric, 1, u, v, uu, uv and vv in 3D, of coordinates (..., d - 1)."""
    d = flat.shape[-1]
    columns = [np.ones_like(flat[..., 0]), *np.moveaxis(flat, -1, 0)]
    columns += [flat[..., i] * flat[..., j] for i in range(d) for j in range(i, d)]
    return np.stack(columns, axis=-1)


def decompose(design, height):
    """Cholesky's decomposition L of the normal equations of quadrics, of all rows at once.

    Parameters
    ----------
    design : ndarray of shape (B, k, terms)
    height : ndarray of shape (B, k)

    Returns
    -------
    lower : ndarray of shape (B, terms, terms)
        L.
    forward : ndarray of shape (B, terms)
        The inverse of L times the right side. The quadric explains the sum of its squares.
    determined : ndarray of bool of shape (B,)
        Whether the members determine the quadric.
    """
    matrix = np.swapaxes(design, -1, -2) @ design
    right = np.einsum("bki,bk->bi", design, height)
    size = matrix.shape[-1]
    lower = np.zeros_like(matrix)
    forward = np.zeros_like(right)
    determined = np.ones(len(matrix), dtype=bool)
    for i in range(size):
        for j in range(i):
            dot = np.einsum("bm,bm->b", lower[:, i, :j], lower[:, j, :j])
            lower[:, i, j] = (matrix[:, i, j] - dot) / lower[:, j, j]
        pivot = matrix[:, i, i] - np.square(lower[:, i, :i]).sum(axis=1)
        good = pivot > PIVOT * matrix[:, i, i]
        determined &= good
        lower[:, i, i] = np.sqrt(np.where(good, pivot, 1.0))
        dot = np.einsum("bm,bm->b", lower[:, i, :i], forward[:, :i])
        forward[:, i] = (right[:, i] - dot) / lower[:, i, i]
    return lower, forward, determined


def back_substituted(lower, forward):
    """Solutions (m, i) of L' x = forward."""
    solution = np.zeros_like(forward)
    for i in reversed(range(forward.shape[1])):
        dot = np.einsum("mj,mj->m", lower[:, i + 1 :, i], solution[:, i + 1 :])
        solution[:, i] = (forward[:, i] - dot) / lower[:, i, i]
    return solution


def tangents_of(normals):
    """Unit vectors at right angles to each normal and to each other: (m, d - 1, d)."""
    d = normals.shape[1]
    last = normals[:, -1]
    mirror = normals.copy()
    mirror[:, -1] += np.copysign(1.0, last)
    shares = normals[:, :-1] / (1.0 + np.abs(last))[:, None]
    tangents = -shares[:, :, None] * mirror[:, None, :]
    tangents[:, np.arange(d - 1), np.arange(d - 1)] += 1.0
    return tangents
