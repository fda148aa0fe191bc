"""Whose plane explains a point, and the graph of planes that do, against loops taken literally."""

import numpy as np
import pytest
from joblib import parallel_config
from numpy.testing import assert_allclose, assert_array_equal
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from reference import GivenNeighbors
from scenes import planes_around
from sklearn_mcmd.planes._explaining import (
    LinkLimits,
    connected,
    connected_planes,
    explain,
    row_linker,
)
from sklearn_mcmd.planes._record import Neighborhoods, Planes
from sklearn_mcmd.runtime._chunks import each_slice

KINDS = ["plain", "ties", "sizes", "zero scales", "no planes", "unusable", "far away"]


def scene(kind, d):
    """Queries, candidates, planes, usable and least."""
    _, queries, candidates, planes = planes_around(kind, d)
    rng = np.random.default_rng(1)
    usable = rng.random(len(planes.scale)) < (0.25 if kind == "unusable" else 1.0)
    least = rng.uniform(0, 0.02, len(queries))
    if kind == "zero scales":  # at distance 0 / 0
        least[:], queries[::2] = 0.0, planes.centroids[candidates.indices[::2, 0]]
    return queries, candidates, planes, usable, least


def literally(queries, candidates, planes, usable, least, likely):
    """One query and one plane at a time."""
    owners, distances = [], []
    for query, row, size, add in zip(queries, *candidates, least, strict=True):
        best = np.inf, -1, np.inf
        for i in row[:size]:
            gap = query - planes.centroids[i]
            if not usable[i] or np.sqrt((gap**2).sum()) > planes.radius[i]:
                continue
            deviation = np.hypot(planes.scale[i], add)
            if deviation == 0 or (likely and planes.scale[i] <= 0):
                continue  # no distance is a number of its deviations
            distance = cost = abs(gap @ planes.normals[i]) / deviation
            if likely:  # minus the logarithm of a normal density
                cost = np.log(deviation) + distance**2 / 2
            if cost < best[0]:
                best = cost, i, distance
        owners.append(best[1])
        distances.append(best[2])
    return np.array(owners), np.array(distances)


@pytest.mark.parametrize("likely", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_the_owner_is_the_one_that_a_literal_loop_finds(d, kind, likely):
    explained = explain(*scene(kind, d), likely)
    owners, distances = literally(*scene(kind, d), likely)
    assert_array_equal(explained[0], owners)
    assert_allclose(explained[1], distances, rtol=1e-9, atol=1e-12)
    assert (owners == -1).all() if kind == "far away" else (owners >= 0).sum() > 20


def links_of(cloud, limits, chunk=1000):
    points, neighbors, planes, usable = cloud
    index, k = GivenNeighbors(points, neighbors, chunk), neighbors.indices.shape[1]
    links, link = np.empty((len(points), k), np.int32), row_linker(index, k, planes, limits, usable)
    each_slice(len(points), index.chunk, lambda rows: link(rows, links[rows]), None)
    return links


def sheets(d, n=150, k=10, seed=0):
    """Points near the sheets x_0 = 0 and x_1 = 0, their neighbors and noisy planes."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(n, d))
    sheet = rng.integers(0, 2, n)
    points[np.arange(n), sheet] = rng.normal(0, 0.01, n)
    planes = Planes.unknown(n, d)
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


MUTUAL = LinkLimits(min_cosine=0.9, explained=3.0, max_gap=np.inf, mutual=True, both_near=False)
LIMITS = {
    "mutual": MUTUAL,
    "one way": MUTUAL._replace(mutual=False),
    "both near": MUTUAL._replace(both_near=True),
    "one way, both near": MUTUAL._replace(mutual=False, both_near=True),
    "closer": MUTUAL._replace(min_cosine=0.98, explained=1.5, max_gap=0.15),
}


def links_literally(points, neighbors, planes, limits, usable):
    """The rows of `row_linker`, as lists."""

    def explains(i, j):
        height = abs(np.dot(points[j] - planes.centroids[i], planes.normals[i]))
        return planes.scale[i] > 0 and height <= limits.explained * planes.scale[i]

    near = [row[:size].tolist() for row, size in zip(*neighbors, strict=True)]
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
    cloud = sheets(d)
    links = links_of(cloud, LIMITS[name])
    assert links.dtype == np.int32
    points, neighbors, planes, usable = cloud
    expected = links_literally(points, neighbors, planes, LIMITS[name], usable)
    assert [row[row >= 0].tolist() for row in links] == expected
    assert sum(map(len, expected)) > 5
    assert ((links == -1) | (links == neighbors.indices)).all()  # each in its place


@pytest.mark.parametrize("chunk", [7, 1000])
@pytest.mark.parametrize("name", LIMITS)
def test_parts_of_planes_are_those_of_their_links_in_any_chunks_and_threads(name, chunk):
    points, neighbors, planes, usable = cloud = sheets(3)
    links = links_of(cloud, LIMITS[name])
    with parallel_config(n_jobs=2):
        assert_array_equal(links_of(cloud, LIMITS[name], chunk), links)
    labels, sizes = connected(links)
    index, k = GivenNeighbors(points, neighbors, chunk), neighbors.indices.shape[1]
    joined = connected_planes(index, k, planes, LIMITS[name], usable)
    assert 3 < len(sizes) < len(points)
    assert_array_equal(joined[0], labels)
    assert_array_equal(joined[1], sizes)


def test_those_equally_near_as_the_last_are_near():
    """On a lattice the eight around a point are near, though a list holds only four of them."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(25)], axis=1)
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    indices = np.lexsort((np.arange(25)[None] + 0 * distances, distances))[:, :5]
    planes = Planes.unknown(25, 3)
    planes.centroids[:], planes.normals[:], planes.scale[:] = points, [0, 0, 1], 0.1
    around = Neighborhoods(indices.astype(np.int32), np.full(25, 5))
    links = links_of((points, around, planes, np.ones(25, bool)), LIMITS["both near"])
    far = distances[np.arange(25), indices[:, -1]]
    for i, row in enumerate(links):
        near = [j for j in indices[i] if j != i and distances[i, j] <= far[j]]
        assert row[row >= 0].tolist() == near


@pytest.mark.parametrize(("n", "seed"), [(0, 0), *((300, seed) for seed in range(4))])
def test_parts_are_those_that_scipy_finds_in_the_order_of_their_first_points(n, seed):
    rng = np.random.default_rng(seed)
    links = np.sort(rng.integers(-6, 300, (n, 2)), axis=1)[:, ::-1]
    links = np.where(rng.random((n, 1)) < 0.4, links, -1)
    links = np.where(links < 0, -1, links).astype(np.int32)
    labels, sizes = connected(links)
    rows, places = np.nonzero(links >= 0)
    graph = coo_array((np.ones(len(rows)), (rows, links[rows, places])), (n, n))
    expected = connected_components(graph, directed=False)[1] if n else []
    assert len(sizes) < max(n, 1)
    assert_array_equal(labels, expected)
    assert_array_equal(sizes, np.unique(expected, return_counts=True)[1])
