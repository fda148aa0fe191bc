"""Smooth neighborhoods, which keep all their members: their curvature is no contamination.

On a curved surface that is measured better than it bends within a neighborhood, the points away
from the majority's plane look like outliers, and a plane fitted to the rest leans. So a
neighborhood is first asked whether one smooth surface, a quadric over the plane of all members,
explains it as well as the robust plane explains its own part. An edge is not explained so.
The NumPy form, for any dimension; ``_smoothness_numba`` repeats it in three.
"""

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import fdtri, ndtr, ndtri

from sklearn_mcmd.planes._plane import fit_planes

__all__ = ["SmoothnessLimits", "is_smooth", "least_members", "whole_planes"]

# A quadric leaves hardly more than the robust plane's scale, which curvature has inflated. At a
# sharp crease it leaves far more: the scale there is the noise. A blunt one may get past this; that
# the quadric leaves more there than next to it shows later, see `SurfacePlanes`.
CURVED = 1.2
# What deviates more from its plane, as a share of its width (standard deviations), is a post or a
# sharp edge, whatever a quadric leaves.
MOST_BENT = 0.5
# A quadric that the members don't determine, as on two scan lines, explains nothing.
PIVOT = 1e-6
# A neighborhood is ordinary, and no robust plane need be sought, if no test of normality sees more
# than noise about the plane of all members. Each test allows so many standard errors.
N_ERRORS = 1.5
# Narrower strips tell nothing about their plane, in standard deviations of width to length.
LEAST_WIDTH = 0.05
# Deviation from the plane to length that is rounding.
PERFECT = 1e-9
# Mean absolute value of a standard normal variable, and the standard deviation of that of a sample
# in its own standard deviations, times the root of its size.
GEARY, GEARY_DEVIATION = sqrt(2 / pi), sqrt(1 - 3 / pi)


class SmoothnessLimits(NamedTuple):
    """What `whole_planes` allows, by the size of a neighborhood, 0 ... k.

    Heights above the plane of all members, in their standard deviations, are like those of a normal
    sample if

    - a quadric takes no more off their squares than chance does (`most_ratio`, by the F test),
    - none is farther off than `farthest`,
    - the mean of their cubes is at most `most_skew`: members of another face make them skew,
    - their mean differs from a normal sample's, 0.798, by no more than `geary` (Geary's ratio):
      outliers make it less, two planes or one that runs across both make it more.
    """

    most_ratio: np.ndarray  # ratio of the plane's standard deviation to the quadric's
    farthest: np.ndarray
    most_skew: np.ndarray
    geary: np.ndarray
    geary_of_normal: float
    pivot: float
    least_width: float
    perfect: float

    @classmethod
    def of(cls, k, d):
        """The limits for neighborhoods of up to k members in d dimensions."""
        n = np.maximum(np.arange(k + 1), least_members(d)).astype(float)
        chance = ndtr(-N_ERRORS)  # that a normal sample fails one of the tests
        n_terms = least_members(d) // 2
        left = n - n_terms
        gained = fdtri(n_terms - d, left, 1 - chance)
        return cls(
            most_ratio=np.sqrt((left + (n_terms - d) * gained) / (n - d)),
            farthest=ndtri(1 - chance / (2 * n)),
            most_skew=N_ERRORS * np.sqrt(6 * (n - 2) / ((n + 1) * (n + 3))),
            geary=N_ERRORS * GEARY_DEVIATION / np.sqrt(n),
            geary_of_normal=GEARY,
            pivot=PIVOT,
            least_width=LEAST_WIDTH,
            perfect=PERFECT,
        )


def least_members(d):
    """Fewest members for a quadric to have left something to explain."""
    return 2 * (1 + (d - 1) + d * (d - 1) // 2)


def is_smooth(deviation, left, eigenvalues, scale):
    """Whether neighborhoods with robust planes of a scale keep all members: bool (B,).

    `deviation`, `left` and `eigenvalues` are as by `whole_planes`.
    """
    width = np.sqrt(eigenvalues[:, min(1, eigenvalues.shape[1] - 1)])
    smooth = (left <= CURVED * scale) & (deviation <= MOST_BENT * width)
    return smooth & np.isfinite(deviation) & (scale > 0)


def whole_planes(neighborhoods, sizes):
    """Planes of all members, and what a quadric over them leaves.

    Parameters
    ----------
    neighborhoods : ndarray of shape (B, k, d)
    sizes : ndarray of int of shape (B,)

    Returns
    -------
    centroids, eigenvalues, axes : as by `fit_planes`
    deviation : ndarray of shape (B,)
        Standard deviation of the members from the plane; inf where these are too few.
    left : ndarray of shape (B,)
        From the quadric; inf where the members do not determine it.
    ordinary : ndarray of bool of shape (B,)
        Whether noise about the plane is all there is.
    """
    _, k, d = neighborhoods.shape
    valid = np.arange(k) < sizes[:, None]
    centroids, eigenvalues, axes = fit_planes(neighborhoods, valid)
    extent = np.sqrt(np.maximum(eigenvalues[:, -1:], np.finfo(float).tiny))
    local = np.matmul((neighborhoods - centroids[:, None]) / extent[:, None], axes)
    local *= valid[..., None]
    height, flat = local[..., 0], local[..., 1:]
    pairs = [(i, j) for i in range(d - 1) for j in range(i, d - 1)]
    columns = [valid.astype(float), *np.moveaxis(flat, -1, 0)]
    columns += [flat[..., i] * flat[..., j] for i, j in pairs]
    design = np.stack(columns, axis=-1)
    total = np.square(height).sum(axis=1)
    squares, determined = _residual(design, height, total)
    enough, extent = sizes >= least_members(d), extent[:, 0]
    deviation = np.sqrt(total / np.maximum(sizes - d, 1))
    left = np.sqrt(squares / np.maximum(sizes - len(columns), 1))
    variance = total / sizes
    limits = SmoothnessLimits.of(k, d)
    with np.errstate(divide="ignore", invalid="ignore"):
        skew = (height**3).sum(axis=1) / sizes / variance**1.5
        geary = np.abs(height).sum(axis=1) / sizes / np.sqrt(variance)
    ordinary = deviation <= limits.most_ratio[sizes] * left
    ordinary &= np.abs(skew) <= limits.most_skew[sizes]
    ordinary &= np.abs(geary - GEARY) <= limits.geary[sizes]
    ordinary &= np.square(height).max(axis=1) <= np.square(limits.farthest[sizes]) * variance
    ordinary |= deviation <= PERFECT
    wide = eigenvalues[:, min(1, d - 1)] > LEAST_WIDTH**2 * eigenvalues[:, -1]
    ordinary &= enough & determined & wide
    deviation = np.where(enough, deviation * extent, np.inf)
    left = np.where(enough & determined, left * extent, np.inf)
    return centroids, eigenvalues, axes, deviation, left, ordinary


def _residual(design, height, total):
    """Squares that least squares leaves, by Cholesky's decomposition of all rows at once."""
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
    return np.maximum(total - np.square(forward).sum(axis=1), 0.0), determined
