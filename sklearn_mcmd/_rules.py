"""Rules: what makes a member of a neighborhood an outlier, by the name of the method.

A rule turns a neighborhood and its consistent set into a robust distance: a center and a
whitening matrix. The distance of a point is the length of its whitened deviation from the
center, and members farther than the cutoff are outliers. `METHODS` lists the rules; this
NumPy form holds in any dimension, ``_rules_numba`` repeats it in three.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import erf, exp, pi, sqrt

import numpy as np
from scipy.special import chdtri

from sklearn_mcmd._plane import fit_planes, orthogonal_distances

__all__ = ["METHODS", "Rule", "mcmd_md", "mcmd_z", "pca", "robust_distances"]

MAD_TO_SD = 1.4826  # section 4.2: makes the MAD consistent at the normal distribution
REWEIGHT_CUTOFF = 2.5
# The median of the first scale reaches into the outliers' side: with 40 % of them it is half
# as large again, and the first cut leaves nothing out. The second one cuts at 2.5 indeed.
REWEIGHT_STEPS = 2
# Variance of a standard normal variable cut off at +-2.5, 0.911.
TRUNCATED_VARIANCE = 1.0 - 2.0 * REWEIGHT_CUTOFF * exp(-(REWEIGHT_CUTOFF**2) / 2) / (
    sqrt(2 * pi) * erf(REWEIGHT_CUTOFF / sqrt(2))
)


@dataclass(frozen=True)
class Rule:
    """A method by name."""

    code: int  # what the compiled driver knows it by
    apply: Callable  # see `mcmd_z`
    default_cutoff: Callable  # of the number of features
    needs_consistent_set: bool


def robust_distances(points, centers, whitening):
    """Lengths (B, m) of the whitened deviations of points (B, m, d) from the centers."""
    whitened = (points - centers[:, None]) @ whitening
    return np.sqrt(np.square(whitened).sum(axis=-1))


def mcmd_z(local, valid, support, reweight, floor):
    """Robust z-scores of orthogonal distances (Algorithm 2, Eq. 17).

    Parameters
    ----------
    local : ndarray of shape (B, k, d)
    valid : ndarray of bool of shape (B, k)
        Members in use.
    support : ndarray of bool of shape (B, k)
        The maximum consistent set.
    reweight : bool
        Whether plane and scale are refitted to the members within 2.5 robust standard
        deviations of the set's plane, and once more. The paper does not.
    floor : ndarray of shape (B,)
        Least scale: what rounding of the coordinates alone amounts to. It answers for a
        perfect plane, where the MAD is zero.

    Returns
    -------
    centers : ndarray of shape (B, d)
    whitening : ndarray of shape (B, d, r)
        The first column is the plane's normal over the scale of the noise.
    """
    if reweight:
        centers, _, axes, scale, _ = _reweighted_planes(local, valid, support, floor)
        normals = axes[..., 0]
    else:
        centers, _, axes = fit_planes(local, support)
        normals = axes[..., 0]
        distances = orthogonal_distances(local, centers, normals)
        middle = _masked_median(distances, valid)
        mad = _masked_median(np.abs(distances - middle[:, None]), valid)
        scale = np.maximum(MAD_TO_SD * mad, floor)
        centers = centers + middle[:, None] * normals
    return centers, (normals / scale[:, None])[..., None]


def mcmd_md(local, valid, support, reweight, floor):
    """Robust Mahalanobis distances (Algorithm 3, Eq. 18); see `mcmd_z` for the arguments."""
    if reweight:
        centers, values, axes, scale, n_used = _reweighted_planes(local, valid, support, floor)
    else:
        centers, values, axes = fit_planes(local, support)
        n_used = support.sum(axis=1)
        variance = _variance_along(orthogonal_distances(local, centers, axes[..., 0]), support)
        scale = np.sqrt(variance * n_used / np.maximum(n_used - 1, 1))
    deviations = np.sqrt(values * (n_used / np.maximum(n_used - 1, 1))[:, None])
    deviations[:, 0] = scale
    return centers, axes / np.maximum(deviations, floor[:, None])[:, None, :]


def pca(local, valid, support, reweight, floor):
    """The plane of all members and its standard deviation; see `mcmd_z` for the arguments."""
    centers, _, axes = fit_planes(local, valid)
    size = valid.sum(axis=1)
    variance = _variance_along(orthogonal_distances(local, centers, axes[..., 0]), valid)
    variance *= size / np.maximum(size - local.shape[-1], 1)
    scale = np.maximum(np.sqrt(variance), floor)
    return centers, axes[..., :1] / scale[:, None, None]


def _reweighted_planes(local, valid, support, floor):
    """Planes of the members within 2.5 robust standard deviations of the set's plane.

    The scale before is that of least median of squares, with its small-sample factor
    (Rousseeuw and Leroy, 1987, chapter 5); the one after is the standard deviation of the
    kept, with the degrees of freedom that the plane took, corrected for the cut at 2.5.
    """
    d = local.shape[-1]
    size = valid.sum(axis=1)
    centers, _, axes = fit_planes(local, support)
    distances = np.abs(orthogonal_distances(local, centers, axes[..., 0]))
    factor = MAD_TO_SD * (1.0 + 5.0 / np.maximum(size - d, 1))
    scale = np.maximum(factor * _masked_median(distances, valid), floor)
    for _ in range(REWEIGHT_STEPS):
        kept = valid & (distances < REWEIGHT_CUTOFF * scale[:, None])
        centers, values, axes = fit_planes(local, kept)
        distances = np.abs(orthogonal_distances(local, centers, axes[..., 0]))
        n_kept = kept.sum(axis=1)
        variance = _variance_along(distances, kept) * n_kept / np.maximum(n_kept - d, 1)
        scale = np.maximum(np.sqrt(variance / TRUNCATED_VARIANCE), floor)
    return centers, values, axes, scale, n_kept


def _variance_along(distances, members):
    """Mean square of the members' distances to their plane.

    Not the least eigenvalue, whose rounding error is that of the largest: below 1e-8 of the
    neighborhood's radius its root is no scale any more.
    """
    return np.square(distances * members).sum(axis=1) / np.maximum(members.sum(axis=1), 1)


def _masked_median(values, valid):
    """Median of each row of (B, k) over its valid members."""
    if valid.all():
        return np.median(values, axis=1)
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    size = valid.sum(axis=1)
    rows = np.arange(len(values))
    return 0.5 * (ordered[rows, (size - 1) // 2] + ordered[rows, size // 2])


METHODS = {
    "mcmd_z": Rule(1, mcmd_z, lambda d: 2.5, True),
    # The paper prints 3.075 for d = 3; the root of chi-squared's quantile is 3.0575.
    "mcmd_md": Rule(2, mcmd_md, lambda d: sqrt(chdtri(d, 0.025)), True),
    "pca": Rule(0, pca, lambda d: 2.5, False),
}
