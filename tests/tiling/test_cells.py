"""Cells hold all points, few each, and answer for the whole cloud."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from sklearn_mcmd.tiling._cells import CellWriter

CAPACITY = 300


def uneven(n=4_000, seed=0):
    """A cloud whose densities differ a thousandfold, with copies."""
    rng = np.random.default_rng(seed)
    dense, sparse = rng.normal(0, 0.03, (n // 2, 3)), rng.uniform(-5, 5, (n // 2, 3))
    xyz = np.round(np.vstack([dense, sparse]), 3)
    xyz[-100:] = xyz[:100]
    return xyz[rng.permutation(n)]


def cells_of(folder, xyz, capacity=CAPACITY, cut=0.5, parts=7):
    writer = CellWriter(folder, capacity, cut)
    first = 0
    for part in np.array_split(xyz, parts):
        writer.add(part, first)
        first += len(part)
    return writer.close()


@pytest.mark.parametrize("cut", [0.5, 0.3, 0.8])
def test_each_point_is_in_the_one_cell_of_its_place(tmp_path, cut):
    xyz = uneven()
    cells = cells_of(tmp_path, xyz, cut=cut)
    rows = []
    for cell in range(len(cells)):
        records = cells.read(cell)
        assert_array_equal(records["xyz"], xyz[records["row"]])
        assert (cells.low[cell] <= records["xyz"]).all()
        assert (records["xyz"] < cells.high[cell]).all()
        assert len(records) == cells.counts[cell] <= CAPACITY
        assert (np.diff(records["row"]) > 0).all()
        rows.append(records["row"])
    assert_array_equal(np.sort(np.concatenate(rows)), np.arange(len(xyz)))


def test_cells_are_half_full_on_average_wherever_the_cloud_is_dense(tmp_path):
    cells = cells_of(tmp_path, uneven())
    assert cells.counts.mean() >= CAPACITY / 2


def test_a_road_below_a_few_stray_points_is_not_cut_through_its_noise(tmp_path):
    rng = np.random.default_rng(0)
    road = rng.normal(size=(4_000, 3)) * [0, 0, 0.01] + rng.uniform(size=(4_000, 3)) * [3, 2, 0]
    stray = rng.uniform(size=(40, 3)) * [3, 2, 6]
    cells = cells_of(tmp_path, rng.permutation(np.vstack([road, stray])))
    assert np.isinf(cells.low[:, 2]).all()
    assert np.isinf(cells.high[:, 2]).all()
    assert (cells.high[:, 0] < 3).any()
    assert (cells.high[:, 1] < 2).any()


def test_copies_of_one_place_stay_together(tmp_path):
    xyz = np.vstack([np.ones((900, 3)), uneven(1_000)])
    cells = cells_of(tmp_path, xyz)
    assert cells.counts.max() >= 900
    assert cells.counts.sum() == len(xyz)


def test_the_halo_is_all_points_of_the_wider_box(tmp_path):
    xyz = uneven()
    cells = cells_of(tmp_path, xyz)
    for cell in range(0, len(cells), 5):
        halo, low, high = cells.around(cell, 0.5, len(xyz))
        expected = ((xyz >= low) & (xyz < high)).all(axis=1).sum()
        assert len(halo) + cells.counts[cell] == expected
        assert_array_equal(low, cells.low[cell] - 0.5)


def test_a_halo_gets_narrower_until_it_has_few_points(tmp_path):
    xyz = uneven()
    cells = cells_of(tmp_path, xyz)
    sparse = np.argmax(np.nan_to_num(cells.extent(slice(None))[0]).sum(axis=1))
    halo, low, high = cells.around(sparse, 8.0, 100)
    expected = ((xyz >= low) & (xyz < high)).all(axis=1).sum()
    assert len(halo) + cells.counts[sparse] == expected
    assert 0 < len(halo) <= 100


@pytest.mark.parametrize("k", [1, 20])
@pytest.mark.parametrize("bounded", [False, True])
def test_neighbors_are_searched_for_in_all_cells(tmp_path, k, bounded):
    xyz = uneven()
    distinct = np.unique(xyz, axis=0)
    queries = distinct[:: len(distinct) // 40]
    distances = cKDTree(distinct).query(queries, np.arange(1, k + 1))[0]
    bound = 1.5 * distances[:, -1] + 1e-9 if bounded else np.full(len(queries), np.inf)
    found, reach = cells_of(tmp_path, xyz).neighbors(queries, k, bound)
    assert len(np.unique(found, axis=0)) == len(found)
    again = cKDTree(found).query(queries, np.arange(1, k + 1))[0]
    assert_array_equal(again, distances)
    assert (distances[:, -1] <= reach).all()
    assert_allclose(reach, distances[:, -1], rtol=1e-9)


def test_of_equally_distant_neighbors_all_are_found(tmp_path):
    grid = np.stack(np.meshgrid(*[np.arange(9.0)] * 3), axis=-1).reshape(-1, 3)
    cells = cells_of(tmp_path, grid, capacity=100)
    found, _ = cells.neighbors(np.array([[4.0, 4.0, 4.0]]), 3, np.array([np.inf]))
    assert len(found) == 7  # itself, and all six at distance one


def test_fewer_points_than_neighbors_are_all_found(tmp_path):
    xyz = uneven(200)
    found, reach = cells_of(tmp_path, xyz).neighbors(xyz[:2], 500, np.full(2, np.inf))
    assert len(found) == len(np.unique(xyz, axis=0))
    assert_array_equal(reach, np.inf)
