"""Largest distance from an exact plane that rounding to float64 can give its points."""

import numpy as np


def rounding_errors(X):
    """Largest rounding error of float64 in each coordinate of the points of an exact plane.

    The unit is a step of float64 at the largest coordinate of a column (9.3e-10 at 5e6, 1.8e-15 at
    10). A coordinate is rounded by 1/2 when it is stored. If it was computed from the others, its d
    terms were rounded by up to ``d / 2`` more. The center that is subtracted is rounded by up to 1.
    Then a residual is computed from centered coordinates, which are no larger than the extent of
    the cloud. It takes d products and d - 1 sums along a direction that is itself rounded, which
    adds ``(d + 1) eps`` of the extent.
    """
    d = X.shape[1]
    low, high = X.min(axis=0), X.max(axis=0)
    with np.errstate(over="ignore"):
        extent = high - low
    steps = np.spacing(np.maximum(np.abs(low), np.abs(high)))
    return (d + 3) / 2 * steps + (d + 1) * np.finfo(float).eps * extent


def residual_rounding(errors, direction):
    """Length below which a residual is only rounding, from `rounding_errors` of its coordinates.

    The direction is `PlaneAdjustment.direction`: on a steep vertical surface the rounding of the
    regressors enters the residuals.
    """
    return max(float(np.abs(direction) @ errors), np.finfo(float).tiny)
