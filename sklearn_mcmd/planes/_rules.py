"""Rules: they decide which members of a neighborhood are outliers, by the name of the method.

A rule turns a neighborhood and its consistent set into a robust distance: a center and a
whitening matrix. The distance of a point is the length of its whitened deviation from the
center, and members farther than the cutoff are outliers. `METHODS` lists the rules. This NumPy
form works in any dimension; ``_local_planes_numba`` repeats it in three, if a rule says so.
"""

from collections.abc import Callable
from dataclasses import fields
from math import erf, exp, pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from sklearn_mcmd.planes._principal_planes import RANK_TOLERANCE, fit_planes, orthogonal_distances

WIDEST = 40.0  # cutoff, beyond which float64 has no share of a normal variable left
MAD_TO_SD = 1.4826  # section 4.2: makes the MAD consistent for the normal distribution


class ReweightLimits(NamedTuple):
    """How planes are refitted; the paper does not do this."""

    cutoff: float = 2.5  # robust standard deviations within which members are kept for the refit
    # Times that a plane is refitted. Outliers raise the median of the first scale: 40 % of them
    # make it half as large again, and the first cut removes too little.
    steps: int = 2
    # See `small_sample_inflation`: a compromise, by simulation, between planes without outliers and
    # with 10 %, for 20 to 100 neighbors in 2D to 4D, of neighborhoods of an odd number of points,
    odd_excess: float = 4.7
    even_excess: float = 3.2  # and of an even number


class Rule(NamedTuple):
    """A method by name."""

    apply: Callable  # see `mcmd_z`
    default_cutoff: Callable  # takes the number of features
    needs_consistent_set: bool
    inflation: Callable  # factor on standard errors; takes cutoff, d, members kept and members
    compiled: bool = False  # by the form of its name in ``_local_planes_numba.FORMS``, or by NumPy


class RuleArguments(NamedTuple):
    """What the compiled forms of rules know: they would not notice a constant that changes."""

    d: int  # number of features
    cutoff: float
    reweight: bool
    rounding: float  # relative rounding error of the coordinates
    least_scale: float  # error from the step of rounded coordinates, in units of the points
    outliers: float  # share of the members that may be off the plane
    least_face: float  # as `AgreementLimits.face`
    mad_to_sd: float
    reweight_cutoff: float
    reweight_steps: int
    truncated_variance: float
    rank_tolerance: float = RANK_TOLERANCE

    @classmethod
    def of(cls, **settings):
        """The first seven, with the limits as they are now."""
        limits = ReweightLimits()
        return cls(
            **settings,
            mad_to_sd=MAD_TO_SD,
            reweight_cutoff=limits.cutoff,
            reweight_steps=limits.steps,
            truncated_variance=truncated_normal(limits.cutoff)[1],
        )


def truncated_normal(cutoff):
    """Share of a standard normal variable within +-cutoff, and the variance of that part."""
    cutoff = min(cutoff, WIDEST)
    share = erf(cutoff / sqrt(2))
    return share, 1.0 - 2.0 * cutoff * exp(-(cutoff**2) / 2) / (sqrt(2 * pi) * share)


def robust_distances(points, centers, whitening):
    """Lengths (B, m) of the whitened deviations of points (B, m, d) from the centers."""
    whitened = (points - centers[:, None]) @ whitening
    return np.sqrt(np.square(whitened).sum(axis=-1))


def mcmd_z(local, valid, support, reweight, floor):
    """Robust z-scores of orthogonal distances (Algorithm 2, Eq. 17).

    Members (B, k, d) are in use where `valid`, bool (B, k), and `support`, bool (B, k), is the
    maximum consistent set. With `reweight`, plane and scale are refitted to the members within 2.5
    robust standard deviations of the set's plane, and then once more. The paper does not do this.
    `floor` (B,) is the least scale: the error from rounding of the coordinates alone. It is the
    scale of a perfect plane, where the MAD is zero.

    Returns centers (B, d) and whitening matrices (B, d, r). Their first column is the plane's
    normal over the scale of the noise.
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
    variance *= size / np.maximum(size - local.shape[-1], 1)  # a plane takes d degrees of freedom
    scale = np.maximum(np.sqrt(variance), floor)
    return centers, axes[..., :1] / scale[:, None, None]


def cut_inflation(cutoff):
    """Standard error of a plane fitted within a cutoff, over that of as many uncut points.

    If a plane is off by e, the points within a cutoff around it have a plane that is off by
    ``(1 - variance of the cut normal) * e``. So the next plane inherits part of the error of the
    plane before. The plane before is assumed to have converged at a cutoff of 2.5. For this
    cutoff the result is one over the root of the cut normal's variance, 1.05.
    """
    # The variance of the sum of both errors: of the points within this cutoff, and what is
    # inherited of the plane before, which shares the points within both cutoffs.
    share, variance = truncated_normal(cutoff)
    before, variance_before = truncated_normal(ReweightLimits().cutoff)
    common = min(share * variance, before * variance_before)
    inherited = (1.0 - variance) / (before * variance_before)
    return sqrt(variance + 2.0 * inherited * common + inherited * (1.0 - variance) * share)


def small_sample_inflation(d, n_inliers, n_members):
    """Factor on the errors of planes of few points, from simulation.

    The consistent set is the best of many, so the first scale is too small and too few are kept.
    With an odd number of members the median is the set's own largest distance.
    """
    limits = ReweightLimits()
    excess = np.where(n_members % 2 == 1, limits.odd_excess, limits.even_excess)
    return 1.0 + excess * d**2 / np.maximum(n_inliers - d, 1.0) ** 1.5


def _reweighted_planes(local, valid, support, floor):
    """Planes of the members within 2.5 robust standard deviations of the set's plane.

    The first scale is that of least median of squares, with its small-sample factor
    (Rousseeuw and Leroy, 1987, chapter 5). Later scales are the standard deviation of the kept
    members, less the degrees of freedom of the plane, corrected for the cut at 2.5.
    """
    d, limits = local.shape[-1], ReweightLimits()
    size = valid.sum(axis=1)
    centers, _, axes = fit_planes(local, support)
    distances = np.abs(orthogonal_distances(local, centers, axes[..., 0]))
    factor = MAD_TO_SD * (1.0 + 5.0 / np.maximum(size - d, 1))
    scale = np.maximum(factor * _masked_median(distances, valid), floor)
    for _ in range(limits.steps):
        kept = valid & (distances < limits.cutoff * scale[:, None])
        centers, values, axes = fit_planes(local, kept)
        distances = np.abs(orthogonal_distances(local, centers, axes[..., 0]))
        n_kept = kept.sum(axis=1)
        variance = _variance_along(distances, kept) * n_kept / np.maximum(n_kept - d, 1)
        scale = np.maximum(np.sqrt(variance / truncated_normal(limits.cutoff)[1]), floor)
    return centers, values, axes, scale, n_kept


def _variance_along(distances, members):
    """Mean square of the members' distances to their plane.

    The least eigenvalue would not do: it has the rounding error of the largest one. Its root is
    useless as a scale below 1e-8 of the neighborhood's radius.
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


def _inflation_z(cutoff, d, n_inliers, n_members):
    return cut_inflation(cutoff) * small_sample_inflation(d, n_inliers, n_members)


def _inflation_md(cutoff, d, n_inliers, n_members):
    """Approximation: the in-plane part of each squared distance is set to its mean, d - 1."""
    # What then is left of the cutoff for the distance along the normal.
    along = sqrt(max(min(cutoff, WIDEST) ** 2 - (d - 1), 1.0))
    return _inflation_z(along, d, n_inliers, n_members)


METHODS = {
    "mcmd_z": Rule(mcmd_z, lambda d: 2.5, True, _inflation_z, compiled=True),
    # The paper prints 3.075 for d = 3; the root of chi-squared's quantile is 3.0575.
    "mcmd_md": Rule(mcmd_md, lambda d: sqrt(chdtri(d, 0.025)), True, _inflation_md, compiled=True),
    "pca": Rule(pca, lambda d: 2.5, False, lambda *_: 1.0, compiled=True),
}
# What judges neighborhoods in place of a rule, by name: dataclasses of parameters with the methods
# of `Method` in ``sklearn_mcmd.baselines``, which puts them here.
COMPARATORS: dict[str, type] = {}


def comparator_of(method, method_params=None):
    """The method with this name and its parameters; errors name what is unknown or wrong."""
    if method not in COMPARATORS:
        raise ValueError(f"method={method!r} is none of {', '.join(sorted(COMPARATORS))}.")
    kind, params = COMPARATORS[method], dict(method_params or {})
    names = sorted(field.name for field in fields(kind))
    unknown = sorted(str(name) for name in params if name not in names)
    if unknown:
        raise ValueError(
            f"method_params has {', '.join(map(repr, unknown))}, unknown to method {method!r}; "
            f"it knows {', '.join(names)}."
        )
    return kind(**params)
