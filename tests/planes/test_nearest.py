"""The points nearest to others, against SciPy's tree."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree

from sklearn_mcmd.planes import _nearest
from sklearn_mcmd.planes._nearest import NearestPoints


@pytest.mark.parametrize(
    ("n", "m", "d"), [(3000, 2000, 3), (3000, 50, 3), (300, 2000, 3), (3000, 2000, 2)]
)
@pytest.mark.parametrize("k", [1, 5, 128])
@pytest.mark.parametrize("far", [0.1, 100.0])
def test_neighbors_are_those_of_a_tree(n, m, d, k, far):
    rng = np.random.default_rng(0)
    points, queries = rng.normal(size=(n, d)), far * rng.normal(size=(m, d))
    distances, indices = NearestPoints(points).query(queries, k)
    expected = cKDTree(points).query(queries, k=k)
    assert_array_equal(distances, expected[0].reshape(m, k))
    assert_array_equal(indices, expected[1].reshape(m, k))


def test_missing_neighbors_are_infinitely_far():
    points = np.arange(6.0).reshape(2, 3)
    distances, indices = NearestPoints(points).query(points + 0.1, 4)
    assert np.isinf(distances[:, 2:]).all()
    assert_array_equal(indices[:, 2:], 2)


def test_compiled_code_and_a_tree_agree(monkeypatch):
    rng = np.random.default_rng(1)
    points, queries = rng.normal(size=(2000, 3)), rng.normal(size=(1500, 3))
    compiled = NearestPoints(points).query(queries, 20)
    monkeypatch.setattr(_nearest, "COMPILE_FROM", 10**9)
    assert_array_equal(NearestPoints(points).query(queries, 20), compiled)


def test_chunks_and_threads_change_nothing(monkeypatch):
    rng = np.random.default_rng(2)
    points, queries = rng.normal(size=(2000, 3)), rng.normal(size=(1500, 3))
    whole = NearestPoints(points).query(queries, 9)
    monkeypatch.setattr(_nearest, "CHUNK", 37)
    assert_array_equal(NearestPoints(points).query(queries, 9, n_jobs=2), whole)


@pytest.mark.parametrize("n_copies", [1, 40])
def test_queries_may_be_copies_of_each_other_and_of_points(n_copies):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(1500, 3))
    queries = np.repeat(points, n_copies, axis=0)[: 1500 * n_copies]
    distances, indices = NearestPoints(points).query(queries, 3)
    assert_array_equal(indices[:, 0], np.repeat(np.arange(1500), n_copies))
    assert_array_equal(distances[:, 0], 0)


@pytest.mark.parametrize(("n", "m"), [(3000, 2000), (300, 50)])
def test_some_of_the_points_answer_as_if_they_were_all(n, m):
    rng = np.random.default_rng(4)
    points, queries = rng.normal(size=(n, 3)), rng.normal(size=(m, 3))
    some, before = rng.random(n) < 0.7, points.copy()
    nearest, expected = NearestPoints(points, some), NearestPoints(points[some]).query(queries, 5)
    assert_array_equal(nearest.points, points[some])
    assert_array_equal(nearest.query(queries, 5), expected)
    nearest.release()
    assert_array_equal(nearest.query(queries, 5), expected)
    assert_array_equal(points, before)


@pytest.mark.parametrize("k", [1, 3, 16, 40])
def test_equally_distant_points_come_in_the_order_of_their_coordinates(monkeypatch, k):
    rng = np.random.default_rng(5)
    points = np.unique(rng.integers(0, 12, (3000, 3)), axis=0).astype(float)
    queries = rng.integers(0, 24, (1200, 3)) / 2
    shuffled = rng.permutation(len(points))
    compiled = NearestPoints(points).query(queries, k)
    monkeypatch.setattr(_nearest, "COMPILE_FROM", 10**9)
    assert_array_equal(NearestPoints(points).query(queries, k), compiled)
    distances, indices = NearestPoints(points[shuffled]).query(queries, k)
    assert_array_equal(distances, compiled[0])
    assert_array_equal(shuffled[indices], compiled[1])
