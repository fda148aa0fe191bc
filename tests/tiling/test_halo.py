"""Cells, and their halos: rings of neighbors, and the proof that no points beyond matter."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree

from benchmarks.simulators import make_lidar_turn
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.planes._whole import Whole, part_of
from sklearn_mcmd.tiling import _halo
from sklearn_mcmd.tiling._cells import Cells, CellWriter, Levels
from sklearn_mcmd.tiling._halo import part_of_cell

K, HOPS, CAPACITY = 8, 3, 400
WIDTH = 1.0  # of usual distances


def far_parts():
    rng = np.random.default_rng(0)
    parts = [rng.normal(0, 1, (1_500, 3)), rng.normal([900, 0, 0], 0.02, (40, 3))]
    return np.vstack([*parts, rng.uniform(-80, 80, (60, 3)), np.tile([[0, 500.0, 0]], (700, 1))])


def turn():
    X = make_lidar_turn(4_000, random_state=0).data
    return X[X.any(axis=1)]


CLOUDS = {
    "street": lambda: make_street(3_000, outlier_share=0.05, random_state=0).data,
    "far parts": far_parts,
    "copies": lambda: np.tile(np.random.default_rng(0).normal(0, 1, (1_000, 3)), (3, 1)),
    "turn": turn,  # in wedges
}


def cells_of(folder, X, center=None):
    writer = CellWriter(folder, CAPACITY, center=center)
    for rows in np.array_split(np.arange(len(X)), 7):
        writer.add(X[rows], rows)
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
@pytest.mark.parametrize("usual", [0.0, 0.3])
def test_rings_of_proven_points_are_complete_however_small_the_first_margin_is(
    name, usual, tmp_path, monkeypatch
):
    """Each proven point has its rings of the whole cloud in the part, with the same neighbors. A
    part also has all points nearer than its width."""
    monkeypatch.setattr(_halo, "usual_distance", lambda *_: usual)
    X, n_proven = CLOUDS[name](), 0
    cells = cells_of(tmp_path, X, np.zeros(3) if name == "turn" else None)
    all_rows = np.concatenate([cells.rows(cell) for cell in range(len(cells))])
    assert_array_equal(np.sort(all_rows), np.arange(len(X)))
    assert np.sort(cells.counts)[-2] <= CAPACITY  # one place of 700 points is never divided
    for cell in range(len(cells)):
        part, cloud = part_of_cell(cells, cell, K, HOPS, WIDTH)
        assert_array_equal(part.rows, np.sort(part.rows))
        assert_array_equal(part.xyz, X[part.rows])
        assert_array_equal(part.rows[part.own], cells.rows(cell))
        for home in np.unique(part.homes):
            of = part.homes == home
            assert_array_equal(cells.rows(home)[part.at[of]], part.rows[of])
        places, wide = cells.places(X), WIDTH * usual
        near = ((cells.low[cell] - wide < places) & (cells.high[cell] + wide > places)).all(axis=1)
        assert not set(np.flatnonzero(near)) - set(part.rows)
        assert_array_equal(cloud.points[cloud.places], part.xyz)
        proven, away = part.proven(cloud, K, HOPS, 1)
        n_proven += np.count_nonzero(proven)
        needed, (distances, _), place = rings_of(X, part.rows[part.own][proven])
        assert not set(np.flatnonzero(needed)) - set(part.rows)
        assert (away[np.isin(part.rows, np.flatnonzero(needed))] <= HOPS).all()
        own_places = np.isin(place[part.rows], place[cells.rows(cell)])
        assert_array_equal(away == 0, own_places)
        within = cKDTree(np.unique(part.xyz, axis=0)).query(part.xyz[part.own][proven], K)[0]
        assert_array_equal(within, distances[place[part.rows[part.own][proven]]])
    assert n_proven > 0.3 * len(X)


def test_halos_of_wedges_are_narrow(tmp_path):
    X = turn()
    cells = cells_of(tmp_path, X, np.zeros(3))
    parts = [part_of_cell(cells, cell, K, HOPS, 0.0) for cell in range(len(cells))]
    proven = [part.proven(cloud, K, HOPS, 1)[0] for part, cloud in parts]
    assert np.concatenate(proven).mean() > 0.7
    assert np.mean([len(part.rows) / part.own.sum() for part, _ in parts]) < 2


def test_points_that_join_a_part_come_once_in_the_order_of_rows(tmp_path):
    X = CLOUDS["street"]()
    cells = cells_of(tmp_path, X)
    part, _ = part_of_cell(cells, 2, K, HOPS, 0.0)
    home, at = part.homes[~part.own][0], np.arange(100)  # a cell of which it has points
    more = cells.points(home)[at], np.asarray(cells.rows(home))[at], np.full(100, home), at
    joined = part.joined(*more)
    assert np.isin(more[1], part.rows).any()
    assert_array_equal(joined.rows, np.union1d(part.rows, more[1]))
    assert_array_equal(joined.xyz, X[joined.rows])
    assert_array_equal(joined.rows[joined.own], cells.rows(2))


def test_normals_that_are_asked_alone_are_those_of_a_fit_to_all(tmp_path):
    """Whatever stands in the rows that are not asked."""
    X = CLOUDS["street"]()
    part, cloud = part_of_cell(cells_of(tmp_path, X), 2, 12, 8, 0.0)
    estimator, away = RobustNormalEstimator(12, random_state=0), part.proven(cloud, 12, 8, 1)[1]
    assert np.count_nonzero(away > 5) > 100
    with part_of(Whole(len(X))):
        whole = estimator.fit(part.xyz).normals_
    with part_of(Whole(len(X), away=away)):
        alone = estimator.fit(part.xyz).normals_
    assert_array_equal(alone[part.own], whole[part.own])
    assert (alone[away > 5] != whole[away > 5]).any()


def test_levels_of_parts_are_those_of_all_values_with_their_counts():
    levels, values = Levels(), np.random.default_rng(0).integers(0, 50, 1000) / 4
    for part in np.split(values, [300, 310, 600]):
        levels.add(*np.unique(part, return_counts=True))
    assert_array_equal(levels.merged(), np.unique(values, return_counts=True))


def test_what_asks_some_points_is_what_the_table_of_neighbors_says():
    """Both near ones and those of far groups, which are listed."""
    cloud, rng = IndexedCloud(CLOUDS["street"]()), np.random.default_rng(0)
    near = cloud.neighbors(slice(None), 30, 30)
    for share in (0.0, 0.001, 0.05, 1.0):
        marked = rng.uniform(size=len(near)) < share
        assert_array_equal(cloud.table.asking(marked), marked[near].any(axis=1))
