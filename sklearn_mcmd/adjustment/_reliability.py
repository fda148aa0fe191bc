"""Reliability of a tested plane: errors that its tests can find, and what the others do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sklearn_mcmd.adjustment._least_squares import CHUNK
from sklearn_mcmd.adjustment._tests import UNCONTROLLED, noncentrality
from sklearn_mcmd.runtime._chunks import slices


@dataclass(frozen=True, eq=False)
class PlaneReliability:
    """What the tests of a plane can find, as of ``detector.reliability(X)``.

    Lengths are in units of X along the residuals. Points outside of the support are judged as if
    they joined it.

    Attributes
    ----------
    level, power, noncentrality : float
        Level of the test of one point, probability of detection, and their lambda_0.
    minimal_bias : ndarray of shape (n_samples,)
        Minimal detectable bias ``s sqrt(lambda_0 / (p r))``; infinite if nothing controls a point.
    gross_error, gross_error_deviation : ndarray of shape (n_samples,)
        Estimated error of each point if it alone is wrong, ``v / r`` in the support and the
        residual outside, with its standard error ``s / sqrt(p r)``; nan without control.
    effect : ndarray of shape (n_samples,)
        By how much an error of `minimal_bias` that stays moves the plane at its own place,
        ``1 - r`` of it. That of an error that was found is ``leverage_ * gross_error``.
    bias_to_noise : ndarray of shape (n_samples,)
        The same over the standard error, for the worst parameter: ``sqrt(lambda_0 (1 - r) / r)``.
    """

    level: float
    power: float
    noncentrality: float
    minimal_bias: NDArray[np.float64]
    gross_error: NDArray[np.float64]
    gross_error_deviation: NDArray[np.float64]
    effect: NDArray[np.float64]
    bias_to_noise: NDArray[np.float64]


def reliability_of(detector, X, power):
    """The `PlaneReliability` of a detector that was fitted to X."""
    plane, weights = detector._fitted.plane, detector._fitted.weights
    redundancy = detector.redundancy_
    level, (scale, dof_scale) = detector._level_of_one(), detector._test_scale()
    nc = noncentrality(level, power, dof_scale=dof_scale)
    p = np.ones(len(X)) if weights is None else weights
    controlled = (redundancy > UNCONTROLLED) & (p > 0)
    deviation = np.full(len(X), np.inf)  # of the estimated error of a point
    deviation[controlled] = scale / np.sqrt((p * redundancy)[controlled])
    bias = deviation * np.sqrt(nc)
    # What nothing controls moves the plane by any error; what has no weight by none.
    ratio, effect = np.where(p > 0, np.inf, 0.0), np.zeros(len(X))
    np.divide(1 - redundancy, redundancy, out=ratio, where=controlled)
    np.multiply(1 - redundancy, bias, out=effect, where=p > 0)
    # An error e of a point of the support leaves the residual r e. Outside it leaves all of e.
    share = np.where(detector.support_ & controlled, redundancy, 1.0)
    gross = np.where(controlled, 1.0, np.nan)
    for rows in slices(len(X), CHUNK):
        gross[rows] *= plane.whiten(X[rows])[1] / share[rows]
    return PlaneReliability(
        level=level,
        power=power,
        noncentrality=nc,
        minimal_bias=bias,
        gross_error=gross,
        gross_error_deviation=np.where(controlled, deviation, np.nan),
        effect=effect,
        bias_to_noise=np.sqrt(nc * np.maximum(ratio, 0)),
    )
