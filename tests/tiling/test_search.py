"""Searches over cells find what a search in the whole cloud finds."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.tiling import _search
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._cells import CellWriter
from sklearn_mcmd.tiling._search import StoredNearest
from sklearn_mcmd.tiling._stored_columns import StoredColumns


class Scattered:
    """An uneven, rounded cloud in cells, of whose points every third is not meant."""

    def __init__(self, folder):
        rng = np.random.default_rng(0)
        dense, sparse = rng.normal(0, 0.05, (1_500, 3)), rng.uniform(-5, 5, (1_500, 3))
        writer, columns = CellWriter(folder, 250), CellColumns(folder)
        writer.add(np.unique(np.round(np.vstack([dense, sparse]), 2), axis=0), 0)
        self.cells = writer.close()
        for cell in range(len(self.cells)):
            points = self.cells.read(cell)["xyz"]
            columns.write(cell, points=points)
            columns.finish(cell, "places", n_places=len(points))
        whole = StoredColumns(columns, len(self.cells))
        whole.join("points")
        chosen = np.arange(len(whole)) % 3 != 0
        self.search = StoredNearest(whole, self.cells, chosen)
        self.meant = whole.open("points")[chosen]


@pytest.fixture
def cloud(tmp_path):
    return Scattered(tmp_path)


@pytest.mark.parametrize("k", [1, 17, 300])
def test_each_query_is_visited_once_with_its_nearest_in_the_whole_cloud(cloud, k, monkeypatch):
    monkeypatch.setattr(_search, "AT_ONCE", 2_000)
    expected = NearestPoints(cloud.meant)
    for cell in range(0, len(cloud.cells), 4):
        queries = np.vstack([cloud.cells.read(cell)["xyz"], [[70.0, 0, 0]]])
        distances, near = expected.query(queries, k)
        seen = np.zeros(len(queries), int)

        def work(rows, gaps, found, d=distances, near=near, seen=seen):
            seen[rows] += 1
            assert_array_equal(gaps, d[rows])
            assert_array_equal(cloud.meant[found], cloud.meant[near[rows]])

        cloud.search.visit_in(cell, queries, k, work)
        assert (seen == 1).all()


def test_queries_of_many_cells_find_their_nearest(cloud):
    queries = np.random.default_rng(2).uniform(-9, 9, (200, 3))
    found, expected = cloud.search.query(queries, 9), NearestPoints(cloud.meant).query(queries, 9)
    assert_array_equal(found[0], expected[0])
    assert_array_equal(cloud.meant[found[1]], cloud.meant[expected[1]])


def test_cells_beyond_reach_are_not_read(cloud, monkeypatch):
    read, load = [], cloud.search._load
    monkeypatch.setattr(cloud.search, "_load", lambda cell: read.append(cell) or load(cell))
    cloud.search.query(np.full((1, 3), 4.5), 3)
    assert 0 < len(read) < len(cloud.cells) / 3


def test_missing_neighbors_are_infinitely_far(cloud):
    n = len(cloud.meant)
    gaps, near = cloud.search.query(np.zeros((2, 3)), n + 5)
    assert np.isinf(gaps[:, -5:]).all()
    assert (near[:, -5:] == n).all()
    assert np.isfinite(gaps[:, :-5]).all()
