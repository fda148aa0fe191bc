"""Least-squares planes against dense matrices and statsmodels."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import reference_adjustment as reference
from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector
from sklearn_mcmd.adjustment._least_squares import adjust_plane


def random_cloud(seed, n=None, d=None):
    rng = np.random.default_rng(seed)
    d = d or int(rng.integers(2, 6))
    n = n or int(rng.integers(d + 2, 80))
    X = rng.normal(size=(n, d)) * rng.uniform(0.1, 10, d) + rng.uniform(-100, 100, d)
    return X, rng.uniform(0.1, 10, n)


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("weighted", [False, True])
def test_redundancy_numbers_are_the_diagonal_of_the_explicit_matrix(surface, weighted):
    for seed in range(50):
        X, p = random_cloud(seed)
        p = p if weighted else None
        plane = adjust_plane(X, p, surface=surface)
        _, cofactors = plane.evaluate(X)
        leverage = cofactors if p is None else p * cofactors
        explicit = np.diag(reference.redundancy_matrix(X, p, surface))
        assert_allclose(1 - leverage, explicit, rtol=0, atol=1e-12)


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
def test_residuals_and_their_weighted_squares_are_those_of_dense_algebra(surface):
    for seed in range(50):
        X, p = random_cloud(seed)
        plane = adjust_plane(X, p, surface=surface)
        v, _, omega, rank = reference.adjustment(X, p, surface)
        residuals = plane.evaluate(X)[0]
        assert plane.rank == rank
        # The sign of a normal is a convention.
        residuals = residuals * np.sign(residuals @ v)
        assert_allclose(residuals, v, rtol=0, atol=1e-11 * np.abs(X).max())
        assert_allclose(plane.sum_of_squares, omega, rtol=1e-9)


@pytest.mark.filterwarnings("ignore:The points lie along a plane tilted by")
@pytest.mark.parametrize("test", ["tau", "t"])
def test_leverage_and_studentized_residuals_agree_with_statsmodels(test):
    linear_model = pytest.importorskip("statsmodels.regression.linear_model")
    for seed in range(20):
        X, p = random_cloud(seed, n=40)
        A = np.column_stack([X[:, :-1], np.ones(len(X))])
        # Weighted least squares is ordinary least squares of scaled rows.
        root = np.sqrt(p)
        theirs = linear_model.OLS(X[:, -1] * root, A * root[:, None]).fit().get_influence()
        ours = BaardaPlaneDetector(1e-9, test=test, correction="none").fit(X, weights=p)
        kind = {"tau": "internal", "t": "external"}[test]
        expected = getattr(theirs, f"resid_studentized_{kind}")
        assert_allclose(ours.leverage_, theirs.hat_matrix_diag, rtol=1e-10)
        assert_allclose(ours.test_statistic_, np.abs(expected), rtol=1e-9)


def test_utm_coordinates_lose_no_accuracy():
    X, _ = random_cloud(2, n=100, d=3)
    X = np.round(X, 3)
    shift = np.array([5e5, 1e7, 100.0])
    near, far = adjust_plane(X), adjust_plane(X + shift)
    assert_allclose(far.coef, near.coef, rtol=1e-8)
    assert_allclose(far.evaluate(X + shift)[1], near.evaluate(X)[1], rtol=1e-8)
    # 1e7 is stored to 2e-9.
    assert_allclose(far.evaluate(X + shift)[0], near.evaluate(X)[0], atol=1e-8)


def test_collinear_regressors_get_the_slopes_of_least_norm():
    x = np.arange(10.0)
    X = np.column_stack([x, 2 * x, 5 * x + 1])
    expected = np.linalg.pinv(X[:, :2] - X[:, :2].mean(0)) @ (X[:, 2] - X[:, 2].mean())
    assert_allclose(adjust_plane(X).coef, expected, rtol=1e-10)


@pytest.mark.parametrize("value", [0.0, 0.1, 5e6 + 0.1])
def test_a_constant_column_counts_for_nothing(value):
    x = np.linspace(0, 10, 30)
    X = np.column_stack([x, np.full(30, value), np.sin(x)])
    plane = adjust_plane(X)
    assert plane.rank == 2
    assert abs(plane.coef[1]) < 1e-20  # a slope of any size would fit


def test_squares_that_overflow_are_refused_with_a_remedy():
    X = np.random.default_rng(0).normal(size=(20, 3)) * 1e300
    with pytest.raises(ValueError, match="rescale X"):
        BaardaPlaneDetector().fit(X)


@pytest.mark.parametrize("facing", [(0, 1), (1, 0), (1, 1), (-1, 1)])
def test_noise_does_not_decide_the_side_of_a_wall(facing):
    rng, normals = np.random.default_rng(0), []
    facing = np.array(facing) / np.hypot(*facing)
    for _ in range(40):
        X = rng.uniform(-1, 1, (200, 3)) * [2, 0, 1] + rng.normal(0, 0.004, (200, 3))
        X[:, :2] = X[:, :1] * [facing[1], -facing[0]] + X[:, 1:2] * facing
        normals.append(adjust_plane(X, surface="orthogonal").normal)
    assert_allclose(normals, np.tile([*facing, 0], (40, 1)), atol=0.01)


@pytest.mark.parametrize("kind", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_the_normal_and_positive_residuals_are_on_the_side_of_a_place(kind):
    X = np.random.default_rng(0).normal(size=(100, 3)) * [3, 0.01, 2] + [10, 20, 0]
    for place, side in (([10, 0, 0], -1), ([10, 40, 0], 1)):
        detector = kind(sigma0=0.01, surface="orthogonal", toward=place).fit(X)
        assert_allclose(detector.normal_, [0, side, 0], atol=0.01)
        assert detector.residuals(np.array([place]))[0] > 0
        assert detector.distance_ == pytest.approx(20 * side, abs=0.1)
    with pytest.raises(ValueError, match=r"toward=\[1, 2\] is no place: give 3 coordinates"):
        kind(surface="orthogonal", toward=[1, 2]).fit(X)
    with pytest.raises(ValueError, match="toward is for surface='orthogonal'"):
        kind(toward=[1, 2, 3]).fit(X)
