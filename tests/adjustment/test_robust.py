"""M-estimation by reweighting against its own equations and scikit-learn's."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn.linear_model import HuberRegressor

from adjustment_clouds import plane_with_outliers
from sklearn_mcmd.adjustment._least_squares import adjust_plane
from sklearn_mcmd.adjustment._robust import m_estimate


@pytest.fixture
def cloud():
    return plane_with_outliers(300, 30, 20.0, sigma=0.1)


@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
def test_the_plane_is_the_adjustment_with_its_own_equivalent_weights(cloud, surface):
    plane, weights, _ = m_estimate(cloud, sigma0=0.1, surface=surface)
    again = adjust_plane(cloud, weights, surface=surface)
    assert_allclose(again.coef, plane.coef, rtol=1e-6)


def test_huber_agrees_with_scikit_learn_for_its_scale(cloud):
    theirs = HuberRegressor(epsilon=1.345, alpha=0, tol=1e-10, max_iter=1000).fit(
        cloud[:, :2], cloud[:, 2]
    )
    plane, _, _ = m_estimate(cloud, sigma0=theirs.scale_)
    assert_allclose(plane.coef, theirs.coef_, atol=1e-4)
    assert_allclose(plane.intercept, theirs.intercept_, atol=1e-3)


@pytest.mark.parametrize(("n_outliers", "low", "high"), [(0, 0.94, 1.06), (1000, 1.2, 1.5)])
def test_a_fifth_of_one_sided_outliers_enlarges_the_robust_scale_by_a_third(n_outliers, low, high):
    # The median of 5000 has a standard error of 1.6 %.
    rng = np.random.default_rng(4)
    X = np.column_stack([rng.uniform(size=(5000, 2)), rng.normal(size=5000)])
    X[:n_outliers, 2] += 20
    assert low < m_estimate(X)[2] < high
