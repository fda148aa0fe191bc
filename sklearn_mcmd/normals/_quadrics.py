"""Quadrics over planes: how many members they take, and what they leave of noise."""

import numpy as np
from scipy.special import chdtri

__all__ = ["CHANCE", "PIVOT", "least_members", "n_terms", "noise_quantiles", "tangents_of"]

# Least pivot of the quadric's equations. With less, as on two scan lines, the members do not
# determine the quadric.
PIVOT = 1e-6
# Noise is what explains as much in this share of cases. What it makes less often is no noise.
CHANCE = 0.1


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
