"""Cells hold all points, few each, and answer for the whole cloud."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.tiling._cells import Cells, CellWriter

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


@pytest.mark.parametrize(
    "change", [lambda data: data[:-3], lambda data: data[:-32], lambda data: b""]
)
def test_a_cell_that_is_not_as_it_was_written_is_named(tmp_path, change):
    cells = cells_of(tmp_path, uneven())
    (path,) = tmp_path.glob(f"{cells._names[1]}*")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(PointFileError, match=rf"{path.name}: is damaged; begin anew \(restart\)"):
        cells.read(1)


@pytest.mark.parametrize("content", [b"", b"PK", b"[]"])
def test_damaged_boxes_are_named(tmp_path, content):
    cells_of(tmp_path, uneven())
    (tmp_path / "cells.npz").write_bytes(content)
    with pytest.raises(PointFileError, match=r"cells\.npz: cannot be read"):
        Cells(tmp_path)
