"""Planes by principal components: arithmetic that all methods share."""

from functools import cache, reduce
from typing import NamedTuple

import numpy as np
from scipy.special import chdtri, fdtri

# Eigenvalues below this share of the largest one count as zero. It is the square of a spread of
# 1e-6 of the neighborhood's extent.
RANK_TOLERANCE = 1e-12
CONFIDENCE = 0.95  # at which errors from few points agree with errors from many points


class RowLimits(NamedTuple):
    """What is a row of points, and no face."""

    width: float = 0.25  # share of its length, both as standard deviations, below which it is one


def are_rows(eigenvalues):
    """Whether members are rows along a surface, by the eigenvalues (m, d) of their planes, which
    ascend: bool (m,). None is in 2D."""
    return eigenvalues[:, 1] < RowLimits().width ** 2 * eigenvalues[:, -1]


def fit_planes(neighborhoods, inliers=None):
    """Fit a plane to each neighborhood (..., k, d) by principal components (Eq. 1).

    It is fitted to the members that are `inliers`, bool (..., k), or to all. They are centered
    before products are formed, so large coordinates cost no accuracy.

    Returns centroids (..., d); eigenvalues (..., d) of the covariance matrix with divisor k,
    ascending, never negative; and unit eigenvectors (..., d, d) as columns. ``axes[..., 0]`` is the
    plane's normal, of either sign.

    See Nurunnabi, West, Belton, "Outlier detection and robust normal-curvature estimation in mobile
    laser scanning 3D point cloud data", Eqs 1-2.
    """
    origin = neighborhoods[..., :1, :]
    local = neighborhoods - origin
    if inliers is None:
        mean = local.mean(axis=-2, keepdims=True)
        local -= mean
        covariance = np.swapaxes(local, -1, -2) @ local / local.shape[-2]
    else:
        weight = inliers[..., None].astype(local.dtype)
        total = np.maximum(weight.sum(axis=-2, keepdims=True), 1.0)
        # Rows that are no inliers may be padding of any value, also infinite.
        local = np.where(inliers[..., None], local, 0.0)
        mean = local.sum(axis=-2, keepdims=True) / total
        local = (local - mean) * weight
        covariance = np.swapaxes(local, -1, -2) @ local / total
    eigenvalues, axes = np.linalg.eigh(covariance)
    return (origin + mean)[..., 0, :], np.maximum(eigenvalues, 0.0), axes


def orthogonal_distances(points, centroids, normals):
    """Signed distances from points (..., k, d) to planes (Algorithm 1, step 2)."""
    return np.matmul(points - centroids[..., None, :], normals[..., None])[..., 0]


def surface_variation(eigenvalues):
    """Share of the least eigenvalue in the sum, "curvature" in the papers (Eq. 3).

    It is 0 for a perfect plane and 1/d for an isotropic cluster, and 0 where all points coincide.
    """
    total = eigenvalues.sum(axis=-1)
    return np.divide(eigenvalues[..., 0], total, out=np.zeros_like(total), where=total > 0)


def normal_errors(scale, eigenvalues, n_points, inflation=1.0):
    """Root mean square tilt (n,) of the normals of fitted planes, in degrees, at most 90.

    Noise along the normal, of standard deviation `scale` (n,), tilts it toward each in-plane axis
    by `tilt_variances`. The eigenvalues (n, d) ascend, and `n_points` (n,) are those that a plane
    was fitted to. The error is the root of the sum over the d - 1 axes, and 90 where the points do
    not determine a plane. `inflation`, a number or (n,), is a factor on it for points that were
    chosen by their distances.

    The true normal is within ``sqrt(q / (d - 1))`` errors with 95 % confidence, where q is the 0.95
    quantile of chi-squared with d - 1 degrees of freedom. This is 1.73 in 3D, if the neighborhood
    is about as long as wide. That factor holds for any number of points, since the error includes
    the scale's own uncertainty, see `student_factors`.
    """
    d = eigenvalues.shape[1]
    freedom = n_points - d
    in_plane, least = eigenvalues[:, 1:], eigenvalues[:, :1]
    gap = in_plane - least
    has_plane = (freedom > 0) & (gap[:, 0] > RANK_TOLERANCE * eigenvalues[:, -1])
    gap[~has_plane] = np.inf
    variance = reduce(np.add, tilt_variances(in_plane, gap, (scale**2)[:, None]).T)
    variance /= np.maximum(n_points, 1)
    errors = inflation * student_factors(freedom, d) * np.degrees(np.sqrt(variance))
    return np.where(has_plane, np.minimum(errors, 90.0), 90.0)


def tilt_variances(in_plane, gap, variance):
    """Variances ``v l_i / (l_i - l_0)^2`` of tilts toward the axes of planes (T. W. Anderson,
    "Asymptotic theory for principal component analysis", Annals of Mathematical Statistics 34
    (1963) 122-148).

    l_i are the variances of the points along these axes, `in_plane`, and by their `gap` they exceed
    the one across, l_0. v is the variance of the plane at its center. Where the plane is much wider
    than its noise, this is nearly ``v / l_i``, the variance of a regression line's slope.
    """
    # Quotients of squares only: fourth powers would overflow or vanish in some units.
    return in_plane / gap * variance / gap


def student_factors(freedom, d):
    """Factors on errors of normals for the uncertainty of the scale: (n,).

    They are the roots of the ratios of the 0.95 quantiles of F(d - 1, f) and F(d - 1, infinity),
    where f are the degrees of freedom (n,) of the scale. For planes in 3D, where f = m - 3, this is
    1.09 for 20 points and 1.02 for 100.
    """
    row = np.maximum(freedom, 1).astype(np.intp)
    counts = np.flatnonzero(np.bincount(row))
    ratios = np.ones(row.max(initial=0) + 1)
    ratios[counts] = [_student_ratio(count, d) for count in counts.tolist()]
    return np.sqrt(ratios[row])


@cache  # quantiles of F take long
def _student_ratio(freedom, d):
    return fdtri(d - 1, freedom, CONFIDENCE) * (d - 1) / chdtri(d - 1, 1.0 - CONFIDENCE)


def flat_normals(normals, eigenvalues, directions):
    """Give neighborhoods without a plane a defined normal, in place.

    Collinear points fit every plane through their line. The normal is then the perpendicular of the
    line that is nearest to the last axis (a horizontal line gets a horizontal plane). Where all
    points coincide, it is the last axis itself. Eigenvalues (n, d) ascend, and `directions` (n, d)
    are the axes of the largest.
    """
    d = normals.shape[1]
    # All variance is along one axis, or there is none.
    flat = np.flatnonzero(eigenvalues[:, d - 2] <= RANK_TOLERANCE * eigenvalues[:, -1])
    for axis in reversed(range(d)):
        if flat.size == 0:
            break
        line = np.where(eigenvalues[flat, -1:] > 0, directions[flat], 0.0)
        # The axis, less its part along the line.
        candidate = -line[:, axis, None] * line
        candidate[:, axis] += 1.0
        length = np.linalg.norm(candidate, axis=1)
        good = length > 0.5  # otherwise the line is within 30 degrees of this axis
        normals[flat[good]] = candidate[good] / length[good, None]
        flat = flat[~good]
