"""Regions that grow in cells are those that grow in one piece, whatever links and cells are."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from sklearn_mcmd import RegionGrowing
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.segmentation._estimator import renumbered
from sklearn_mcmd.segmentation._graph import grow_regions
from sklearn_mcmd.tiling import _memory, _tiled_growing, process_files
from sklearn_mcmd.tiling._stored_columns import CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_offers import FACES
from tiled import street, written


class GivenGraph:
    """An index and a job of places of which neighbors, links, ranks and copies are given."""

    def __init__(self, folder, near, is_linked, rank, counts, cell, min_size=1):
        self.near, self.links, self.rank = near, np.where(is_linked, near, -1), rank
        self.counts, self.n_neighbors, self.n_threads = counts, near.shape[1], 1
        self.cells = SimpleNamespace(counts=np.bincount(cell))
        self.columns = CellColumns(folder)
        for i, size in enumerate(self.cells.counts):
            self.columns.finish(i, "places", n_places=int(size))
        self.growing = RegionGrowing(max_gap=1.0, min_region_size=min_size)

    def whole(self):
        return StoredColumns(self.columns, len(self.cells.counts))

    def query_own(self, rows, k):
        return Neighborhoods(self.near[rows].copy(), None)

    def labels(self, memory=1e9):
        """Those that cells find."""

        self.whole().make(**FACES)

        def sweep(name, work):
            for cell in np.flatnonzero(self.cells.counts):
                if name == "reach":  # which is known
                    self.whole().put(cell, counts=self.counts[self.whole().rows(cell)])
                else:
                    self.columns.keep(cell, name, work(cell, self) or {})

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(_tiled_growing, "_index_of", lambda job: job)
            patch.setattr(_tiled_growing, "links_of", lambda *known: self.links[known[4]].copy())
            patch.setattr(_tiled_growing, "_order_of", lambda _, rows: np.argsort(self.rank[rows]))
            _tiled_growing.grow_in_cells(sweep, self, memory)
        return self.whole().rows_of("labels", slice(None))


def literally(links, rank, counts, min_size):
    """Labels by size: each point has the first of all points from which links lead to it."""
    seed, order = np.full(len(links), -1), np.argsort(rank)
    for start in order:
        waiting = [start] if seed[start] < 0 else []
        while waiting:
            i = waiting.pop()
            seed[i] = start
            waiting += [j for j in links[i] if j >= 0 and seed[j] < 0]
    sizes = {s: counts[seed == s].sum() for s in order if s in seed}
    large = sorted((s for s in sizes if sizes[s] >= min_size), key=lambda s: -sizes[s])
    return np.array([large.index(s) if s in large else -1 for s in seed])


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_labels_are_those_of_one_piece_for_random_links_ranks_and_cells(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    n, k, n_cells = rng.integers(5, 80), rng.integers(2, 5), rng.integers(1, 6)
    near = np.array([rng.permutation(n)[:k] for _ in range(n)], np.int32)
    if rng.random() < 0.5:  # long chains, in one direction
        near[:-1, 0] = np.arange(1, n)
        near[:-1, 1:][near[:-1, 1:] == near[:-1, :1]] = 0
        near[0, 1:] = rng.permutation(np.arange(2, n))[: k - 1]
    links = rng.random((n, k)) < rng.choice([0.2, 0.5, 0.9])
    twice = (near[:, :, None] == near[:, None]) & np.tri(k, k=-1, dtype=bool)
    links &= ~twice.any(axis=2)
    cell, rank = np.sort(rng.integers(0, n_cells, n)), rng.permutation(n)
    if rng.random() < 0.5:  # places of one cell are anywhere in the graph
        place = rng.permutation(n)
        near, links = place[near[np.argsort(place)]].astype(np.int32), links[np.argsort(place)]
    counts, min_size = rng.integers(1, 4, n), rng.integers(1, 6)
    graph = GivenGraph(
        tmp_path_factory.mktemp("cells"), near, links, rank, counts, cell, int(min_size)
    )
    found = graph.labels()
    assert_array_equal(found, literally(graph.links, rank, counts, min_size))
    grown = grow_regions(graph.links, np.argsort(rank))
    assert_array_equal(found, renumbered(grown, counts, min_size))


@pytest.mark.parametrize("flattest", [0, 5, 9])
def test_a_region_crosses_a_border_back_and_forth_by_links_of_one_direction(flattest, tmp_path):
    """Links lead from 0 to 5, to 1, to 6 and so on, and places from 5 on are of another cell."""
    way = np.arange(10).reshape(2, 5).T.ravel()
    near = np.full((10, 2), -1, np.int32)
    near[way[:-1], 0], near[way, 1] = way[1:], way
    near[way[-1], 0] = way[0]
    rank = np.arange(1, 11)[::-1].copy()
    rank[flattest] = 0
    links = np.tile([True, False], (10, 1))
    links[way[-1], 0] = False
    graph = GivenGraph(tmp_path, near, links, rank, np.ones(10, int), np.repeat([0, 1], 5))
    behind = way[way.tolist().index(flattest) :]
    labels = graph.labels()
    assert len(set(labels[behind])) == 1
    assert_array_equal(labels, literally(graph.links, rank, graph.counts, 1))


def test_a_region_too_small_in_each_cell_may_be_large_enough_in_all(tmp_path):
    """Three places in each of two cells, by a link between these; and three alone in a third."""
    near = np.array([[1], [2], [3], [4], [5], [0], [7], [8], [6]], np.int32)
    known = near, np.ones((9, 1), bool), np.arange(9), np.ones(9, int), np.repeat([0, 1, 2], 3)
    assert_array_equal(GivenGraph(tmp_path, *known, 6).labels(), [0] * 6 + [-1] * 3)


def test_parts_of_regions_are_refused_where_they_take_more_than_the_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(_memory, "PART_OR_LINK", 1e15)
    path, growing = written(tmp_path, street(3_000)), RegionGrowing(20, random_state=0)
    with pytest.raises(ValueError, match=r"parts of surfaces, groups or regions .* more than mem"):
        process_files(path, tmp_path / "b.las", growing, tile_size=1_000)
