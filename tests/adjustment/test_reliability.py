"""Internal and external reliability against dense matrices, refits and simulations."""

import numpy as np
import pytest

from adjustment_clouds import slope
from reference_adjustment import redundancy_matrix
from sklearn_mcmd.adjustment import BaardaPlaneDetector, noncentrality
from sklearn_mcmd.adjustment._least_squares import adjust_plane

SIGMA = 0.01


@pytest.fixture(scope="module")
def weights():
    return np.random.default_rng(1).uniform(0.3, 3, 30)


@pytest.mark.parametrize("test", ["w", "tau", "t"])
@pytest.mark.parametrize("n", [8, 30, 200])
def test_a_bias_of_the_detectable_size_is_detected_with_the_power(n, test):
    X = slope(n)
    detector = BaardaPlaneDetector(test=test, sigma0=SIGMA, correction="none", alpha=0.001).fit(X)
    power = 0.8
    reliability = detector.reliability(X, power)
    R = redundancy_matrix(X)
    rng, m = np.random.default_rng(2), 60_000 if n < 100 else 20_000
    noise, at = rng.normal(0, SIGMA, (m, n)), rng.integers(n, size=m)
    scale = SIGMA if test == "w" else detector.variance_factor_**0.5
    # Of the true deviation, which the detector estimates by its own scale for tau and t.
    noise[np.arange(len(at)), at] += reliability.minimal_bias[at] * SIGMA / scale
    v = noise @ R
    w = v[np.arange(len(at)), at] / np.sqrt(np.diag(R)[at])
    if test == "w":
        statistic = np.abs(w) / SIGMA
    else:
        tau = np.abs(w) / np.sqrt((v**2).sum(axis=1) / (n - 3))
        f = n - 3
        statistic = tau if test == "tau" else tau * np.sqrt((f - 1) / (f - tau**2))
    found = np.mean(statistic > detector.critical_value_)
    assert found == pytest.approx(power, abs=0.011)  # six standard errors, or of fewer draws four


def test_biases_and_their_ratio_to_noise_are_the_formulas(weights):
    X = slope(30)
    detector = BaardaPlaneDetector(sigma0=SIGMA).fit(X, weights=weights)
    told = detector.reliability(X)
    r = np.diag(redundancy_matrix(X, weights))
    nc = noncentrality(told.level, told.power)
    assert told.noncentrality == nc
    np.testing.assert_allclose(told.minimal_bias, SIGMA * np.sqrt(nc / (weights * r)))
    np.testing.assert_allclose(told.bias_to_noise, np.sqrt(nc * (1 - r) / r))
    np.testing.assert_allclose(told.gross_error_deviation, SIGMA / np.sqrt(weights * r))
    np.testing.assert_allclose(told.gross_error, detector.residuals(X) / r)


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
def test_effects_are_how_far_a_refit_with_the_bias_moves_the_plane_there(surface, weights):
    X = slope(30)
    detector = BaardaPlaneDetector(sigma0=SIGMA, surface=surface).fit(X, weights=weights)
    told, plane = detector.reliability(X), detector._fitted.plane
    along = np.array([0, 0, 1.0]) if surface == "vertical" else plane.normal
    for i in (0, 7, 20):
        share = 1e-3  # of the bias: effects are of first order
        moved = X.copy()
        moved[i] += share * told.minimal_bias[i] * along
        other = adjust_plane(moved, weights, surface=surface)
        nearer = plane.evaluate(X[[i]])[0] - other.evaluate(X[[i]])[0]
        # The orthogonal plane of noisy points differs by noise over width; measured 1e-4.
        assert told.effect[i] == pytest.approx(nearer[0] / share, rel=2e-3)


def test_the_gross_error_of_a_rejected_point_is_that_of_a_mean_shift():
    linear_model = pytest.importorskip("statsmodels.regression.linear_model")
    X = slope(30)
    X[4, 2] += 0.1
    detector = BaardaPlaneDetector(sigma0=SIGMA).fit(X)
    assert np.flatnonzero(~detector.support_).tolist() == [4]
    told = detector.reliability(X)
    shift = (np.arange(30) == 4).astype(float)
    fitted = linear_model.OLS(X[:, 2], np.column_stack([X[:, :2], np.ones(30), shift])).fit()
    assert told.gross_error[4] == pytest.approx(fitted.params[3])
    deviation = fitted.bse[3] * SIGMA / np.sqrt(fitted.scale)
    assert told.gross_error_deviation[4] == pytest.approx(deviation)
    # It would have moved the plane by as much as its residual shrinks if it is adjusted, too.
    all_points = BaardaPlaneDetector(1e-9, sigma0=1.0).fit(X)
    taken = detector.residuals(X)[4] - all_points.residuals(X)[4]
    assert detector.leverage_[4] * told.gross_error[4] == pytest.approx(taken)


def test_a_point_that_nothing_controls_hides_any_error():
    X = np.array([[0.0, 0], [0, 0.01], [0, -0.01], [1, 0.5]])
    told = BaardaPlaneDetector(sigma0=SIGMA).fit(X).reliability(X)
    assert told.minimal_bias[3] == told.effect[3] == np.inf
    assert np.isnan(told.gross_error[3])
    assert np.isfinite(told.minimal_bias[:3]).all()


def test_what_cannot_be_is_refused():
    X = slope(30)
    detector = BaardaPlaneDetector(sigma0=SIGMA).fit(X)
    with pytest.raises(ValueError, match="pass the training points"):
        detector.reliability(X[1:])
    with pytest.raises(ValueError, match="is not above the level"):
        detector.reliability(X, 1e-9)
