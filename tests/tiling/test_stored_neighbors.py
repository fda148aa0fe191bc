"""Neighbors packed in a file, against those that went into it."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.tiling._stored_columns import CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_neighbors import StoredNeighbors, bytes_of_neighbors


@pytest.fixture
def stored(tmp_path):
    """Of two cells, of 7 and 3,000 places."""
    columns = CellColumns(tmp_path)
    for cell, n in enumerate([7, 3_000]):
        columns.finish(cell, "places", n_places=n)
    return StoredNeighbors(StoredColumns(columns, 2))


def neighbors(n, k, spread):
    rng = np.random.default_rng(k)
    near = np.arange(n)[:, None] + rng.integers(-spread, spread + 1, (n, k))
    return np.clip(near, 0, n - 1).astype(np.int32)


@pytest.mark.parametrize("k", [1, 7, 50, 128, 129])
@pytest.mark.parametrize("spread", [30, 3_007])
def test_what_comes_out_is_what_went_in_also_once_it_is_narrowed(stored, k, spread):
    near, fewer = neighbors(3_007, k, spread), -(-k // 2)
    stored.begin(k, fewer)
    stored.write(0, near[:7])
    stored.write(1, near[7:])
    some = np.random.default_rng(0).integers(0, 3_007, 500)
    assert_array_equal(stored.take(slice(3, 400), k), near[3:400])
    assert_array_equal(stored.take(some, k), near[some])
    stored.free(1, all_of_them=False)
    assert_array_equal(stored.take(some, fewer), near[some, :fewer])
    with pytest.raises(ValueError, match=rf"{k + 1} neighbors are wanted, and {fewer} are stored"):
        stored.take(slice(7, 8), k + 1)


def test_neighbors_near_each_other_take_less_than_half_of_their_size(stored, tmp_path):
    stored.begin(50)
    stored.write(1, neighbors(3_007, 50, 60)[7:])
    size = (tmp_path / "1.near").stat().st_size / 3_000
    assert size <= bytes_of_neighbors(50) < 0.5 * 4 * 50


def test_other_processes_are_sent_no_neighbors(stored):
    near = neighbors(3_007, 50, 60)
    stored.begin(50)
    stored.write(1, near[7:])
    before = len(pickle.dumps(stored))
    rows = np.arange(7, 3_007)
    assert_array_equal(stored.take(rows, 50), near[7:])
    sent = pickle.dumps(stored)
    assert len(sent) < 2 * before
    assert_array_equal(pickle.loads(sent).take(rows, 50), near[7:])
