"""Reliability of a tested plane: errors that its tests can find, and what the others do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sklearn_mcmd.adjustment._least_squares import CHUNK
from sklearn_mcmd.adjustment._power import identifiable_bias, noncentrality
from sklearn_mcmd.adjustment._tests import UNCONTROLLED, critical_value
from sklearn_mcmd.runtime._chunks import slices

FEW = 20  # points, of more the correlations of tests are too small to tell


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
    pairs : ndarray of int of shape (n_worst, 2)
        Points of the largest statistics, and those whose tests are correlated most with theirs.
        None of 20 points and more, whose tests are nearly independent.
    correlation, identifiable_bias : ndarray of shape (n_worst,)
        Correlation of the two statistics, and least bias of the first that is rejected and not
        mistaken for one of the second, with the same power.
    """

    level: float
    power: float
    noncentrality: float
    minimal_bias: NDArray[np.float64]
    gross_error: NDArray[np.float64]
    gross_error_deviation: NDArray[np.float64]
    effect: NDArray[np.float64]
    bias_to_noise: NDArray[np.float64]
    pairs: NDArray[np.intp]
    correlation: NDArray[np.float64]
    identifiable_bias: NDArray[np.float64]


def reliability_of(detector, X, power, n_worst):
    """The `PlaneReliability` of a detector that was fitted to X."""
    plane, weights = detector._fitted.plane, detector._fitted.weights
    redundancy, statistics = detector.redundancy_, detector.test_statistic_
    level, (scale, dof_scale) = detector._level_of_one(), detector._test_scale()
    nc = noncentrality(level, power, dof_scale=dof_scale)
    p = np.ones(len(X)) if weights is None else weights
    controlled = (redundancy > UNCONTROLLED) & (p > 0)
    inside = detector.support_ & controlled
    deviation = np.full(len(X), np.inf)
    deviation[controlled] = scale / np.sqrt((p * redundancy)[controlled])
    bias = deviation * np.sqrt(nc)
    ratio = np.where(p > 0, np.inf, 0.0)
    np.divide(1 - redundancy, redundancy, out=ratio, where=controlled)
    gross, effect = np.where(controlled, 1.0, np.nan), np.zeros(len(X))
    np.multiply(1 - redundancy, bias, out=effect, where=p > 0)
    for rows in slices(len(X), CHUNK):
        gross[rows] *= plane.whiten(X[rows])[1] / np.where(inside[rows], redundancy[rows], 1.0)
    n_compared = min(n_worst, np.count_nonzero(controlled)) if len(X) < FEW else 0
    worst = np.argsort(np.where(controlled, -statistics, np.inf), kind="stable")[:n_compared]
    partners, correlation = _partners(plane, X, p, redundancy, inside, worst)
    critical = critical_value("w", level, 1)
    identifiable = [identifiable_bias(rho, critical, power) for rho in correlation]
    return PlaneReliability(
        level=level,
        power=power,
        noncentrality=nc,
        minimal_bias=bias,
        gross_error=gross,
        gross_error_deviation=np.where(controlled, deviation, np.nan),
        effect=effect,
        bias_to_noise=np.sqrt(nc * np.maximum(ratio, 0)),
        pairs=np.column_stack([worst, partners]),
        correlation=correlation,
        identifiable_bias=np.maximum(deviation[worst] * identifiable, bias[worst]),
    )


def _partners(plane, X, p, redundancy, inside, rows):
    """Of some rows, the points of the support whose statistics are correlated most with theirs, and
    the correlations ``-h_ij sqrt(p_i p_j / (r_i r_j))``; -1 and 0 without any.

    A row that joins the support shrinks its cofactors by ``1 + p_i h_ii``, and adds ``p_i p_j
    h_ij^2`` over this to other redundancy numbers. Which point is correlated most stays the same.
    """
    if len(rows) == 0:
        return rows, np.empty(0)
    design = plane.design(plane.whiten(X)[0])
    products, at = design[rows] @ design.T, np.arange(len(rows))
    squares = products**2 * np.where(inside, p / np.where(inside, redundancy, 1.0), 0.0)
    squares[at, rows] = 0.0
    partners = squares.argmax(axis=1)
    weight, joins = p[rows] * p[partners], ~inside[rows]
    shrink = np.where(joins, 1 / (1 + p[rows] * products[at, rows]), 1.0)
    products = products[at, partners]
    grown = redundancy[partners] + joins * weight * products**2 * shrink
    alone = squares[at, partners] == 0
    grown[alone] = 1.0
    correlation = -products * shrink * np.sqrt(weight / (grown * redundancy[rows]))
    return np.where(alone, -1, partners), np.clip(np.where(alone, 0.0, correlation), -1.0, 1.0)
