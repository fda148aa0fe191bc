"""The points nearest to others and to themselves, against brute force and SciPy's tree."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes import _nearest
from sklearn_mcmd.planes._nearest import NearestPoints, SelfSearch
from sklearn_mcmd.planes._neighborhoods import NeighborIndex


def brute_force(points, k):
    """Neighbors by squared distance, then by coordinates, each sum in the order of the axes."""
    dx, dy, dz = (points[:, None, i] - points[None, :, i] for i in range(3))
    squares = dx * dx + dy * dy + dz * dz
    x, y, z = (np.broadcast_to(points[:, i], squares.shape) for i in range(3))
    return np.lexsort((z, y, x, squares), axis=1)[:, :k]


def cloud(kind, n, rng):
    if kind == "street":
        return make_street(n, outlier_share=0.3, random_state=rng.integers(1000)).data
    if kind == "grid":
        side = int(np.ceil(n ** (1 / 3)))
        return np.stack(np.meshgrid(*[np.arange(side) * 1.0] * 3), axis=-1).reshape(-1, 3)
    if kind == "line":
        return np.arange(n)[:, None] * np.array([[1.0, 2.0, -1.0]])
    if kind == "clusters":  # a million to one in density
        dense, sparse = rng.normal(size=(2, n // 2, 3))
        return np.vstack([dense * 1e-6, sparse])
    if kind == "far":
        return np.vstack([rng.normal(size=(n - 1, 3)), [[1e30] * 3]])
    if kind == "sphere":  # all as far from the last
        directions = rng.normal(size=(n - 1, 3))
        return np.vstack([directions / np.linalg.norm(directions, axis=1)[:, None], [[0.0] * 3]])
    if kind == "nested":  # each leaf is denser or sparser than the one before
        return rng.normal(size=(n, 3)) * np.exp(3.0 * rng.normal(size=(n, 1)))
    if kind == "near copies":  # more of each than a leaf holds
        return np.repeat(rng.uniform(size=(n // 50, 3)), 50, axis=0) + 1e-9 * rng.random((n, 3))
    return rng.uniform(size=(n, 3)) * [1, 1, 1e-9]


KINDS = ["street", "grid", "line", "clusters", "far", "sphere", "nested", "near copies", "flat"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("k", "capacity"), [(1, 4096), (4, 4096), (50, 4096), (30, 16)])
def test_neighbors_are_those_of_brute_force(kind, k, capacity, monkeypatch):
    monkeypatch.setattr(_nearest, "CAPACITY", capacity)  # more are searched one by one
    X = cloud(kind, 700, np.random.default_rng(0))
    search = SelfSearch(X)
    assert_array_equal(search.query(slice(None), k), brute_force(search.points, k))


@pytest.mark.parametrize("scale", [1e160, 1e-160, 3e-162, 1e-200])
@pytest.mark.parametrize("k", [1, 2, 20])
@pytest.mark.filterwarnings("ignore:overflow")  # of brute force
def test_squares_may_overflow_and_underflow(scale, k):
    X = np.random.default_rng(7).normal(size=(400, 3)) * scale
    search = SelfSearch(X)
    assert_array_equal(search.query(slice(None), k), brute_force(search.points, k))


def test_parts_are_those_of_the_whole():
    search = SelfSearch(cloud("street", 5000, np.random.default_rng(2)))
    whole = search.query(slice(None), 30)
    for rows in (slice(0, 1), slice(17, 18), slice(5, 1003), slice(4990, None), slice(40, 40)):
        assert_array_equal(search.query(rows, 30), whole[rows])


@pytest.mark.parametrize("radius", [None, 0.2])
@pytest.mark.parametrize("n", [900, 3000])  # by SciPy's tree, and compiled
def test_the_index_answers_for_its_own_points_as_for_others(n, radius):
    X = cloud("street", n, np.random.default_rng(6))
    index = NeighborIndex(X, 20, radius)
    of_points, any_points = index.query_own(slice(100, 400)), index.query(index.points[100:400])
    assert_array_equal(of_points.sizes, any_points.sizes)
    valid = of_points.valid
    assert_array_equal(of_points.indices[valid], any_points.indices[valid])
    assert_array_equal(
        index.query_own(slice(0, 9), k=5).indices, index.query_own(slice(0, 9)).indices[:, :5]
    )


@pytest.mark.parametrize(
    ("n", "m", "d"), [(3000, 2000, 3), (3000, 50, 3), (300, 2000, 3), (3000, 2000, 2)]
)
@pytest.mark.parametrize("k", [1, 5, 128])
@pytest.mark.parametrize("far", [0.1, 100.0])
def test_neighbors_of_others_are_those_of_a_tree(n, m, d, k, far):
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
    chosen, before = rng.random(n) < 0.7, points.copy()
    nearest, expected = (
        NearestPoints(points, chosen),
        NearestPoints(points[chosen]).query(queries, 5),
    )
    assert_array_equal(nearest.points, points[chosen])
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
