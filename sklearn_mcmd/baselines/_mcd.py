"""The minimum covariance determinant of many neighborhoods at once (FAST-MCD)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import chdtr, chdtri
from sklearn.covariance import fast_mcd

from sklearn_mcmd.baselines._fits import CHUNK_ENTRIES

MOST_STEPS = 100  # of concentration, which ends by itself long before


class McdLimits(NamedTuple):
    """Steps of FAST-MCD, and which members it keeps."""

    first_steps: int = 2  # of concentration, from each start
    n_best: int = 10  # starts that go on to the end
    nested_from: int = 1000  # from this size on scikit-learn's nested subsets save time
    flatness: float = 1e-6  # deviations below this share of the extent count as none
    kept_quantile: float = 0.975  # of chi-squared, within which members are kept
    equal: float = 1e-9  # volumes that differ by less, relatively, are of one subset


# Coefficients of Pison, Van Aelst and Willems (2002) for the small-sample factors at support
# fractions .5 and .875, of the raw and the reweighted estimate.
ONE_OR_TWO = {
    "raw": {
        1: ((0.262024211897096, 0.604756680630497), (-0.351584646688712, 1.01646567502486)),
        2: ((0.673292623522027, 0.691365864961895), (0.446537815635445, 1.06690782995919)),
    },
    "reweighted": {
        1: ((1.11098143415027, 1.5182890270453), (-0.66046776772861, 0.88939595831888)),
        2: ((3.11101712909049, 1.91401056721863), (0.79473550581058, 1.10081930350091)),
    },
}
THREE_AND_MORE = {
    "raw": (
        ((1.42764571687802, 1.26263336932151), (1.06141115981725, 1.28907991440387)),
        ((0.455179464070565, 1.11192541278794), (0.294241208320834, 1.09649329149811)),
    ),
    "reweighted": (
        ((1.02842572724793, 1.67659883081926), (0.26800273450853, 1.35968562893582)),
        ((0.544482443573914, 1.25994483222292), (0.343791072183285, 1.25159004257133)),
    ),
}


@dataclass(frozen=True)
class Mcd:
    """Location and scatter of B neighborhoods, consistent for the normal distribution.

    support (B, n) is the raw subset, and raw_squares (B, n) are the squared raw distances. kept
    (B, n) are the members behind the reweighted locations (B, d) and covariances (B, d, d).
    """

    support: np.ndarray
    raw_squares: np.ndarray
    kept: np.ndarray
    locations: np.ndarray
    covariances: np.ndarray


def mcd_support_size(support_fraction, n, d):
    """Size of the subset: (n + d + 1) // 2 for a fraction of 0.5, n for 1, linear between them."""
    least = (n + d + 1) // 2
    return min(n, int(np.floor(2 * least - n + 2 * (n - least) * support_fraction)))


def fit_mcd(points, table, support_fraction, floor, *, small_sample=True, consistency="kept"):
    """Reweighted minimum covariance determinant (Rousseeuw and Van Driessen, FAST-MCD).

    Points are (B, n, d). The table (T, d + 1) has the positions of the initial subsets. Each takes
    two concentration steps; the ten best take steps until they no longer change. `floor` (B,) is
    the least deviation along any axis. `small_sample` applies the factors of Pison, Van Aelst and
    Willems (2002). `consistency` is the share that the reweighted covariance is corrected for,
    "kept" or "quantile". From 1,000 members on it is scikit-learn's FAST-MCD.
    """
    n_sets, n, d = points.shape
    h, limits = mcd_support_size(support_fraction, n, d), McdLimits()
    # Step 1: the median at the origin, and the median extent one, in whatever unit.
    center = np.median(points, axis=1, keepdims=True)
    local = points - center
    extent = np.median(np.abs(local).max(axis=2), axis=1)
    extent = np.where(extent > 0, extent, np.maximum(np.abs(local).max(axis=(1, 2)), floor))
    local = local / extent[:, None, None]
    ridge = np.maximum(floor / extent, limits.flatness) ** 2
    # Step 2: the subset of h members with the least determinant.
    if n >= limits.nested_from:
        support = np.array(
            [fast_mcd(part, support_fraction=h / n, random_state=0)[2] for part in local]
        ).reshape(n_sets, n)
    else:
        support = np.empty((n_sets, n), dtype=bool)
        at_once = max(1, CHUNK_ENTRIES // (len(table) * n))
        for start in range(0, n_sets, at_once):
            rows = slice(start, start + at_once)
            support[rows] = _best_support(local[rows], table, h, ridge[rows])
    # Step 3: its covariance is too small, since it is the central share of a normal distribution.
    locations, scatter, size = moments(local, support)
    covariances = scatter / size * _consistency(h / n, d)
    if small_sample:
        covariances *= _small_sample("raw", n, d, support_fraction)
    # Step 4: members within a quantile of chi-squared are kept, and fitted once more.
    values, axes = np.linalg.eigh(covariances)
    scales = np.sqrt(np.maximum(values, ridge[:, None]))[:, None]
    raw = np.square((local - locations[:, None]) @ axes / scales).sum(axis=-1)
    kept = raw <= chdtri(d, 1.0 - limits.kept_quantile)
    # At least the subset itself is kept.
    kept = np.where((kept.sum(axis=1) >= h)[:, None], kept, kept | support)
    locations, scatter, size = moments(local, kept)
    share = kept.mean(axis=1) if consistency == "kept" else np.full(n_sets, limits.kept_quantile)
    covariances = scatter / (size - 1) * _consistency(share, d)[:, None, None]
    if small_sample:
        covariances *= _small_sample("reweighted", n, d, support_fraction)
    scale = extent[:, None, None]
    return Mcd(
        support=support,
        raw_squares=raw,
        kept=kept,
        locations=locations * scale[:, 0] + center[:, 0],
        covariances=covariances * np.square(scale),
    )


def univariate_mcd(values, h):
    """Location and standard deviation of the h of n values with the least variance (last axis).

    They are consistent for the normal distribution, and exact: the subset is a run of the sorted
    values.
    """
    n = values.shape[-1]
    middle = np.median(values, axis=-1, keepdims=True)
    ordered = np.sort(values - middle, axis=-1)
    zero = np.zeros((*ordered.shape[:-1], 1))
    # Sums of all runs are differences of cumulative sums. Centering at the median keeps digits.
    sums = np.concatenate([zero, np.cumsum(ordered, axis=-1)], axis=-1)
    squares = np.concatenate([zero, np.cumsum(ordered**2, axis=-1)], axis=-1)
    means = (sums[..., h:] - sums[..., :-h]) / h
    variances = np.maximum((squares[..., h:] - squares[..., :-h]) / h - means**2, 0.0)
    best = np.argmin(variances, axis=-1)[..., None]
    location = np.take_along_axis(means, best, -1) + middle
    variance = np.take_along_axis(variances, best, -1) * _consistency(h / n, 1)
    return location[..., 0], np.sqrt(variance[..., 0])


def _best_support(local, table, h, ridge):
    """Mask (B, n) of the subset with the least determinant among those that the starts lead to."""
    (n_sets, n, d), limits = local.shape, McdLimits()
    upper = np.triu_indices(d)
    products = local[..., upper[0]] * local[..., upper[1]]
    features = np.concatenate([np.ones((n_sets, n, 1)), local, products], axis=-1)
    support = np.zeros((n_sets, len(table), n), dtype=bool)
    np.put_along_axis(support, np.broadcast_to(table, (n_sets, *table.shape)), True, axis=-1)
    for _ in range(limits.first_steps):
        support = _concentrate(features, support, h, ridge)
    volumes = _volumes(features, support, ridge)
    order = np.argsort(volumes, axis=1, kind="stable")[:, : limits.n_best]
    support = np.take_along_axis(support, order[..., None], axis=1)
    moving = np.arange(n_sets)
    for _ in range(MOST_STEPS):
        moved = _concentrate(features[moving], support[moving], h, ridge[moving])
        changed = (moved != support[moving]).any(axis=(1, 2))
        support[moving] = moved
        moving = moving[changed]
        if moving.size == 0:
            break
    volumes = _volumes(features, support, ridge)
    # Starts that end in one subset differ by rounding: take the first.
    limit = volumes.min(axis=1, keepdims=True)
    best = np.argmax(volumes <= limit + limits.equal * np.abs(limit), axis=1)
    return support[np.arange(n_sets), best]


def _concentrate(features, support, h, ridge):
    """One concentration step: the h members nearest to the mean and covariance of each subset."""
    mean, covariance = _feature_moments(features, support, ridge)
    inverse = np.linalg.inv(covariance)
    d = mean.shape[-1]
    upper = np.triu_indices(d)
    shifted = np.matmul(inverse, mean[..., None])[..., 0]
    # Squared distances are linear in 1, x and products of x.
    quadratic = inverse[..., upper[0], upper[1]] * np.where(upper[0] == upper[1], 1.0, 2.0)
    constant = np.einsum("bti,bti->bt", shifted, mean)[..., None]
    coefficients = np.concatenate([constant, -2.0 * shifted, quadratic], axis=-1)
    squares = coefficients @ np.swapaxes(features, 1, 2)
    order = np.argpartition(squares, h - 1, axis=-1)[..., :h]
    nearest = np.zeros(squares.shape, dtype=bool)
    np.put_along_axis(nearest, order, True, axis=-1)
    return nearest


def _volumes(features, support, ridge):
    """Logarithms of the determinants of the subsets (B, T)."""
    _, covariance = _feature_moments(features, support, ridge)
    return np.linalg.slogdet(covariance)[1]


def _feature_moments(features, support, ridge):
    """Means and covariances, `ridge` added, of subsets (B, T, n)."""
    moments = support.astype(float) @ features
    size = moments[..., :1]
    # Of 1 + d + d (d + 1) / 2 features: 1, coordinates and products.
    d = int((np.sqrt(8 * features.shape[-1] + 1) - 3) / 2)
    upper = np.triu_indices(d)
    mean = moments[..., 1 : d + 1] / size
    covariance = np.empty((*mean.shape, d))
    second = moments[..., d + 1 :] / size
    covariance[..., upper[0], upper[1]] = second
    covariance[..., upper[1], upper[0]] = second
    covariance -= mean[..., :, None] * mean[..., None, :]
    covariance += ridge[:, None, None, None] * np.eye(d)
    return mean, covariance


def moments(points, members):
    """Mean (B, d), sum of products of deviations (B, d, d) and number (B, 1, 1) of members."""
    weight = members[..., None].astype(float)
    size = weight.sum(axis=1)
    mean = (points * weight).sum(axis=1) / size
    deviations = (points - mean[:, None]) * weight
    return mean, np.swapaxes(deviations, 1, 2) @ deviations, size[..., None]


def _consistency(share, d):
    """Factor on the covariance of the central share of a normal distribution."""
    # Within the quantile of this share the covariance is P(chi2_(d + 2) < q) / share of the whole.
    share = np.asarray(share, dtype=float)
    inner = np.minimum(share, 1.0 - 1e-12)
    return np.where(share >= 1.0, 1.0, share / chdtr(d + 2, chdtri(d, 1.0 - inner)))


def _small_sample(kind, n, d, support_fraction):
    """Factor on the covariance for few points, from simulation; it tends to 1 for many points."""
    if d <= 2:
        half, most = (1.0 - np.exp(a) / n**b for a, b in ONE_OR_TWO[kind][d])
    else:
        half, most = (1.0 - _interpolate(pair, n, d) for pair in THREE_AND_MORE[kind])
    # Linear between the two fractions that were simulated, and to 1 for all members.
    if support_fraction <= 0.875:
        share = half + (most - half) * (support_fraction - 0.5) / 0.375
    else:
        share = most + (1.0 - most) * (support_fraction - 0.875) / 0.125
    # The formula was fitted to larger samples; for 2 d points or fewer it gives no useful factor.
    return 1.0 / share if share > 0.1 else 1.0


def _interpolate(pair, n, d):
    """exp(a) / n^b through the two values known at n = 2 d^2 and 3 d^2."""
    # Logarithms of 1 - factor are linear in log n.
    y = [np.log(c / d**e) for c, e in pair]
    slope = (y[0] - y[1]) / np.log(3.0 / 2.0)
    intercept = y[0] + slope * np.log(2.0 * d**2)
    return np.exp(intercept) / n**slope
