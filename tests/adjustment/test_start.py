"""The robust start finds the plane of the majority."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adjustment_clouds import plane_with_outliers
from sklearn_mcmd.adjustment import BaardaPlaneDetector


def robust(X, weights=None, **options):
    return BaardaPlaneDetector(robust_start=True, random_state=0, **options).fit(X, weights=weights)


def with_a_bad_corner(share=0.45, n=600, size=15.0):
    X = plane_with_outliers(n, 0)
    bad = np.argsort(np.hypot(X[:, 0], X[:, 1]))[: int(share * n)]
    X[bad, 2] += size
    return X, np.isin(np.arange(n), bad)


@pytest.mark.parametrize(
    ("share", "n", "test"),
    [(0.45, 600, "w"), (0.4, 600, "tau"), (0.3, 25_000, "w")],  # the last by a sample
)
def test_outliers_gathered_in_a_corner_are_found_and_do_not_move_the_plane(share, n, test):
    X, bad = with_a_bad_corner(share, n)
    detector = robust(X, test=test)
    residuals = np.abs(detector.residuals(X))
    # Good points are within 5 sigma, outliers at 15.
    assert residuals[~bad].max() < 5.5
    assert residuals[bad].min() > 9
    assert ((detector.labels_ == -1) != bad).sum() <= 1


def test_the_scale_is_not_enlarged_by_separate_outliers_and_unbiased_without():
    assert_allclose(robust(with_a_bad_corner(0.35, 2000)[0], sigma0="auto").sigma0_, 1, atol=0.08)
    clean = [plane_with_outliers(1000, 0, seed=seed) for seed in range(5)]
    assert_allclose(np.mean([robust(X, sigma0="auto").sigma0_ for X in clean]), 1, atol=0.03)


def test_points_of_weight_zero_have_no_say():
    X, bad = with_a_bad_corner()
    weights = np.where(bad, 0.0, 1.0)
    first = robust(X, weights)
    X[bad] = 1e5
    assert_array_equal(first.coef_, robust(X, weights).coef_)


@pytest.mark.filterwarnings("ignore:The points that pass are as thick as they are wide")
@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("n", [4, 5, 6, 7])
def test_a_handful_of_points_has_a_start(n, surface):
    for seed in range(20):
        X = np.random.default_rng(seed).normal(size=(n, 3))
        detector = robust(X, sigma0="auto", surface=surface)
        assert detector.support_.sum() >= 3
        assert detector.sigma0_ > 0
