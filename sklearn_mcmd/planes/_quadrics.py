"""Quadrics over planes: what they leave of noise, and which neighborhoods are smooth.

Smooth neighborhoods keep all their members: curvature is no contamination. On a curved surface the
noise can be smaller than the bend within a neighborhood. Then the points off the majority's plane
look like outliers, and a plane fitted to the rest leans. So a test comes first: does one smooth
surface, a quadric over the plane of all members, explain the neighborhood as well as the robust
plane explains the members that it keeps? It does not at an edge.

A quadric and two planes have the same number of parameters. At a bend the quadric leaves less, at a
fold the planes do. Of a surface that bends, the normal is that of the quadric at the point, and not
that of the plane of all members: beside an end of a fillet this leans.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, fdtri, ndtr, ndtri

from sklearn_mcmd.planes._principal_planes import student_factors
from sklearn_mcmd.planes._record import Planes
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


class FoldLimits(NamedTuple):
    """When a neighborhood is folded."""

    # Least ratio of squares that the quadric leaves to those of two planes. Below 1, as these are
    # asked where the quadric already leaves more than is usual around.
    evidence: float = 0.6
    best: float = 0.75  # share of the members whose squares count, as others may be outliers
    # Members farther from the robust plane than this number of its standard deviations are what the
    # second plane is fitted to first.
    off: float = 1.5


class NormalSample(NamedTuple):
    """What heights above the plane of all members, in their standard deviations, have at most if
    they are noise, by the size of a neighborhood, 0 ... k."""

    most_ratio: np.ndarray  # of the plane's standard deviation to the quadric's, by the F test
    farthest: np.ndarray  # absolute height
    most_skew: np.ndarray  # mean of the cubes; members of another face make it larger
    # Difference of the mean absolute height from a normal sample's (Geary's ratio): outliers make
    # it smaller; two planes, or one plane across both, make it larger.
    geary: np.ndarray
    geary_of_normal: float
    pivot: float

    @classmethod
    def of(cls, k, d):
        """For neighborhoods of up to k members in d dimensions."""
        n_errors = SmoothnessLimits().n_errors
        terms = n_terms(d)
        # A quadric is to leave as many degrees of freedom as it takes.
        n = np.maximum(np.arange(k + 1), 2 * terms).astype(float)
        chance = ndtr(-n_errors)  # probability that a normal sample fails one of the tests
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


class QuadricFit(NamedTuple):
    """What planes of all members, and quadrics over them, leave of m neighborhoods."""

    # Standard deviations (m,), in units of the points:
    deviation: np.ndarray  # of the members from the plane, inf if they are too few
    left: np.ndarray  # from the quadric, inf if they do not determine it
    ordinary: np.ndarray  # bool (m,): whether they deviate from the plane by noise alone


def n_terms(d):
    """Number of terms of a quadric over a plane."""
    return 1 + (d - 1) + d * (d - 1) // 2


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
    # The reflection that turns the last axis into the normal turns the others into tangents.
    last = normals[:, -1]
    mirror = normals.copy()
    mirror[:, -1] += np.copysign(1.0, last)
    shares = normals[:, :-1] / (1.0 + np.abs(last))[:, None]
    tangents = -shares[:, :, None] * mirror[:, None, :]
    tangents[:, np.arange(d - 1), np.arange(d - 1)] += 1.0
    return tangents


def is_smooth(left, scale):
    """Whether neighborhoods keep all members, given the scale of their robust planes: bool (B,).

    `left` is that of `QuadricFit`.
    """
    return (left <= SmoothnessLimits().curved * scale) & np.isfinite(left) & (scale > 0)


def whole_planes(points, around):
    """Planes of all members, and whether quadrics over them leave noise alone.

    The points (n, d) are in 2D or 3D. Of the planes centroids, eigenvalues and normals are filled.
    Returns also the axes (m, d) of the largest eigenvalues, and the `QuadricFit`.
    """
    (m, k), d = around.indices.shape, points.shape[1]
    planes, directions = Planes.empty(m, d), np.empty((m, d))
    limits, (arrays, equations) = NormalSample.of(k, d), work_arrays(4, k)
    room = arrays[:3], arrays[3], np.ones(k), *equations
    out = QuadricFit(np.empty(m), np.empty(m), np.empty(m, dtype=bool))
    fit = compiled_function("planes._quadrics_numba", "fit_whole_planes")
    fit(points, around, limits, room, planes, directions, out)
    return planes, directions, out


def are_folded(points, around, planes, faces):
    """Whether two planes leave less of neighborhoods than a quadric does: bool (m,).

    `planes` are those of all members, and `faces` the robust planes, each of the majority of the
    members. The points (n, d) are in 2D or 3D.
    """
    folded = np.empty(len(around.sizes), dtype=bool)
    k = around.indices.shape[1]
    arrays, equations = work_arrays(9, k)
    keys, sides = arrays.view(np.int64)[8], np.empty((3, k), dtype=bool)
    room = arrays[:3], arrays[3:5], *arrays[5:], keys, sides, equations
    find = compiled_function("planes._creases_numba", "find_folded")
    find(points, around, planes, faces, FoldLimits(), room, folded)
    return folded


def quadric_normals(points, queries, around, planes, left):
    """Tangent planes of quadrics at queries (m, d), in 2D or 3D: normals, centroids and errors.

    `planes` are those of all members, which stay where they determine no quadric, with an error of
    90. `left` (m,) is the standard deviation of the members from their quadric.

    The centroids (m, d) are the points of the quadrics nearest to the queries, along the normals of
    the planes, but no farther off the mean, in the plane, than the farthest member.
    """
    m, d = queries.shape
    normals, centroids, tilt = np.empty((m, d)), np.empty((m, d)), np.empty(m)
    arrays, equations = work_arrays(4, around.indices.shape[1])
    room = arrays[:3], arrays[3], *equations, *np.empty((2, n_terms(3)))
    find = compiled_function("planes._quadrics_numba", "find_quadric_normals")
    tangents, pivot = tangents_of(planes.normals), QuadricLimits().pivot
    out = normals, centroids, tilt
    find(points, queries, around, planes, tangents, pivot, room, out)
    freedom = around.sizes - n_terms(d)
    with np.errstate(invalid="ignore"):
        errors = np.degrees(tilt * left) * student_factors(freedom, d)
    return normals, centroids, np.where(errors <= 90.0, errors, 90.0)


def work_arrays(rows, k):
    """Rows of one array for numbers of k members; and arrays for the equations of a quadric.

    Python makes the arrays, since Numba takes long to compile what makes them.
    """
    terms = n_terms(3)
    equations = np.empty((terms + 2, terms))
    return np.zeros((rows, k)), (equations[:terms], equations[terms], equations[terms + 1])
