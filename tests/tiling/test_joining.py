"""Parts of a graph that are joined across cells are those of the whole graph."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._joining import join_parts, parts_of_cell

LEAST = 12


@pytest.mark.parametrize("n_links", [0, 150, 400])
def test_sizes_are_those_of_the_whole_graph(tmp_path, n_links):
    rng = np.random.default_rng(n_links)
    n, n_cells, columns = 300, 5, Columns(tmp_path)
    ends, weights = rng.integers(0, n, (n_links, 2)), rng.integers(1, 4, n)
    taken = rng.random(n) < 0.9
    ends = ends[taken[ends].all(axis=1)]
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(n, n))
    whole = connected_components(graph, directed=False)[1]
    sizes = np.bincount(whole, weights * taken)
    cell_of = rng.integers(0, n_cells, n)
    row_of = np.array([np.count_nonzero(cell_of[:i] == cell_of[i]) for i in range(n)])
    for cell in range(n_cells):
        own = np.flatnonzero(cell_of == cell)
        inner = ends[(cell_of[ends] == cell).all(axis=1)]
        graph = coo_array((np.ones(len(inner)), row_of[inner].T), shape=(len(own), len(own)))
        labels = np.where(taken[own], connected_components(graph, directed=False)[1], -1)
        # Each link out of the cell is known to one of both cells only.
        out = ends[(cell_of[ends[:, 0]] == cell) & (cell_of[ends[:, 1]] != cell)]
        rows, others = row_of[out[:, 0]], out[:, 1]
        parts = parts_of_cell(labels, weights[own], rows, cell_of[others], row_of[others])
        columns.write(cell, **{f"part_{name}": values for name, values in parts._asdict().items()})
    assert join_parts(columns, n_cells, "part", LEAST) == sizes.max()
    members = {}
    for cell in range(n_cells):
        own = np.flatnonzero(cell_of == cell)
        labels = columns.read(cell, "part_labels")
        assert_array_equal(labels >= 0, taken[own])
        own, labels = own[taken[own]], labels[taken[own]]
        assert_array_equal(columns.read(cell, "part_whole")[labels], sizes[whole[own]])
        for label in np.unique(labels):
            members[cell, label] = set(own[labels == label])
    # Other parts of the same small whole are told, with one number for each whole.
    for (cell, label), own in members.items():
        others = columns.read(cell, "part_others")
        others = others[others[:, 0] == label]
        found = own.union(*(members[c, part] for c, part in others[:, 1:3]))
        number = whole[next(iter(own))]
        complete = set(np.flatnonzero(taken & (whole == number)))
        assert found == (complete if sizes[number] < LEAST else own)
        assert len(np.unique(others[:, 3])) <= 1
