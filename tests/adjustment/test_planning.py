"""Simulated snooping decides as the detector does, and its rates are what theory says."""

import numpy as np
import pytest

import reference_adjustment as reference
from sklearn_mcmd.adjustment import BaardaPlaneDetector, critical_value, local_level, plan_plane
from sklearn_mcmd.adjustment._planning import _snooped, _started
from sklearn_mcmd.adjustment._start import StartLimits, half_of


def simulated(n, k, bias, m, seed=0):
    rng = np.random.default_rng(seed)
    X = np.concatenate([rng.uniform(-1, 1, (m, n, 2)), rng.normal(size=(m, n, 1))], axis=2)
    X[:, :k, 2] += bias
    return X


def limits_of(n, alpha=0.05):
    return np.array([critical_value("w", local_level(alpha, i), 1) for i in range(n + 2)])


def snooped(X, corners=None):
    design, limits = np.array(X), limits_of(X.shape[1])
    design[..., 2] = 1
    member = np.ones(X.shape[:2], dtype=bool)
    if corners is not None:
        member = _started(design, X[..., 2], corners, limits[X.shape[1]])
    return _snooped(design, X[..., 2], member, limits)


@pytest.mark.parametrize(("n", "k", "bias"), [(6, 1, 4), (30, 1, 4), (60, 12, 6), (40, 18, 12)])
def test_verdicts_are_those_of_the_detector(n, k, bias):
    X = simulated(n, k, bias, 60)
    expected = [BaardaPlaneDetector().fit(one).labels_ == -1 for one in X]
    np.testing.assert_array_equal(snooped(X), expected)


def deviations(A, z, member, of_new=True):
    """Of all points from the plane of members, by default in standard deviations of a new point."""
    inverse = np.linalg.inv(A[member].T @ A[member])
    sizes = np.abs(z - A @ (inverse @ A[member].T @ z[member]))
    return sizes / np.sqrt(1 + of_new * np.einsum("ij,jk,ik->i", A, inverse, A))


def test_robust_starts_from_the_same_corners_are_those_of_general_least_squares():
    n, half, limits, rng = 13, half_of(13, 3), limits_of(13), np.random.default_rng(0)
    for X in simulated(n, 5, 6, 60):
        A, z, best = np.column_stack([X[:, :2], np.ones(n)]), X[:, 2], np.inf
        corners = np.stack([rng.choice(n, 3, replace=False) for _ in range(3)])
        for rows in corners:
            sizes = np.abs(z - A @ np.linalg.solve(A[rows], z[rows]))
            nearest = sizes <= np.sort(sizes)[half - 1]
            if (sizes[nearest] ** 2).sum() < best:
                best, member = (sizes[nearest] ** 2).sum(), nearest
        for _ in range(20):  # concentration
            sizes = deviations(A, z, member, of_new=False)
            member = sizes <= np.sort(sizes)[half - 1]
        for most in [StartLimits().cut] * 20 + [limits[n]]:  # reweighting
            inside = deviations(A, z, member) <= most
            member = inside if inside.sum() > 3 else member
        member &= reference.snoop(X, member.astype(float), alpha=0.05) == 0
        expected = deviations(A, z, member) > limits[member.sum() + 1]
        np.testing.assert_array_equal(snooped(X[None], corners[None])[0], expected)


def test_outcomes_are_all_that_can_happen_and_the_level_is_kept():
    plan = plan_plane(50, n_repetitions=4000, random_state=0)
    outcomes = [plan.correct, plan.missed, plan.wrongly_excluded, plan.over_excluded]
    assert sum(value for value, _ in outcomes) == pytest.approx(1)
    # Sidak's level is that of independent tests; correlations make it a little smaller.
    assert plan.false_alarm[0] == pytest.approx(0.05, abs=4 * plan.false_alarm[1] + 0.003)


def test_an_error_of_the_smallest_bias_is_found_with_the_power():
    plan = plan_plane(50, n_repetitions=4000, power=0.7, random_state=0)
    assert plan.found[0] == pytest.approx(0.7, abs=4 * plan.found[1])
    # A little more than by the formula of one test, since other points are tested as well.
    assert 0.98 * plan.minimal_bias < plan.bias[0] < 1.1 * plan.minimal_bias
    given = plan_plane(50, n_repetitions=4000, bias=plan.bias[0], random_state=0)
    assert given.found == pytest.approx(plan.found, abs=1e-3)
    assert given.bias == (plan.bias[0], 0.0)


def test_lengths_scale_and_the_robust_start_survives_what_least_squares_does_not():
    options = {"outlier_rate": 0.45, "bias": 0.4, "n_repetitions": 500, "random_state": 0}
    plain, robust = (BaardaPlaneDetector(sigma0=0.04, robust_start=x) for x in (False, True))
    plans = [plan_plane(60, detector, **options) for detector in (plain, robust)]
    assert plans[0].n_outliers == 27
    assert plans[1].found[0] > 0.99 > plans[0].found[0]
    assert plans[0] == plan_plane(60, plain, **options)


def test_where_no_bias_is_found_so_often_it_is_infinite():
    # Six points, three of them off: no test can tell which half is right.
    plan = plan_plane(6, outlier_rate=0.499, n_repetitions=200, random_state=0)
    assert plan.bias == (np.inf, np.inf)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"n_points": 4}, "'n_points' parameter"),
        ({"power": 1e-6}, "power=1e-06 is not above"),
        ({"detector": BaardaPlaneDetector(sigma0="auto")}, "a known scale: give sigma0"),
        ({"detector": BaardaPlaneDetector(2.0)}, "'alpha' parameter"),
        ({"outlier_rate": 0.5}, "'outlier_rate' parameter"),
    ],
)
def test_what_cannot_be_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        plan_plane(**options)
