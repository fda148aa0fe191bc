"""SelfSearch: exact neighbors of points among themselves, against brute force and SciPy's tree."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._self_search import SelfSearch


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
@pytest.mark.parametrize("k", [1, 4, 50])
def test_neighbors_are_those_of_brute_force(kind, k):
    X = cloud(kind, 700, np.random.default_rng(0))
    search = SelfSearch(X)
    assert_array_equal(search.query(slice(None), k), brute_force(search.points, k))


@pytest.mark.parametrize("kind", KINDS)
def test_distances_are_those_of_scipy_to_the_last_bit(kind):
    X = cloud(kind, 20_000, np.random.default_rng(1))
    search = SelfSearch(X)
    indices = search.query(slice(None), 20)
    gaps = search.points[indices] - search.points[:, None]
    squares = gaps[..., 0] ** 2 + gaps[..., 1] ** 2 + gaps[..., 2] ** 2
    expected, _ = cKDTree(search.points).query(search.points, 20)
    assert_array_equal(np.sqrt(squares), expected)


@settings(max_examples=30)
@given(
    n=st.integers(20, 300),
    k=st.integers(1, 20),
    step=st.sampled_from([0.0, 0.25]),
    shift=st.floats(-1e6, 1e6),
    seed=st.integers(0, 1000),
)
def test_neighbors_of_any_cloud(n, k, step, shift, seed):
    X = np.random.default_rng(seed).normal(size=(n, 3)) + shift
    if step:
        X = np.unique(np.round(X / step) * step, axis=0)
    k = min(k, len(X))
    search = SelfSearch(X)
    assert_array_equal(search.query(slice(None), k), brute_force(search.points, k))


@pytest.mark.parametrize("scale", [1e160, 1e-160, 3e-162, 1e-200])
@pytest.mark.parametrize("k", [1, 2, 20])
@pytest.mark.filterwarnings("ignore:overflow")  # of brute force
def test_squares_may_overflow_and_underflow(scale, k):
    X = np.random.default_rng(7).normal(size=(400, 3)) * scale
    search = SelfSearch(X)
    assert_array_equal(search.query(slice(None), k), brute_force(search.points, k))


def test_the_points_are_those_of_the_cloud_in_another_order():
    X = cloud("street", 1000, np.random.default_rng(8))
    before = X.copy()
    search = SelfSearch(X)
    assert_array_equal(X, before)
    assert_array_equal(np.sort(search.order), np.arange(len(X)))
    assert_array_equal(search.points, X[search.order])


def test_parts_are_those_of_the_whole():
    search = SelfSearch(cloud("street", 5000, np.random.default_rng(2)))
    whole = search.query(slice(None), 30)
    for rows in (slice(0, 1), slice(17, 18), slice(5, 1003), slice(4990, None), slice(40, 40)):
        assert_array_equal(search.query(rows, 30), whole[rows])


def test_too_many_candidates_are_searched_one_by_one(monkeypatch):
    X = cloud("street", 5000, np.random.default_rng(3))
    expected = SelfSearch(X).query(slice(None), 30)
    monkeypatch.setattr("sklearn_mcmd.planes._self_search.CAPACITY", 16)
    assert_array_equal(SelfSearch(X).query(slice(None), 30), expected)


def test_the_order_of_rows_does_not_matter_where_distances_tie():
    X = cloud("grid", 1728, np.random.default_rng(4))
    shuffled = np.random.default_rng(5).permutation(X)
    one, other = SelfSearch(X), SelfSearch(shuffled)
    first, second = np.lexsort(one.points.T), np.lexsort(other.points.T)
    near = one.points[one.query(slice(None), 20)][first]
    assert_array_equal(other.points[other.query(slice(None), 20)][second], near)


@pytest.mark.parametrize("radius", [None, 0.2])
@pytest.mark.parametrize("n", [900, 3000])  # by SciPy's tree, and compiled
def test_the_index_answers_for_its_own_points_as_for_others(n, radius):
    X = cloud("street", n, np.random.default_rng(6))
    index = NeighborIndex(X, 20, radius)
    own, any_points = index.query_own(slice(100, 400)), index.query(index.points[100:400])
    assert_array_equal(own.sizes, any_points.sizes)
    valid = own.valid
    assert_array_equal(own.indices[valid], any_points.indices[valid])
    assert_array_equal(
        index.query_own(slice(0, 9), k=5).indices, index.query_own(slice(0, 9)).indices[:, :5]
    )


@pytest.mark.parametrize("n", [1, 16, 17, 100, 399, 5000])
def test_all_leaves_of_the_tree_are_full_but_one(n):
    tree = SelfSearch(np.random.default_rng(0).normal(size=(n, 3))).tree
    sizes, inner = tree.last - tree.first, tree.left >= 0
    assert_array_equal(np.sort(tree.leaves), np.flatnonzero(~inner))
    assert_array_equal(np.sort(sizes[~inner])[1:], 16)
    children = np.concatenate([tree.left[inner], tree.left[inner] + 1])
    assert_array_equal(np.sort(children), np.arange(1, len(sizes)))


def test_points_are_copied_unless_they_may_be_overwritten():
    X = np.random.default_rng(0).normal(size=(500, 3))
    before = X.copy()
    search = SelfSearch(X)
    assert_array_equal(X, before)
    again = SelfSearch(X, overwrite=True)
    assert again.points is X
    assert_array_equal(X, search.points)
