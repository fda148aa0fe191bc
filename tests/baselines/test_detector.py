"""The comparators as estimators, and what all of them have in common."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.baselines import Pca, PlaneOutlierDetector
from sklearn_mcmd.baselines._methods import COMPARATORS

METHODS = ["msac", "pca", "qsp", "ransac", "robpca", "ulsif"]
NEED_SHARE = ("qsp", "ulsif")
QUICK = {"robpca": {"n_trials": 50}}
SIZES = {"ulsif": 80}  # of clouds for what is slow


def wall(n=300, n_outliers=15):
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 2, (n, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (n, 3))
    X[:n_outliers, 1] += rng.uniform(0.3, 0.6, n_outliers)
    return X


def detector(method, n_neighbors=40, **parameters):
    if method in NEED_SHARE:
        parameters.setdefault("contamination", 0.05)
    parameters.setdefault("method_params", QUICK.get(method))
    parameters.setdefault("random_state", 0)
    return PlaneOutlierDetector(n_neighbors, method=method, **parameters)


def normals(method, n_neighbors=40, **parameters):
    params = {**QUICK.get(method, {}), **({"contamination": 0.05} if method in NEED_SHARE else {})}
    return RobustNormalEstimator(
        n_neighbors,
        method=method,
        method_params=None if method == "pca" else params,
        random_state=0,
        **parameters,
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_whole_cloud_is_judged_as_the_array_form_does(method):
    X = wall(80, 8)
    order = np.argsort(np.linalg.norm(X - X.mean(axis=0), axis=1), kind="stable")
    model = detector(method, None).fit(X)
    fit = COMPARATORS[method](**QUICK.get(method, {})).fit(X[order][None], random_state=0)
    assert_allclose(-model.score_samples(X)[order], fit.scores[0], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_contamination_is_the_share_that_is_flagged(method):
    labels = detector(method, contamination=0.1).fit_predict(wall())
    assert (labels == -1).sum() == 30


@pytest.mark.parametrize("method", METHODS)
def test_neighborhoods_of_different_sizes_are_judged_one_by_one(method):
    points = np.random.default_rng(0).normal(size=(4, 30, 3)) * [1, 1, 0.05]
    sizes = [30, 12, 30, 25]
    valid = np.arange(30) < np.array(sizes)[:, None]
    points[~valid] = np.nan
    comparator = COMPARATORS[method](**QUICK.get(method, {}))
    together = comparator.fit_sizes(points, np.array(sizes), comparator.seed(0))
    queries = np.random.default_rng(1).normal(size=(4, 5, 3))
    for b, size in enumerate(sizes):
        alone = comparator.fit(points[b : b + 1, :size], random_state=0)
        assert_allclose(together.scores[b, :size], alone.scores[0], rtol=1e-9, atol=1e-12)
        scores = together.score(queries)[b]
        assert_allclose(scores, alone.score(queries[b : b + 1])[0], rtol=1e-9, atol=1e-12)
        assert_allclose(together.scale[b], alone.scale[0], rtol=1e-9)
        assert_array_equal(together.inliers[b, :size], alone.inliers[0])
        assert_allclose(together.normals[b], alone.normals[0], rtol=1e-9)
    assert not together.inliers[~valid].any()


@pytest.mark.parametrize("method", ["pca", "qsp", "ulsif"])
def test_the_scale_is_the_deviation_of_the_plane_s_members(method):
    points = np.random.default_rng(0).normal(size=(4, 50, 3)) * [1, 1, 0.05]
    share = {"contamination": 0.1} if method in NEED_SHARE else {}
    fit = COMPARATORS[method](**share).fit(points, random_state=0)
    for b in range(4):
        members = points[b, fit.support[b]]
        assert len(members) == (45 if share else 50)
        distances = (members - members.mean(axis=0)) @ fit.normals[b]
        assert_allclose(fit.scale[b] ** 2, (distances**2).sum() / (len(members) - 3))


@pytest.mark.parametrize("method", METHODS)
def test_points_of_one_line_and_of_one_location_are_no_trouble(method):
    line = np.linspace(0, 1, 60)[:, None] * [1.0, 2.0, 3.0]
    for X in (line, np.ones((60, 3))):
        with np.errstate(all="raise", under="ignore"):
            scores = detector(method).fit(X).score_samples(X)
            columns = normals(method).fit(X).normals_
        assert np.isfinite(scores).all()
        assert_allclose(np.linalg.norm(columns, axis=1), 1)


def test_an_unknown_parameter_is_named_beside_the_known_ones():
    with pytest.raises(ValueError, match=r"'sigma', unknown to method 'ransac'.*noise_scale"):
        detector("ransac", method_params={"sigma": 0.1}).fit(wall())


@pytest.mark.parametrize("method", NEED_SHARE)
def test_scores_without_a_cutoff_need_a_share(method):
    with pytest.raises(ValueError, match="give the share of outliers"):
        PlaneOutlierDetector(method=method).fit(wall())
    with pytest.raises(ValueError, match="give the share of outliers"):
        RobustNormalEstimator(method=method).fit(wall())


def test_parameters_of_other_methods_are_refused():
    with pytest.raises(ValueError, match=r"method_params=.* has no meaning for method='mcmd_z'"):
        RobustNormalEstimator(method_params={"noise_scale": 1.0}).fit(wall())
    with pytest.raises(ValueError, match=r"cutoff=3.0 has no meaning for method='ransac'"):
        RobustNormalEstimator(method="ransac", cutoff=3.0).fit(wall())
    with pytest.raises(ValueError, match=r"give it as contamination=0.1"):
        detector("qsp", method_params={"contamination": 0.1}).fit(wall())


def test_neighborhoods_too_small_are_refused():
    with pytest.raises(ValueError, match="3 members are too few for planes in 3D"):
        Pca().fit(np.zeros((2, 3, 3)))
    with pytest.raises(ValueError, match="points must have shape"):
        Pca().fit(np.zeros((20, 3)))
