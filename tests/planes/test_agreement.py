"""Planes on which neighbors agree: the literal oracle, and what another seed changes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from reference import agreed_planes, neighborhood
from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.planes._consistent_set import draw_trials

FORM = {"max_outlier_rate": 0.1, "random_state": 0}


def crease(n, d):
    """Two faces that meet, one of them small, noise, and outliers."""
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (n, d))
    X[:, -1] = 0.8 * np.maximum(X[:, 0] - 0.6, 0) + rng.normal(0, 0.004, n)
    X[::9, -1] += rng.uniform(-0.3, 0.3, len(X[::9]))
    return X


@pytest.mark.parametrize("make", [MCMDOutlierDetector, RobustNormalEstimator])
@pytest.mark.parametrize(("n", "d", "k"), [(300, 3, 24), (200, 2, 20)])
def test_planes_are_those_of_the_literal_oracle(make, n, d, k):
    X = crease(n, d)
    estimator = make(k, **FORM).fit(X)
    near = np.array([neighborhood(X, point, k) for point in X])
    trials = draw_trials(estimator.n_trials_, k, random_state=0)
    expected = agreed_planes(X, near, trials, k // 2, make is RobustNormalEstimator)
    model = estimator._model
    model.agree()
    planes = model.own_planes(slice(0, n), model.index.query_own(slice(0, n)))
    center, normal, scale, _ = zip(*(expected[row] for row in model.index.rows), strict=True)
    assert_allclose(planes.scale, scale, rtol=1e-9)
    assert_allclose(planes.centroids, center, rtol=1e-9, atol=1e-12)
    assert_allclose(np.abs(np.sum(planes.normals * normal, axis=1)), 1.0, rtol=1e-9)


@pytest.mark.parametrize("is_rounded", [False, True])
def test_a_sheet_without_noise_beyond_rounding_asks_nobody(is_rounded):
    rng = np.random.default_rng(4)
    X = np.c_[rng.uniform(0, 300, (2000, 2)), np.zeros(2000)]
    if is_rounded:  # to whole numbers, with a height that is one or two off here and there
        X = np.unique(np.round(X + 0.35 * rng.normal(size=X.shape)), axis=0)
    model = RobustNormalEstimator(random_state=0).fit(X)._model
    assert (model.settings.steps.lattice > 0) == is_rounded
    assert model.offers.asks.mean() < 0.05

    X[::10, 2] += rng.uniform(5, 20, len(X[::10]))  # the opposite: where outliers are, all do
    assert RobustNormalEstimator(random_state=0).fit(X)._model.offers.asks.mean() > 0.9
