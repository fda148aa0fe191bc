"""Region growing: shapes with truth, invariances, parameters, attributes, bad input."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import clone
from sklearn.metrics import adjusted_rand_score
from sklearn.pipeline import make_pipeline

from benchmarks.simulators import make_bus_stop, make_traffic_furniture
from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street

N_STRAY = 9  # fewer than make a region


def steps(rng, n=8000, height=0.2):
    """Road, kerb and footpath: two floors at different heights and the riser between them."""
    surface = rng.choice(3, n, p=[0.48, 0.1, 0.42])
    u, v = rng.uniform(0, 1, (2, n))
    X = np.choose(
        surface[:, None],
        [
            np.column_stack([2 * u, v, 0 * u]),
            np.column_stack([2 * u, 0 * u + 1, height * v]),
            np.column_stack([2 * u, 1 + 0.8 * v, 0 * u + height]),
        ],
    )
    return X + rng.normal(0, 0.002, X.shape), surface


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_road_kerb_and_footpath_are_three_regions(seed):
    X, surface = steps(np.random.default_rng(seed))
    growing = RegionGrowing(random_state=seed).fit(X)
    assert growing.n_regions_ == 3
    # What remains are points on the two edges, which lie on both faces.
    assert adjusted_rand_score(surface, growing.labels_) > 0.96


@pytest.mark.parametrize("make", [make_bus_stop, make_street, make_traffic_furniture])
def test_regions_follow_the_density_by_themselves(make):
    scene = make(20_000, outlier_share=0.1, random_state=0)
    inlier = scene.target == 1
    labels = RegionGrowing(random_state=0).fit_predict(scene.data[inlier])
    assert adjusted_rand_score(scene.surface[inlier], labels) > 0.97


# ---- What must not matter --------------------------------------------------------------------


@pytest.fixture(scope="module")
def street():
    """Steps with stray points; and the columns of their normals."""
    rng = np.random.default_rng(7)
    X, _ = steps(rng, 4000)
    X = np.vstack([X, rng.uniform([0, 0, 0.3], [2, 2, 1], (N_STRAY, 3))])
    return X, RobustNormalEstimator(random_state=0).fit_transform(X)


def test_terraces_four_steps_of_rounding_apart_are_two_regions():
    X = np.random.default_rng(0).uniform(0, 1, (2000, 3)) * [1.0, 0.5, 0.0]
    upper = X[:, 0] > 0.5
    X[upper, 2] = 0.04
    labels = RegionGrowing(random_state=0).fit_predict(np.rint(X / 0.01) * 0.01)
    assert adjusted_rand_score(upper, labels) == 1.0


def test_three_places_measured_twice_are_one_region():
    X = np.vstack([np.eye(3), np.eye(3)])  # fewer places than a plane in 3D has points
    normals = RobustNormalEstimator(5, random_state=0)
    growing = RegionGrowing(5, min_region_size=1, normal_estimator=normals).fit(X)
    assert growing.labels_.tolist() == [0] * 6


# ---- Parameters ------------------------------------------------------------------------------


def test_regions_of_too_few_points_are_dissolved(street):
    _, columns = street
    every, large = (
        RegionGrowing(min_region_size=least, normals="precomputed", refine=False).fit(columns)
        for least in (1, 50)
    )
    assert every.labels_.min() == 0
    kept = every.region_sizes_ >= 50
    assert 0 < kept.sum() < every.n_regions_
    assert_array_equal(large.labels_, np.where(kept[every.labels_], every.labels_, -1))


def test_stray_points_belong_to_no_region(street):
    _, columns = street
    labels = RegionGrowing(normals="precomputed").fit_predict(columns)
    assert (labels[-N_STRAY:] == -1).all()
    assert (labels[:-N_STRAY] == -1).mean() < 0.01


# ---- Attributes ------------------------------------------------------------------------------


def test_region_planes_are_those_of_singular_value_decomposition(street):
    X, columns = street
    growing = RegionGrowing(normals="precomputed").fit(columns)
    for region in range(growing.n_regions_):
        points = X[growing.labels_ == region]
        centroid = points.mean(axis=0)
        _, values, axes = np.linalg.svd(points - centroid, full_matrices=False)
        assert_allclose(growing.region_centroids_[region], centroid, atol=1e-10)
        assert_allclose(abs(growing.region_normals_[region] @ axes[2]), 1.0, rtol=1e-9)
        assert growing.region_normals_[region, 2] >= 0  # they point up
        error = values[2] / np.sqrt(len(points))
        assert_allclose(growing.region_errors_[region], error, rtol=1e-6)


# ---- scikit-learn ----------------------------------------------------------------------------


def test_a_pipeline_and_a_nested_estimator_give_the_same(street):
    X, _ = street
    normals = RobustNormalEstimator(40, method="mcmd_md", random_state=3)
    pipeline = make_pipeline(clone(normals), RegionGrowing(normals="precomputed"))
    nested = RegionGrowing(normal_estimator=normals).fit(X)
    assert_array_equal(pipeline.fit_predict(X), nested.labels_)
    assert not hasattr(normals, "normals_")  # it was cloned
    assert_array_equal(nested.normal_estimator_.normals_.shape, X.shape)


# ---- Bad input -------------------------------------------------------------------------------


def test_columns_that_are_not_the_transformers_are_refused(street):
    _, columns = street
    scaled = (columns - columns.mean(axis=0)) / columns.std(axis=0)
    for wrong in (columns[:, :3], scaled, columns[:, ::-1], columns[:, :11]):
        with pytest.raises(ValueError, match=r'normals="precomputed" but the \d+ columns'):
            RegionGrowing(normals="precomputed").fit(wrong)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_handful_of_precomputed_points_gets_an_answer(street, n):
    labels = RegionGrowing(normals="precomputed", min_region_size=1).fit_predict(street[1][:n])
    assert labels.shape == (n,)
    assert labels.min() >= 0
