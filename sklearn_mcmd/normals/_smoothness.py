"""Smooth neighborhoods, which keep all their members: their curvature is no contamination.

On a curved surface that is measured better than it bends within a neighborhood, the points away
from the majority's plane look like outliers, and a plane fitted to the rest leans. So a
neighborhood is first asked whether one smooth surface, a quadric over the plane of all members,
explains it as well as the robust plane explains its own part. An edge is not explained so.
The NumPy form, for any dimension; ``_smoothness_numba`` repeats it in three.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._plane import fit_planes

__all__ = ["LIMITS", "SmoothnessLimits", "is_smooth", "least_members", "whole_planes"]

# All members keep to their plane nearly as well as the retained do to theirs: no outliers.
ALL_FLAT = 1.2
# The quadric leaves hardly more than the robust plane's scale, which curvature has inflated. At a
# sharp crease it leaves far more: the scale there is the noise. A blunt one may get past this; that
# the quadric leaves more there than next to it shows later, see `SurfacePlanes`. What deviates more
# from its plane, as a share of its width (standard deviations), is a post or a sharp edge.
CURVED, MOST_BENT = 1.15, 0.3
# Share of the variance about the plane that a quadric leaves, without noise at most. It leaves
# 6 % of a crease.
QUADRIC = 0.02
# A quadric that the members don't determine, as on two scan lines, explains nothing.
PIVOT = 1e-6
# A neighborhood is ordinary, and no robust plane need be sought, if the plane leaves hardly more
# than a quadric does, no member is farther than noise puts one of fifty, ...
AS_FLAT, FARTHEST = 1.06, 3.0
# ... and the heights are like a normal sample's: a few members of another face make them skew,
# and of points about two planes, or about one that runs across both, the kurtosis is below 2.
MOST_SKEW, LEAST_KURTOSIS = 0.5, 2.1
# Outliers lengthen the deviation, so that most of the members lie in the middle. Of a normal
# sample 38 % are within half a deviation, and the mean height is 0.80 deviations (Geary's ratio).
MIDDLE, MOST_IN_MIDDLE, LEAST_GEARY = 0.5, 0.5, 0.74
# Narrower strips tell nothing about their plane, in standard deviations of width to length.
LEAST_WIDTH = 0.05
# Deviation from the plane to length that is rounding.
PERFECT = 1e-9


class SmoothnessLimits(NamedTuple):
    """The constants above, as compiled code takes them: it would not notice a change of a file."""

    pivot: float = PIVOT
    as_flat: float = AS_FLAT
    farthest: float = FARTHEST
    most_skew: float = MOST_SKEW
    least_kurtosis: float = LEAST_KURTOSIS
    middle: float = MIDDLE
    most_in_middle: float = MOST_IN_MIDDLE
    least_geary: float = LEAST_GEARY
    least_width: float = LEAST_WIDTH
    perfect: float = PERFECT


LIMITS = SmoothnessLimits()


def least_members(d):
    """Fewest members for a quadric to have left something to explain."""
    return 2 * (1 + (d - 1) + d * (d - 1) // 2)


def is_smooth(deviation, left, eigenvalues, scale):
    """Whether neighborhoods with robust planes of a scale keep all members: bool (B,).

    `deviation`, `left` and `eigenvalues` are as by `whole_planes`.
    """
    width = np.sqrt(eigenvalues[:, min(1, eigenvalues.shape[1] - 1)])
    smooth = (left <= CURVED * scale) & (deviation <= MOST_BENT * width)
    smooth |= deviation <= ALL_FLAT * scale
    smooth |= left <= np.sqrt(QUADRIC) * deviation
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
    with np.errstate(divide="ignore", invalid="ignore"):
        skew = (height**3).sum(axis=1) / sizes / variance**1.5
        kurtosis = (height**4).sum(axis=1) / sizes / variance**2
    ordinary = (deviation <= AS_FLAT * left) & (kurtosis >= LEAST_KURTOSIS)
    ordinary &= np.abs(skew) <= MOST_SKEW
    ordinary &= np.square(height).max(axis=1) <= FARTHEST**2 * variance
    inside = (np.square(height) <= MIDDLE**2 * variance[:, None]) & valid
    ordinary &= inside.sum(axis=1) <= MOST_IN_MIDDLE * sizes
    ordinary &= np.abs(height).sum(axis=1) / sizes >= LEAST_GEARY * np.sqrt(variance)
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
