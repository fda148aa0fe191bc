"""The index of a cloud, and who shares it."""

import copy
import gc
import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from sklearn.base import clone
from sklearn.pipeline import make_pipeline

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes import _indexed_cloud
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud, distinct_rows
from sklearn_mcmd.planes._neighborhoods import NeighborIndex


@pytest.fixture
def searched(monkeypatch):
    """How many rows are searched, and how many clouds are indexed."""
    gc.collect()  # of clouds that earlier tests have left
    counts = {"rows": 0, "clouds": 0}
    search, init = IndexedCloud.search_own, IndexedCloud.__init__

    def counted_search(self, rows, k):
        counts["rows"] += rows.stop - rows.start
        return search(self, rows, k)

    def counted_init(self, X):
        counts["clouds"] += 1
        init(self, X)

    monkeypatch.setattr(IndexedCloud, "search_own", counted_search)
    monkeypatch.setattr(IndexedCloud, "__init__", counted_init)
    return counts


STREET = make_street(3000, random_state=0).data


def cloud_with_copies(n, d, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, d))
    X[rng.integers(0, n, n // 3)] = X[0]
    X[rng.integers(0, n, n // 5)] = X[rng.integers(0, n, n // 5)]
    return X


@pytest.mark.parametrize("n", [1, 2, 5, 900, 1500, 12_000])
@pytest.mark.parametrize("d", [2, 3, 4])
def test_places_lead_back_to_each_row(n, d):
    for X in (cloud_with_copies(n, d), np.random.default_rng(1).normal(size=(n, d))):
        cloud = IndexedCloud(X)
        assert_array_equal(cloud.points[cloud.places], X)
        assert_array_equal(cloud.points, X[cloud.rows])
        assert cloud.n_distinct == len(np.unique(X, axis=0))


def test_rows_of_equal_hash_need_not_be_copies(monkeypatch):
    X = np.random.default_rng(0).integers(0, 3, (200, 3)) * 0.5
    X[:, 0] *= np.resize([1.0, -1.0], 200)  # also -0.0, which is 0.0
    expected = distinct_rows(X)
    assert len(expected[0]) == len(np.unique(X, axis=0))
    assert_array_equal(X[expected[0]][expected[1]], X)
    monkeypatch.setattr(_indexed_cloud, "_rows_of_equal_hash", lambda X: np.arange(len(X)))
    for found, wanted in zip(distinct_rows(X), expected, strict=True):
        assert_array_equal(found, wanted)


@pytest.mark.parametrize("d", [2, 3])
def test_neighbors_are_those_of_a_tree(d):
    X = np.random.default_rng(0).normal(size=(2500, d))
    cloud = IndexedCloud(X)
    expected = cKDTree(cloud.points).query(cloud.points, k=20)[1]
    assert_array_equal(cloud.neighbors(slice(None), 20, n_kept=0), expected)
    assert cloud.table is None
    rows = np.array([7, 2000, 7, 0])
    assert_array_equal(cloud.neighbors(rows, 5, n_kept=30), expected[rows, :5])
    assert cloud.table.k == 30
    assert_array_equal(cloud.neighbors(slice(None), 20, n_kept=20), expected)
    assert cloud.table.k == 30


def test_stages_of_a_pipeline_search_once(searched):
    X = STREET
    pipeline = make_pipeline(
        RobustNormalEstimator(random_state=0), RegionGrowing(normals="precomputed")
    )
    labels = pipeline.fit_predict(X)
    assert searched == {"rows": len(X), "clouds": 1}
    edges = SharpFeatureDetector(30, normals="precomputed", outlier_detector="passthrough")
    edges.fit(pipeline[0].transform(X))
    detector = MCMDOutlierDetector(random_state=0).fit(X)
    assert searched == {"rows": len(X), "clouds": 1}
    del pipeline, detector, edges
    gc.collect()
    assert_array_equal(labels, RegionGrowing(random_state=0).fit_predict(X))
    assert searched == {"rows": 2 * len(X), "clouds": 2}


def test_results_are_those_of_a_stage_alone():
    X = STREET
    alone = RobustNormalEstimator(random_state=0).fit(X).normals_.copy()
    gc.collect()
    larger = MCMDOutlierDetector(70, random_state=0).fit(X)
    shared = RobustNormalEstimator(random_state=0).fit(X)
    assert shared._model.index.cloud is larger._model.index.cloud
    assert_array_equal(shared.normals_, alone)


def test_other_points_or_another_order_are_another_cloud():
    X = STREET.copy()
    first = NeighborIndex(X, 20)
    moved = X.copy()
    moved[5, 1] += 1e-9
    assert NeighborIndex(moved, 20).cloud is not first.cloud
    assert NeighborIndex(X[::-1].copy(), 20).cloud is not first.cloud
    X[5, 1] += 1e-9  # the index has its own points
    assert NeighborIndex(X, 20).cloud is not first.cloud


def test_pickles_and_copies_are_without_the_table():
    X = STREET
    fitted = RobustNormalEstimator(random_state=0).fit(X)
    assert fitted._model.index.cloud.table is not None
    for other in (pickle.loads(pickle.dumps(fitted)), copy.deepcopy(fitted)):
        assert other._model.index.cloud.table is None
        assert_array_equal(other.transform(X[:50] + 0.001), fitted.transform(X[:50] + 0.001))
    again = clone(fitted).fit(X)
    assert again._model.index.cloud is fitted._model.index.cloud
    assert_array_equal(again.normals_, fitted.normals_)


@pytest.mark.parametrize("digits", [1, 3])
def test_queries_have_the_neighbors_of_the_points_that_they_are(digits):
    rng = np.random.default_rng(digits)
    X = np.round(rng.uniform(0, 2, (3_000, 3)), digits)  # a lattice has many ties
    cloud = IndexedCloud(X)
    own = cloud.search_own(slice(None), 12)
    for m in (0, 1, 2, 700, len(cloud.points)):
        distances, near = cloud.nearest(cloud.points[:m], 12)
        assert_array_equal(near, own[:m])
        gaps = np.linalg.norm(cloud.points[near] - cloud.points[:m, None], axis=2)
        assert_allclose(distances, gaps, rtol=1e-14, atol=0)
    copies = np.repeat(rng.uniform(0, 2, (5, 3)), 300, axis=0)
    near = cloud.nearest(copies, 12)[1].reshape(5, 300, 12)
    assert (near == near[:, :1]).all()
