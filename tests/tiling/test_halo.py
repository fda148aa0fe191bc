"""Halos of cells: rings of neighbors, and the proof of what does not depend on points beyond."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree

from benchmarks.simulators import make_lidar_turn
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.tiling._cells import Cells, CellWriter
from sklearn_mcmd.tiling._halo import part_of_cell

K, HOPS = 8, 3


def far_parts():
    rng = np.random.default_rng(0)
    parts = [rng.normal(0, 1, (1_500, 3)), rng.normal([900, 0, 0], 0.02, (40, 3))]
    return np.vstack([*parts, rng.uniform(-80, 80, (60, 3)), np.tile([[0, 500.0, 0]], (700, 1))])


CLOUDS = {
    "street": lambda: make_street(3_000, outlier_share=0.05, random_state=0).data,
    "far parts": far_parts,
    "copies": lambda: np.tile(np.random.default_rng(0).normal(0, 1, (1_000, 3)), (3, 1)),
}


def cells_of(folder, X, capacity=400, center=None):
    writer = CellWriter(folder, capacity, center=center)
    writer.add(X, np.arange(len(X)))
    writer.close()
    return Cells(folder)


def rings_of(X, rows):
    """The rows of the places that are neighbors of rows, of these, and so on; of each hop."""
    places, place = np.unique(X, axis=0, return_inverse=True)
    near = cKDTree(places).query(places, K)
    asked = np.isin(np.arange(len(places)), place[rows])
    for _ in range(HOPS):
        asked[near[1][asked]] = True
    return np.isin(place, np.flatnonzero(asked)), near, place


@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize("usual", [0.0, 0.01, 0.3])
def test_rings_of_proven_points_are_complete_however_small_the_first_margin_is(
    name, usual, tmp_path
):
    """Each proven point has its rings of the whole cloud in the part, with the same neighbors."""
    X, n_proven = CLOUDS[name](), 0
    cells = cells_of(tmp_path, X)
    for cell in range(len(cells)):
        part = part_of_cell(cells, cell, K, HOPS, 0.0, usual)
        assert_array_equal(part.rows, np.sort(part.rows))
        assert_array_equal(part.xyz, X[part.rows])
        assert_array_equal(part.rows[part.own], cells.rows(cell))
        for home in np.unique(part.homes):
            of = part.homes == home
            assert_array_equal(cells.rows(home)[part.at[of]], part.rows[of])
        proven = part.proven(IndexedCloud(part.xyz), K, HOPS, 1)
        n_proven += np.count_nonzero(proven)
        needed, (distances, _), place = rings_of(X, part.rows[part.own][proven])
        assert not set(np.flatnonzero(needed)) - set(part.rows)
        within = cKDTree(np.unique(part.xyz, axis=0)).query(part.xyz[part.own][proven], K)[0]
        assert_array_equal(within, distances[place[part.rows[part.own][proven]]])
    assert n_proven > 0.3 * len(X)


def test_a_turn_is_divided_in_wedges_whose_halos_are_narrow_and_proven(tmp_path):
    X = make_lidar_turn(4_000, random_state=0).data
    X = X[X.any(axis=1)]
    cells, n_proven, sizes = cells_of(tmp_path, X, 1_000, np.zeros(3)), 0, []
    for cell in range(len(cells)):
        part = part_of_cell(cells, cell, K, HOPS, 0.0, 0.02)
        proven = part.proven(IndexedCloud(part.xyz), K, HOPS, 1)
        needed, *_ = rings_of(X, part.rows[part.own][proven])
        assert not set(np.flatnonzero(needed)) - set(part.rows)
        n_proven += np.count_nonzero(proven)
        sizes.append(len(part.rows) / cells.counts[cell])
    assert n_proven > 0.7 * len(X)
    assert np.mean(sizes) < 2


def test_points_that_join_a_part_come_once_in_the_order_of_rows(tmp_path):
    X = CLOUDS["street"]()
    cells = cells_of(tmp_path, X)
    part = part_of_cell(cells, 2, K, HOPS, 0.0, 0.01)
    at = np.arange(300)
    more = cells.points(0)[at], np.asarray(cells.rows(0))[at], np.zeros(300, np.int32), at
    joined = part.joined(*more)
    assert_array_equal(joined.rows, np.union1d(part.rows, more[1]))
    assert_array_equal(joined.xyz, X[joined.rows])
    assert_array_equal(joined.rows[joined.own], cells.rows(2))


def test_a_part_has_all_points_nearer_than_its_width(tmp_path):
    X = CLOUDS["street"]()
    cells = cells_of(tmp_path, X)
    part = part_of_cell(cells, 2, K, HOPS, 20.0, 0.02)
    near = ((cells.low[2] - 0.4 < X) & (cells.high[2] + 0.4 > X)).all(axis=1)
    assert near.sum() > 1.2 * cells.counts[2]
    assert not set(np.flatnonzero(near)) - set(part.rows)
