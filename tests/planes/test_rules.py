"""Rules by name: each is what its literal form says, compiled or not."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import reference
from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd._choices import OutlierMethod, RuleMethod, choices_of
from sklearn_mcmd.planes._consistent_set import draw_trials
from sklearn_mcmd.planes._local_planes import LocalPlaneModel, PlaneSettings
from sklearn_mcmd.planes._nearest import COMPILE_FROM
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._rules import METHODS, Rule, pca

K, N_TRIALS = 20, 30
# Below and above what is compiled in 3D.
SIZES = [500, 3000]


def rough_cloud(n, d):
    """A bent surface with noise and a tenth of points off it."""
    rng = np.random.default_rng(10 * d)
    X = rng.uniform(-1, 1, (n, d))
    X[:, -1] = 0.2 * X[:, 0] ** 2 + 0.01 * rng.normal(size=n)
    X[::10, -1] += rng.uniform(0.05, 0.5, len(X[::10]))
    return X


def fitted(method, n, d):
    """A cloud, and the planes and distances of each of its points by the paper's form of a rule."""
    assert min(SIZES) < COMPILE_FROM <= max(SIZES)
    X, trials = rough_cloud(n, d), draw_trials(N_TRIALS, K, 0)
    cutoff = METHODS[method].default_cutoff(d)
    settings = PlaneSettings(method, np.finfo(float).eps, cutoff=cutoff)
    return X, LocalPlaneModel(NeighborIndex(X, K), trials, settings).evaluate_fitted(X)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("method", METHODS)
def test_every_rule_is_its_literal_form(method, n, d):
    assert method in reference.RULES, "tests/reference.py lacks the literal form of this rule"
    X, (planes, distances) = fitted(method, n, d)
    trials = draw_trials(N_TRIALS, K, 0)
    assert (planes.kept == 1).all() == (method == "pca")
    for row in np.linspace(0, n - 1, 12).astype(int):
        distance, normal, values = reference.saliency(
            X, X[row], K, trials, K // 2, method, METHODS[method].default_cutoff(d)
        )
        assert_allclose(distances[row], distance, rtol=1e-6)
        assert_allclose(abs(planes.normals[row] @ normal), 1, rtol=1e-9)
        assert_allclose(planes.eigenvalues[row], values, rtol=1e-6, atol=1e-12)


@pytest.fixture(params=[True, False], ids=["of a consistent set", "of all members"])
def tripled(request, monkeypatch):
    """A rule without a compiled form, with a third of the scale of the one that it is made of."""
    base = "mcmd_z" if request.param else "pca"

    def apply(*neighborhoods):
        centers, whitening = METHODS[base].apply(*neighborhoods)
        return centers, 3 * whitening

    rule = METHODS[base]._replace(apply=apply, compiled=False)
    monkeypatch.setitem(METHODS, "tripled", rule)
    for estimator in (MCMDOutlierDetector, RobustNormalEstimator):
        monkeypatch.setitem(estimator._parameter_constraints, "method", [str])
    return base


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("n", SIZES)
def test_a_rule_without_a_compiled_form_is_computed_and_not_another(n, d, tripled):
    (_, (_, thrice)), (_, (_, once)) = (fitted(method, n, d) for method in ("tripled", tripled))
    assert_allclose(thrice, 3 * once, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("n", [300, COMPILE_FROM])
def test_estimators_take_a_rule_without_a_compiled_form(n, tripled):
    X = rough_cloud(n, 3)
    detector = MCMDOutlierDetector(K, method="tripled", random_state=0).fit(X)
    assert detector.predict(X[:1] + 5) == -1  # a new point has its planes, too
    assert np.isfinite(detector.scores_).all()
    normals = RobustNormalEstimator(K, method="tripled", random_state=0).fit(X).normals_
    assert np.median(abs(normals[:, 2])) > 0.9


def test_a_compiled_form_that_is_not_there_is_an_error(monkeypatch):
    rule = Rule(pca, lambda d: 2.5, False, lambda *_: 1.0, compiled=True)
    monkeypatch.setitem(METHODS, "absent", rule)
    with pytest.raises(KeyError, match="absent"):
        fitted("absent", max(SIZES), 3)


def test_estimators_take_the_rules_that_are_there():
    assert choices_of(RuleMethod) == METHODS.keys()
    robust = {name for name, rule in METHODS.items() if rule.needs_consistent_set}
    assert choices_of(OutlierMethod) == robust
    for estimator, names in ((MCMDOutlierDetector, robust), (RobustNormalEstimator, METHODS)):
        for name in names:
            estimator(method=name)._validate_params()
