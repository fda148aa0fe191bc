"""The robust start finds the plane of the majority."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adjustment_clouds import plane_with_outliers
from sklearn_mcmd.adjustment import _start


def start(X, used=None, sigma0=1.0, surface="vertical", weights=None, random_state=0):
    used = np.ones(len(X), dtype=bool) if used is None else used
    return _start.robust_start(
        X, weights, used, rank=X.shape[1], surface=surface, sigma0=sigma0,
        random_state=random_state,
    )  # fmt: skip


def with_a_bad_corner(share=0.45, n=600, size=15.0):
    X = plane_with_outliers(n, 0)
    bad = np.argsort(np.hypot(X[:, 0], X[:, 1]))[: int(share * n)]
    X[bad, 2] += size
    return X, np.isin(np.arange(n), bad)


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
def test_the_most_coplanar_half_has_few_outliers(surface):
    X, bad = with_a_bad_corner(0.3, size=30.0)
    members = _start._robust_start_plane(_start._stretched(X), 0)
    assert members.sum() == _start.half_of(600, 3) == 302
    assert members[bad].mean() < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_the_plane_is_that_of_the_good_points(seed):
    X, bad = with_a_bad_corner()
    plane, _ = start(X, random_state=seed)
    residuals = np.abs(plane.evaluate(X)[0])
    # Good points are within 4 sigma, outliers at 15.
    assert residuals[~bad].max() < 5
    assert residuals[bad].min() > 9


def test_the_scale_is_not_enlarged_by_separate_outliers():
    X, _ = with_a_bad_corner(0.35, n=2000)
    assert_allclose(start(X, sigma0=None)[1], 1, atol=0.08)


def test_the_scale_of_clean_points_is_unbiased():
    scales = [start(plane_with_outliers(1000, 0, seed=s), sigma0=None)[1] for s in range(5)]
    assert_allclose(np.mean(scales), 1, atol=0.03)


def test_a_known_scale_is_kept():
    assert start(plane_with_outliers(100, 0), sigma0=0.7)[1] == 0.7


def test_points_of_weight_zero_have_no_say():
    X, bad = with_a_bad_corner(0.45)
    weight = np.where(bad, 0.0, 1.0)
    plane, _ = start(X, used=~bad, weights=weight)
    X[bad] = 1e5
    again, _ = start(X, used=~bad, weights=weight)
    assert_array_equal(plane.coef, again.coef)


def test_clouds_beyond_the_sample_size_are_decided_on_a_sample(monkeypatch):
    monkeypatch.setattr(_start, "MAX_POINTS", 200)
    X, bad = with_a_bad_corner(0.3, n=5000)
    members = _start._robust_start_plane(_start._stretched(X), 0)
    assert members.sum() == _start.half_of(5000, 3)
    assert members[bad].mean() < 0.05


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("n", [4, 5, 6, 7])
def test_a_handful_of_points_has_a_start(n, surface):
    for seed in range(20):
        X = np.random.default_rng(seed).normal(size=(n, 3))
        plane, sigma = start(X, sigma0=None, surface=surface)
        assert plane.n_observations >= 3
        assert sigma > 0
