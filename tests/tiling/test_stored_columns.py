"""Columns of all places in one file each, and neighbors that are read from there."""

from threading import Event

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.tiling import _stored_columns
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._stored_columns import StoredColumns
from sklearn_mcmd.tiling._stored_index import StoredIndex

SIZES = [700, 1, 1_299]


@pytest.fixture
def index():
    return NeighborIndex(np.random.default_rng(0).uniform(size=(sum(SIZES), 3)), 12)


@pytest.fixture
def whole(index, tmp_path):
    """The points of an index and their neighbors, as those of three cells."""
    columns, starts = CellColumns(tmp_path), np.cumsum([0, *SIZES])
    near = index.query_own(slice(0, len(index.points))).indices
    for cell, size in enumerate(SIZES):
        rows = slice(starts[cell], starts[cell + 1])
        columns.write(cell, points=index.points[rows], near=near[rows], scale=np.zeros(size))
        columns.finish(cell, "places", n_places=size)
    return StoredColumns(columns, len(SIZES))


def test_columns_of_cells_become_one(whole, index):
    assert len(whole) == len(index.points)
    assert [whole.rows(cell) for cell in range(3)] == [
        slice(0, 700), slice(700, 701), slice(701, 2_000),
    ]  # fmt: skip
    whole.join("points", "near")
    assert_array_equal(whole.open("points"), index.points)
    assert whole.open("near").dtype == np.int32
    names = {path.name for path in whole.columns.folder.iterdir()}
    assert "0.points.npy" not in names
    assert "0.scale.npy" in names


def test_a_join_that_was_ended_is_done_again(whole, index, monkeypatch):
    def fail(*_):
        raise OSError("disk full")

    with monkeypatch.context() as patched:
        patched.setattr(whole.columns, "finish", fail)
        with pytest.raises(OSError, match="disk full"):
            whole.join("points")
    whole.join("points")
    whole.join("points")  # what is done stays
    assert_array_equal(whole.open("points"), index.points)
    names = {path.name for path in whole.columns.folder.iterdir()}
    assert not any(name.endswith(".part") for name in names)


def test_neighbors_are_those_of_the_index(whole, index):
    whole.join("points", "near")
    stored = StoredIndex(whole)
    assert stored.n_neighbors == 12
    for rows in (slice(690, 800), np.array([3, 1_999, 3, 700])):
        for k in (None, 5):
            found, expected = stored.query_own(rows, k), index.query_own(rows, k)
            assert_array_equal(found.indices, expected.indices)
            assert_array_equal(found.sizes, expected.sizes)
            assert found.indices.flags.c_contiguous


def test_only_a_copy_is_changed_and_outlives_the_release_of_memory(whole):
    whole.join("scale")
    changing = whole.open("scale", changing=True)
    changing[5] = 7.0
    whole.release()
    assert changing[5] == 7.0
    assert not whole.open("scale").any()
    assert not whole.open("scale", changing=True).any()


def test_what_is_read_is_freed_while_the_work_goes_on(whole, monkeypatch):
    freed = Event()
    monkeypatch.setattr(_stored_columns, "SECONDS", 0.001)
    monkeypatch.setattr(whole, "release", freed.set)
    with whole.releasing():
        assert freed.wait(30)
