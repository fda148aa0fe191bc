"""Robust adjustment by iteratively reweighted least squares (Eqs 2-8)."""

from typing import NamedTuple

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.adjustment._least_squares import (
    adjust_plane,
    residual_rounding,
    rounding_errors,
    weighed,
)

MAX_ITERATIONS = 200  # adjustments of an M-estimate, after which it warns
TOLERANCE = 1e-6  # change of a residual, in units of the scale, at which the iteration ends
NORMAL_QUARTILE = 0.6744897501960817  # median of |v| in normal standard deviations


class LossLimits(NamedTuple):
    """Standardized residuals at which weights fall; both are 95 % efficient in normal data."""

    huber: float = 1.345  # up to which the weight is 1
    tukey: float = 4.685  # from which on the weight is 0


def m_estimate(X, weights=None, *, loss="huber", sigma0=None, surface="vertical"):
    """Plane by M-estimation: repeat the adjustment with P W until it converges (Eqs 3-7).

    "tukey" starts from Huber's plane, because its own solution depends on the start. Without
    `sigma0` the scale is the `robust_scale` of the residuals, or float64's rounding if larger.
    Returns the plane, with the kernel that propagates PW into cofactors, W and the scale.

    Eq. 5 multiplies P by the weights of iteration i - 1, not by the product of all earlier weights.
    Eq. 8's limit ``s0 sqrt(q_i p_i) t`` has a wrong dimension. Here ``sqrt(p_i) |v_i|`` is
    compared, which is the same for unit weights.
    """
    weigh = WEIGHT_FUNCTIONS[loss]
    if loss == "tukey":
        plane, _, scale = m_estimate(X, weights, sigma0=sigma0, surface=surface)
    else:
        plane, scale = adjust_plane(X, weights, surface=surface), sigma0 or 0.0
    errors = rounding_errors(X if weights is None else X[weights > 0])
    residuals = plane.evaluate(X)[0]
    for _ in range(MAX_ITERATIONS):
        floor = residual_rounding(errors, plane.direction)
        # Tukey's weights reach 0, and a scale that followed them could collapse (S-estimation
        # is another method). So the scale of Huber's plane is kept.
        if sigma0 is None and loss != "tukey":
            scale = max(robust_scale(residuals, weights, plane.rank), floor)
        standardized = residuals / max(scale, floor)
        if weights is not None:
            standardized *= np.sqrt(weights)
        robust_weights = weigh(standardized)
        equivalent = weighed(robust_weights, weights)
        if np.count_nonzero(equivalent) <= plane.rank:
            break  # too few observations left for a plane: keep the last plane
        plane = adjust_plane(X, equivalent, surface=surface)
        previous, residuals = residuals, plane.evaluate(X)[0]
        # By rounding alone, two residuals differ by the rounding of both.
        if np.abs(residuals - previous).max() <= max(TOLERANCE * scale, 2 * floor):
            break
    else:
        warn_caller(
            f"The {loss} estimate still moves after {MAX_ITERATIONS} adjustments; "
            "check sigma0, or use least squares (loss='squared_error').",
            ConvergenceWarning,
        )
    plane = plane.with_robust_weights(X, weights, robust_weights)
    if sigma0 is None:
        scale = max(scale, residual_rounding(errors, plane.direction))
    return plane, robust_weights, float(scale)


def huber(standardized):
    """Huber's weights ``min(1, k / |t|)``."""
    size, k = np.abs(standardized), LossLimits().huber
    return np.divide(k, size, out=np.ones_like(size), where=size > k)


def tukey(standardized):
    """Tukey's biweight ``(1 - (t / k)^2)^2`` within k and 0 beyond."""
    ratio = np.minimum(np.abs(standardized) / LossLimits().tukey, 1.0)
    return (1 - ratio**2) ** 2


WEIGHT_FUNCTIONS = {"huber": huber, "tukey": tukey}


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
