"""Reliability of a tested plane: errors that its tests can find, and what the others do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sklearn_mcmd.adjustment._least_squares import CHUNK
from sklearn_mcmd.adjustment._power import coupled_level, identifiable_bias, noncentrality
from sklearn_mcmd.adjustment._precision import parameter_derivatives, tilt_direction
from sklearn_mcmd.adjustment._tests import UNCONTROLLED, critical_value
from sklearn_mcmd.runtime._chunks import slices


@dataclass(frozen=True, eq=False)
class PlaneReliability:
    """What the tests of a plane can find, as of ``detector.reliability(X)``.

    Lengths are in units of X along the residuals, angles in degrees. Points outside of the support
    are judged as if they joined it; they have no effect on the plane, which does without them.

    Attributes
    ----------
    level, power, noncentrality : float
        Level of the test of one point, probability of detection, and their lambda_0.
    coupled_level : float
        Level of the global test with this noncentrality and power (B-method).
    minimal_bias : ndarray of shape (n_samples,)
        Minimal detectable bias ``s sqrt(lambda_0 / (p r))``; infinite if nothing controls a point.
    gross_error, gross_error_deviation : ndarray of shape (n_samples,)
        Estimated error of each point if it alone is wrong, ``v / r`` in the support and the
        residual outside, with its standard error ``s / sqrt(p r)``; nan without control.
    effect_on_normal, effect_on_offset, effect_on_tilt : ndarray of shape (n_samples,)
        By how much an error of `minimal_bias` that stays turns the plane, moves it across itself at
        the center of its points, and tilts it.
    bias_to_noise : ndarray of shape (n_samples,)
        The same over the standard error, for the worst parameter: ``sqrt(lambda_0 (1 - r) / r)``.
    pairs : ndarray of int of shape (n_worst, 2)
        Points of the largest statistics, and those whose tests are correlated most with theirs.
    correlation, identifiable_bias : ndarray of shape (n_worst,)
        Correlation of the two statistics, and least bias of the first that is rejected and not
        mistaken for one of the second, with the same power.
    """

    level: float
    power: float
    noncentrality: float
    coupled_level: float
    minimal_bias: NDArray[np.float64]
    gross_error: NDArray[np.float64]
    gross_error_deviation: NDArray[np.float64]
    effect_on_normal: NDArray[np.float64]
    effect_on_offset: NDArray[np.float64]
    effect_on_tilt: NDArray[np.float64]
    bias_to_noise: NDArray[np.float64]
    pairs: NDArray[np.intp]
    correlation: NDArray[np.float64]
    identifiable_bias: NDArray[np.float64]


def reliability_of(detector, X, power, n_worst):
    """The `PlaneReliability` of a detector that was fitted by least squares to X."""
    plane, weights = detector._fitted.plane, detector._fitted.weights
    redundancy, statistics = detector.redundancy_, detector.test_statistic_
    known, level = detector.test_ == "w", detector._level_of_one()
    scale = detector.sigma0_ if known else detector._fitted.scale
    nc = noncentrality(level, power, dof_scale=np.inf if known or plane.dof < 2 else plane.dof - 1)
    p = np.ones(len(X)) if weights is None else weights
    controlled = (redundancy > UNCONTROLLED) & (p > 0)
    inside = detector.support_ & controlled
    deviation = np.full(len(X), np.inf)
    deviation[controlled] = scale / np.sqrt((p * redundancy)[controlled])
    bias = deviation * np.sqrt(nc)
    gross, weighted = np.where(controlled, 1.0, np.nan), np.zeros(len(X))
    weighted[inside] = p[inside] * bias[inside]
    normal, offset, tilt = np.zeros((3, len(X)))
    derivatives, steepest = parameter_derivatives(plane), tilt_direction(plane.normal)
    turns = np.degrees(derivatives[:-1].T)
    tilts = turns @ steepest
    worst = _largest(np.where(controlled, statistics, -np.inf), n_worst)
    own, share = plane.design(plane.whiten(X[worst])[0]), np.zeros(len(X))
    share[inside] = p[inside] / redundancy[inside]
    partners, most = np.full(len(worst), -1), np.zeros(len(worst))
    for rows in slices(len(X), CHUNK):
        U, residuals = plane.whiten(X[rows])
        gross[rows] *= residuals / np.where(inside[rows], redundancy[rows], 1.0)
        # An error e of observation i changes the whitened parameters by g_i p_i e.
        design = plane.design(U)
        turn = design @ turns
        normal[rows] = weighted[rows] * np.sqrt(np.einsum("ij,ij->i", turn, turn))
        offset[rows] = weighted[rows] * abs(design[0, 0] * derivatives[-1, 0])
        tilt[rows] = weighted[rows] * np.abs(design @ tilts)
        _take_partners(own, design, share[rows], rows.start, worst, partners, most)
    if np.isnan(tilts).any():  # a horizontal plane tilts into any direction
        tilt[:] = normal
    ratio = np.where(detector.support_ & (p > 0), np.inf, 0.0)
    np.divide(1 - redundancy, redundancy, out=ratio, where=inside)
    for effect in (normal, offset, tilt):
        effect[np.isinf(ratio)] = np.inf
    others = plane.design(plane.whiten(X[partners])[0])
    correlation = _correlation(own, others, p, redundancy, ~inside[worst], worst, partners)
    critical = critical_value("w", level, 1)
    identifiable = [identifiable_bias(rho, critical, power) for rho in correlation]
    return PlaneReliability(
        level=level,
        power=power,
        noncentrality=nc,
        coupled_level=coupled_level(level, max(plane.dof, 1), power),
        minimal_bias=bias,
        gross_error=gross,
        gross_error_deviation=np.where(controlled, deviation, np.nan),
        effect_on_normal=normal,
        effect_on_offset=offset,
        effect_on_tilt=tilt,
        bias_to_noise=np.sqrt(nc * np.maximum(ratio, 0)),
        pairs=np.column_stack([worst, partners]),
        correlation=correlation,
        identifiable_bias=np.maximum(deviation[worst] * identifiable, bias[worst]),
    )


def _largest(values, n):
    """Rows of the n largest finite values, the largest first, of equal ones the first."""
    n = min(n, np.count_nonzero(values > -np.inf))
    rows = np.argpartition(-values, n - 1)[:n] if n else np.array([], dtype=int)
    return rows[np.lexsort([rows, -values[rows]])]


def _take_partners(own, design, share, start, worst, partners, most):
    """Of each worst point, take the point of a chunk whose statistic is correlated most with it."""
    squares = np.square(own @ design.T) * share
    mine = (worst >= start) & (worst < start + len(design))
    squares[mine, worst[mine] - start] = 0.0
    columns, found = np.arange(len(worst)), squares.argmax(axis=1)
    better = squares[columns, found] > most
    most[better], partners[better] = squares[columns, found][better], found[better] + start


def _correlation(own, others, p, redundancy, joins, rows, partners):
    """Correlations of statistics, ``-h_ij sqrt(p_i p_j / (r_i r_j))``; 0 without a partner.

    A row that joins the support shrinks its cofactors by ``1 + p_i h_ii``, and adds ``p_i p_j
    h_ij^2`` over this to other redundancy numbers. Which point is correlated most stays the same.
    """
    products, weight = np.einsum("ij,ij->i", own, others), p[rows] * p[partners]
    shrink = np.where(joins, 1 / (1 + p[rows] * np.einsum("ij,ij->i", own, own)), 1.0)
    grown = redundancy[partners] + joins * weight * products**2 * shrink
    correlation = -products * shrink * np.sqrt(weight / (grown * redundancy[rows]))
    return np.clip(np.where(partners < 0, 0.0, correlation), -1.0, 1.0)
