"""Robust adjustment by iteratively reweighted least squares (Eqs 2-8)."""

from typing import NamedTuple

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.adjustment._least_squares import adjust_plane, rounding_of, weighed

MAX_ITERATIONS = 200  # adjustments of an M-estimate, after which it warns
TOLERANCE = 1e-6  # change of a residual, in units of the scale, at which the iteration ends
NORMAL_QUARTILE = 0.6744897501960817  # median of |v| in normal standard deviations


class HuberLimits(NamedTuple):
    """Standardized residuals at which weights fall."""

    bend: float = 1.345  # up to which the weight is 1, 95 % efficient in normal data


def m_estimate(X, weights=None, *, sigma0=None, surface="vertical", rounding=None):
    """Plane by Huber's M-estimation: repeat the adjustment with P W until it converges (Eqs 3-7).

    Without `sigma0` the scale is the `robust_scale` of the residuals, or that of the `Rounding` of
    the points, if larger. Returns the plane, W and the scale. Readings of Eqs 5 and 8 are in
    docs/papers.rst.
    """
    plane, scale = adjust_plane(X, weights, surface=surface), sigma0 or 0.0
    if rounding is None:
        rounding = rounding_of(X if weights is None else X[weights > 0], surface)
    residuals = plane.evaluate(X)[0]
    for _ in range(MAX_ITERATIONS):
        floor = rounding.least_robust_deviation(plane.direction)
        if sigma0 is None:
            scale = max(robust_scale(residuals, weights, plane.rank), floor)
        standardized = residuals / max(scale, floor)
        if weights is not None:
            standardized *= np.sqrt(weights)
        robust_weights = huber(standardized)
        plane = adjust_plane(X, weighed(robust_weights, weights), surface=surface)
        previous, residuals = residuals, plane.evaluate(X)[0]
        # By rounding alone, two residuals differ by the rounding of both.
        least = 2 * rounding.error_of_float64(plane.direction)
        if np.abs(residuals - previous).max() <= max(TOLERANCE * scale, least):
            break
    else:
        warn_caller(
            f"The Huber estimate still moves after {MAX_ITERATIONS} adjustments; give sigma0.",
            ConvergenceWarning,
        )
    if sigma0 is None:
        scale = max(scale, rounding.least_robust_deviation(plane.direction))
    return plane, robust_weights, float(scale)


def huber(standardized):
    """Huber's weights ``min(1, k / |t|)``."""
    size, k = np.abs(standardized), HuberLimits().bend
    return np.divide(k, size, out=np.ones_like(size), where=size > k)


def robust_scale(residuals, weights, rank):
    """Standard deviation of unit weight from the median of ``sqrt(p) |v|``.

    It survives up to half of the observations off the plane, but these enlarge it. A share p of
    one-sided outliers moves the median to the ``0.5 / (1 - p)`` quantile of the clean residuals,
    a factor of 1.3 at 20 % and 2.1 at 40 %. The adjustment makes residuals smaller;
    ``sqrt(n / (n - u))`` corrects for this.
    """
    size = np.abs(residuals)
    if weights is not None:
        used = weights > 0
        size = (size * np.sqrt(weights))[used]
    n = len(size)
    if n <= rank:
        return 0.0
    median = np.median(size, overwrite_input=True)
    return float(median / NORMAL_QUARTILE * np.sqrt(n / (n - rank)))
