"""Quadrics over planes: what they leave of noise, and which neighborhoods are smooth.

Smooth neighborhoods keep all their members: curvature is no contamination. On a curved surface the
noise can be smaller than the bend within a neighborhood. Then the points off the majority's plane
look like outliers, and a plane fitted to the rest leans. So a test comes first: does one smooth
surface, a quadric over the plane of all members, explain the neighborhood as well as the robust
plane explains the members that it keeps? It does not at an edge.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, fdtri, ndtr, ndtri

from sklearn_mcmd.runtime._compiling import compiled_function

GEARY = sqrt(2 / pi)  # mean absolute value of a standard normal variable
# The mean absolute value of a sample, in its own standard deviations, has this standard deviation
# over the root of the sample size.
GEARY_DEVIATION = sqrt(1 - 3 / pi)


class QuadricLimits(NamedTuple):
    """What determines a quadric, and what is more than noise about it."""

    # Least pivot of the equations. With less, as on two scan lines, nothing determines the quadric.
    pivot: float = 1e-6
    chance: float = 0.1  # what noise makes in no more than this share of cases is no noise


class SmoothnessLimits(NamedTuple):
    """Which neighborhoods are smooth, and which have no more than noise about their plane."""

    # Largest ratio of the quadric's standard deviation to the robust plane's scale. Curvature
    # enlarges that scale, so on a smooth surface the ratio is about 1. At a sharp crease the scale
    # is the noise, and the quadric leaves far more. A blunt crease may pass; `SurfacePlanes` finds
    # it later, because the quadric leaves more at the crease than next to it.
    curved: float = 1.2
    # Standard errors that each test of normality allows. An ordinary neighborhood passes them all.
    n_errors: float = 1.5


class NormalSample(NamedTuple):
    """What heights of noise have at most, by the size of a neighborhood, 0 ... k.

    Heights above the plane of all members, in their standard deviations, are like those of a normal
    sample if

    - a quadric reduces their squares by no more than chance does (`most_ratio`, by the F test),
    - no absolute height is larger than `farthest`,
    - the mean of their cubes is at most `most_skew` (members of another face make them skew),
    - their mean absolute value differs from a normal sample's, 0.798, by at most `geary` (Geary's
      ratio). Outliers make it smaller. Two planes, or one plane across both, make it larger.
    """

    most_ratio: np.ndarray  # ratio of the plane's standard deviation to the quadric's
    farthest: np.ndarray
    most_skew: np.ndarray
    geary: np.ndarray
    geary_of_normal: float
    pivot: float

    @classmethod
    def of(cls, k, d):
        """For neighborhoods of up to k members in d dimensions."""
        n_errors = SmoothnessLimits().n_errors
        n = np.maximum(np.arange(k + 1), least_members(d)).astype(float)
        chance = ndtr(-n_errors)  # probability that a normal sample fails one of the tests
        terms = n_terms(d)
        left = n - terms
        gained = fdtri(terms - d, left, 1 - chance)
        return cls(
            most_ratio=np.sqrt((left + (terms - d) * gained) / (n - d)),
            farthest=ndtri(1 - chance / (2 * n)),
            most_skew=n_errors * np.sqrt(6 * (n - 2) / ((n + 1) * (n + 3))),
            geary=n_errors * GEARY_DEVIATION / np.sqrt(n),
            geary_of_normal=GEARY,
            pivot=QuadricLimits().pivot,
        )


def n_terms(d):
    """Number of terms of a quadric over a plane."""
    return 1 + (d - 1) + d * (d - 1) // 2


def least_members(d):
    """Least number of members at which a quadric leaves as many degrees of freedom as it takes."""
    return 2 * n_terms(d)


def noise_quantiles(share, sizes, d):
    """What quadrics leave of neighborhoods of noise of one, at most, in a share of cases: (m,).

    The least of many deviations is small by chance. Divided by this, it is the noise.
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


def is_smooth(left, scale):
    """Whether neighborhoods keep all members, given the scale of their robust planes: bool (B,).

    `left` is that of `whole_planes`.
    """
    return (left <= SmoothnessLimits().curved * scale) & np.isfinite(left) & (scale > 0)


def whole_planes(points, around, planes, directions):
    """Fill planes of all members, and find whether quadrics over them leave noise alone.

    Centroids, eigenvalues and normals of `planes` are filled, and `directions` (m, d) with the axes
    of the largest eigenvalues. The points (n, d) are in 2D or 3D.

    Returns the standard deviations (m,) of the members from the plane, inf if they are too few, and
    from the quadric, inf if they do not determine it; and whether the members deviate from the
    plane by noise alone, bool (m,).
    """
    m, k = around.indices.shape
    limits, (arrays, equations) = NormalSample.of(k, points.shape[1]), work_arrays(4, k)
    room = arrays[:3], arrays[3], np.ones(k), *equations
    found = np.empty(m), np.empty(m), np.empty(m, dtype=bool)
    fit = compiled_function("normals._quadrics_numba", "fit_whole_planes")
    fit(points, around, limits, room, planes, directions, *found)
    return found


def work_arrays(rows, k):
    """Rows of one array for numbers of k members; and arrays for the equations of a quadric.

    Python makes the arrays, since Numba takes long to compile what makes them.
    """
    terms = n_terms(3)
    equations = np.empty((terms + 2, terms))
    return np.zeros((rows, k)), (equations[:terms], equations[terms], equations[terms + 1])
