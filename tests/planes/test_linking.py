"""The graph of planes that explain each other, against loops taken literally."""

import numpy as np
import pytest
from joblib import parallel_config
from numpy.testing import assert_array_equal

from reference import GivenNeighbors
from sklearn_mcmd.planes._linking import LinkLimits, connected, connected_planes, row_linker
from sklearn_mcmd.planes._record import Neighborhoods, Planes
from sklearn_mcmd.runtime._chunks import each_slice


def links_of(cloud, limits, chunk=1000):
    points, neighbors, planes, usable = cloud
    index, k = GivenNeighbors(points, neighbors, chunk), neighbors.indices.shape[1]
    links, link = np.empty((len(points), k), np.int32), row_linker(index, k, planes, limits, usable)
    each_slice(len(points), index.chunk, lambda rows: link(rows, links[rows]), None)
    return links


def scene(d, n=150, k=10, seed=0):
    """Points near the sheets x_0 = 0 and x_1 = 0, their neighbors and noisy planes."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(n, d))
    sheet = rng.integers(0, 2, n)
    points[np.arange(n), sheet] = rng.normal(0, 0.01, n)
    planes = Planes(*(np.full_like(values, np.nan) for values in Planes.empty(n, d)))
    planes.centroids[:] = points + rng.normal(0, 0.02, (n, d))
    normals = np.eye(d)[sheet] + rng.normal(0, 0.1, (n, d))
    normals *= rng.choice([-1, 1], n)[:, None]
    planes.normals[:] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    planes.scale[:] = rng.uniform(0.002, 0.03, n)
    planes.scale[rng.random(n) < 0.05] = -1.0
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    indices = np.argsort(distances, axis=1)[:, :k].astype(np.int32)
    sizes = rng.integers(3, k + 1, n)
    indices = np.where(np.arange(k) < sizes[:, None], indices, indices[:, :1])
    return points, Neighborhoods(indices, sizes), planes, rng.random(n) < 0.9


LIMITS = {
    "mutual": LinkLimits(0.9),
    "one way": LinkLimits(0.9, mutual=False),
    "both near": LinkLimits(0.9, both_near=True),
    "one way, both near": LinkLimits(0.9, mutual=False, both_near=True),
    "closer": LinkLimits(0.98, explained=1.5, max_gap=0.15),
}


def literally(points, neighbors, planes, limits, usable):
    """The rows of `row_linker`, as lists."""

    def explains(i, j):
        height = abs(np.dot(points[j] - planes.centroids[i], planes.normals[i]))
        return planes.scale[i] > 0 and height <= limits.explained * planes.scale[i]

    near = [
        neighbors.indices[i, : neighbors.sizes[i]].tolist() for i in range(len(neighbors.sizes))
    ]
    rows = []
    for i in range(len(points)):
        row = []
        for j in near[i]:
            linked = i != j and usable[i] and usable[j] and explains(i, j)
            linked = linked and np.linalg.norm(points[i] - points[j]) <= limits.max_gap
            angle = abs(np.dot(planes.normals[i], planes.normals[j]))
            linked = linked and angle >= limits.min_cosine
            linked = linked and (explains(j, i) or not limits.mutual)
            if linked and (i in near[j] or not limits.both_near):
                row.append(j)
        rows.append(row)
    return rows


@pytest.mark.parametrize("d", [2, 3, 4])
@pytest.mark.parametrize("name", LIMITS)
def test_links_are_those_of_the_rules_taken_literally(name, d):
    cloud = scene(d)
    links = links_of(cloud, LIMITS[name])
    assert links.dtype == np.int32
    points, neighbors, planes, usable = cloud
    expected = literally(points, neighbors, planes, LIMITS[name], usable)
    assert [row[row >= 0].tolist() for row in links] == expected
    assert sum(map(len, expected)) > 5
    assert (np.diff((links >= 0).astype(int), axis=1) <= 0).all()  # -1 come last


def test_links_of_neighborhoods_that_are_mutual_go_both_ways():
    links = links_of(scene(3), LIMITS["both near"])
    pairs = {(i, j) for i, row in enumerate(links.tolist()) for j in row if j >= 0}
    assert pairs == {(j, i) for i, j in pairs}


def test_links_do_not_depend_on_chunks_or_threads():
    cloud = scene(3)
    whole = links_of(cloud, LIMITS["both near"])
    with parallel_config(n_jobs=2):
        parts = links_of(cloud, LIMITS["both near"], chunk=7)
    assert_array_equal(whole, parts)


@pytest.mark.parametrize("chunk", [7, 1000])
@pytest.mark.parametrize("name", LIMITS)
def test_parts_of_planes_are_those_of_their_links(name, chunk):
    points, neighbors, planes, usable = cloud = scene(3)
    expected = connected(links_of(cloud, LIMITS[name]))
    index, k = GivenNeighbors(points, neighbors, chunk), neighbors.indices.shape[1]
    found = connected_planes(index, k, planes, LIMITS[name], usable)
    assert 3 < len(expected[1]) < len(points)
    assert_array_equal(found[0], expected[0])
    assert_array_equal(found[1], expected[1])


def test_those_equally_near_as_the_last_are_near():
    """On a lattice the eight around a point are near, though a list holds only four of them."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(25)], axis=1)
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    indices = np.lexsort((np.arange(25)[None] + 0 * distances, distances))[:, :5]
    planes = Planes.unknown(25, 3)
    planes.centroids[:], planes.normals[:], planes.scale[:] = points, [0, 0, 1], 0.1
    cloud = (
        points,
        Neighborhoods(indices.astype(np.int32), np.full(25, 5)),
        planes,
        np.ones(25, bool),
    )
    links = links_of(cloud, LIMITS["both near"])
    far = distances[np.arange(25), indices[:, -1]]
    for i, row in enumerate(links):
        near = [j for j in indices[i] if j != i and distances[i, j] <= far[j]]
        assert row[row >= 0].tolist() == near


def parts_literally(links):
    """Labels by spreading the least row of each part until none changes."""
    labels = np.arange(len(links))
    while True:
        before = labels.copy()
        for i, j in zip(*np.nonzero(links >= 0), strict=True):
            least = min(labels[i], labels[links[i, j]])
            labels[i] = labels[links[i, j]] = least
        if (before == labels).all():
            return np.unique(labels, return_inverse=True)[1]


@pytest.mark.parametrize("seed", range(5))
def test_parts_are_those_found_by_spreading_labels(seed):
    rng = np.random.default_rng(seed)
    links = np.sort(rng.integers(-6, 300, (300, 2)), axis=1)[:, ::-1]
    links = np.where(rng.random((300, 1)) < 0.4, links, -1)
    links = np.where(links < 0, -1, links).astype(np.int32)
    labels, sizes = connected(links)
    expected = parts_literally(links)
    assert 5 < len(sizes) < 300
    assert_array_equal(labels, expected)
    assert_array_equal(sizes, np.bincount(expected))


def test_parts_do_not_depend_on_the_order_of_points_and_links():
    rng = np.random.default_rng(0)
    links = np.where(rng.random((400, 1)) < 0.5, rng.integers(0, 400, (400, 1)), -1)
    links = links.astype(np.int32)
    labels, _ = connected(links)
    order = rng.permutation(400)
    place = np.argsort(order)
    moved = np.where(links[order] >= 0, place[links[order]], -1).astype(np.int32)
    again, _ = connected(moved)
    pairs = np.unique(np.column_stack([labels[order], again]), axis=0)
    assert len(pairs) == labels.max() + 1 == again.max() + 1


def test_no_links_make_each_point_a_part():
    labels, sizes = connected(np.full((4, 0), -1, np.int32))
    assert_array_equal(labels, range(4))
    assert_array_equal(sizes, np.ones(4))
    labels, sizes = connected(np.empty((0, 3), np.int32))
    assert len(labels) == len(sizes) == 0
