"""Searches over cells find what a search in the whole cloud finds."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.tiling import _search
from sklearn_mcmd.tiling._cells import CellWriter
from sklearn_mcmd.tiling._search import as_near_as, visit_nearest, within_reach


class Scattered:
    """An uneven, rounded cloud in cells, of whose points every third is not meant."""

    def __init__(self, folder, n=3_000, capacity=250):
        rng = np.random.default_rng(0)
        dense, sparse = rng.normal(0, 0.05, (n // 2, 3)), rng.uniform(-5, 5, (n // 2, 3))
        self.xyz = np.unique(np.round(np.vstack([dense, sparse]), 2), axis=0)
        writer = CellWriter(folder, capacity)
        writer.add(self.xyz, 0)
        self.cells = writer.close()
        self.meant = self.xyz[np.arange(len(self.xyz)) % 3 != 0]
        self.read = []

    def load(self, cell):
        self.read.append(cell)
        records = self.cells.read(cell)
        rows = np.flatnonzero(records["row"] % 3 != 0)
        return records["xyz"][rows], rows


@pytest.fixture
def cloud(tmp_path):
    return Scattered(tmp_path)


def as_set(points):
    return set(map(tuple, points))


def assert_places(cloud, found):
    """Cells and rows tell where points lie."""
    for point, cell, row in zip(found.points, *found.places, strict=True):
        assert_array_equal(cloud.cells.read(cell)["xyz"][row], point)


def test_all_points_within_reach_are_found_and_none_far_beyond(cloud):
    rng = np.random.default_rng(1)
    queries, reach = rng.uniform(-5, 5, (60, 3)), 10.0 ** rng.uniform(-2, 0.3, 60)
    found = within_reach(cloud.cells, cloud.load, queries, reach)
    gaps = np.linalg.norm(cloud.meant[:, None] - queries, axis=2)
    least, most = (cloud.meant[(gaps <= width).any(axis=1)] for width in (reach, 1.001 * reach))
    assert as_set(found.points) >= as_set(least)
    assert as_set(found.points) <= as_set(most)
    assert len(as_set(found.points)) == len(found.points)
    assert_places(cloud, found)


def test_cells_beyond_reach_are_not_read(cloud):
    within_reach(cloud.cells, cloud.load, np.full((1, 3), 4.5), np.array([0.4]))
    assert 0 < len(cloud.read) < len(cloud.cells) / 3


def test_nothing_is_found_for_no_queries(cloud):
    nothing = np.empty((0, 3)), np.empty(0)
    assert len(within_reach(cloud.cells, cloud.load, *nothing).points) == 0
    assert len(as_near_as(cloud.cells, cloud.load, nothing[0], 5, nothing[1]).points) == 0


@pytest.mark.parametrize("k", [1, 30])
@pytest.mark.parametrize("bounded", [False, True])
@pytest.mark.parametrize("at_once", [100, 10**6])
def test_the_nearest_are_among_those_as_near(cloud, k, bounded, at_once, monkeypatch):
    monkeypatch.setattr(_search, "AT_ONCE", at_once)
    queries = np.random.default_rng(2).uniform(-9, 9, (40, 3))
    distances = cKDTree(cloud.meant).query(queries, np.arange(1, k + 1))[0]
    bounds = 1.5 * distances[:, -1] if bounded else np.full(len(queries), np.inf)
    bounds[3] *= 100
    found = as_near_as(cloud.cells, cloud.load, queries, k, bounds)
    again = cKDTree(found.points).query(queries, np.arange(1, k + 1))[0]
    assert_array_equal(again, distances)


@pytest.mark.parametrize("k", [1, 17, 300])
def test_each_query_is_visited_once_with_its_nearest_in_the_whole_cloud(cloud, k, monkeypatch):
    monkeypatch.setattr(_search, "AT_ONCE", 2_000)
    expected = NearestPoints(cloud.meant)
    for cell in range(0, len(cloud.cells), 4):
        queries = np.vstack([cloud.cells.read(cell)["xyz"], [[70.0, 0, 0]]])
        distances, near = expected.query(queries, k)
        seen = np.zeros(len(queries), int)

        def work(rows, gaps, found_near, found, d=distances, near=near, seen=seen):
            seen[rows] += 1
            assert_array_equal(gaps, d[rows])
            assert_array_equal(found.points[found_near], cloud.meant[near[rows]])

        visit_nearest(cloud.cells, cloud.load, cell, queries, k, work)
        assert (seen == 1).all()


def test_missing_neighbors_are_infinitely_far(cloud):
    k = len(cloud.meant) + 5

    def work(rows, gaps, near, found):
        assert np.isinf(gaps[:, -5:]).all()
        assert (near[:, -5:] == len(found.points)).all()
        assert np.isfinite(gaps[:, :-5]).all()

    visit_nearest(cloud.cells, cloud.load, 0, np.zeros((2, 3)), k, work)
