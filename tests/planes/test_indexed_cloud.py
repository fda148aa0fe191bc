"""The index of a cloud, and who shares it."""

import copy
import gc
import pickle
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from sklearn.base import clone

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes import _indexed_cloud
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.planes._neighborhoods import NeighborIndex

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
    rng = np.random.default_rng(1)
    few = rng.integers(0, 3, (n, d)) * rng.choice([-0.5, 0.5], (n, d))  # also -0.0, which is 0.0
    for X in (cloud_with_copies(n, d), few, rng.normal(size=(n, d))):
        cloud = IndexedCloud(X)
        assert_array_equal(cloud.points[cloud.places], X)
        assert_array_equal(cloud.points, X[cloud.rows])
        assert cloud.n_distinct == len(np.unique(X, axis=0))


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


@pytest.mark.parametrize(("n", "d"), [(30, 2), (60, 2), (9, 3), (12, 3), (5, 4)])
@pytest.mark.parametrize("k", [7, 15, 50])
def test_equally_distant_neighbors_come_in_the_order_of_their_coordinates(n, d, k):
    X = np.stack(np.meshgrid(*[np.arange(float(n))] * d), axis=-1).reshape(-1, d)
    points = IndexedCloud(X).points
    for n_kept in (0, 2 * k, k):  # whatever is asked for first
        cloud = IndexedCloud(X)
        cloud.neighbors(slice(None), max(n_kept, 1), n_kept)
        near = cloud.neighbors(slice(None), k, n_kept)
        for row in range(0, len(points), max(7, len(points) // 60)):
            squares = np.square(points - points[row]).sum(axis=1)
            expected = np.lexsort((*points.T[::-1], squares))[:k]
            assert_array_equal(near[row], expected)
            assert_array_equal(cloud.nearest(points[row : row + 1], k)[1][0], expected)


def test_a_fit_does_not_depend_on_an_earlier_one_of_another_size():
    x, y = np.meshgrid(np.arange(30.0), np.arange(30.0))
    X = np.column_stack([x.ravel(), y.ravel(), x.ravel() % 7 == 0])
    first, larger, last = (RobustNormalEstimator(k, random_state=0).fit(X) for k in (15, 30, 15))
    assert larger._model.index.cloud is first._model.index.cloud
    assert_array_equal(last.normals_, first.normals_)


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
    for copied in (pickle.loads(pickle.dumps(fitted)), copy.deepcopy(fitted)):
        assert copied._model.index.cloud.table is None
        assert_array_equal(copied.transform(X[:50] + 0.001), fitted.transform(X[:50] + 0.001))
    again = clone(fitted).fit(X)
    assert again._model.index.cloud is fitted._model.index.cloud
    assert_array_equal(again.normals_, fitted.normals_)


@pytest.mark.parametrize("n", [100, 3_000])  # by SciPy's tree, and by the compiled search
def test_a_cloud_and_its_table_are_freed_at_once(n):
    gc.collect()
    gc.disable()  # which would free a cycle some time later
    try:
        cloud = IndexedCloud(STREET[:n])
        cloud.neighbors(slice(None), 12, 12)
        freed = [weakref.ref(cloud), weakref.ref(cloud.table)]
        del cloud
        assert [ref() for ref in freed] == [None, None]
    finally:
        gc.enable()


def test_threads_that_ask_together_make_one_tree(monkeypatch):
    made = []

    def make(*args, **kwargs):
        made.append(threading.get_ident())
        time.sleep(0.05)
        return cKDTree(*args, **kwargs)

    monkeypatch.setattr(_indexed_cloud, "cKDTree", make)
    cloud = IndexedCloud(STREET[:100, :2])  # which no compiled search answers
    with ThreadPoolExecutor(4) as pool:
        near = list(pool.map(lambda _: cloud.neighbors(slice(None), 5, 0), range(4)))
    assert len(made) == 1
    assert all((one == near[0]).all() for one in near)


@pytest.mark.parametrize("digits", [1, 3])
def test_queries_have_the_neighbors_of_the_points_that_they_are(digits):
    rng = np.random.default_rng(digits)
    X = np.round(rng.uniform(0, 2, (3_000, 3)), digits)  # a lattice has many ties
    cloud = IndexedCloud(X)
    expected = cloud.search_own(slice(None), 12)
    for m in (0, 1, 2, 700, len(cloud.points)):
        distances, near = cloud.nearest(cloud.points[:m], 12)
        assert_array_equal(near, expected[:m])
        gaps = np.linalg.norm(cloud.points[near] - cloud.points[:m, None], axis=2)
        assert_allclose(distances, gaps, rtol=1e-14, atol=0)
    copies = np.repeat(rng.uniform(0, 2, (5, 3)), 300, axis=0)
    near = cloud.nearest(copies, 12)[1].reshape(5, 300, 12)
    assert (near == near[:, :1]).all()
