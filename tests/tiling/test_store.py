"""What tiles keep on disk: points in cells, columns of places, and searches among all of them."""

from threading import Event

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._resolution import coordinate_step
from sklearn_mcmd.tiling import _search, _stored_columns
from sklearn_mcmd.tiling._cells import Cells, CellWriter, WholeCloud
from sklearn_mcmd.tiling._search import StoredNearest
from sklearn_mcmd.tiling._stored_columns import CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_index import StoredIndex

CAPACITY = 300
RNG = np.random.default_rng(0)


def uneven(n=4_000):
    """A cloud whose densities differ a thousandfold, with copies."""
    rng = np.random.default_rng(0)
    dense, sparse = rng.normal(0, 0.03, (n // 2, 3)), rng.uniform(-5, 5, (n // 2, 3))
    xyz = np.round(np.vstack([dense, sparse]), 3)
    xyz[-100:] = xyz[:100]
    return xyz[rng.permutation(n)]


def cells_of(folder, xyz, cut=0.5):
    writer = CellWriter(folder, CAPACITY, cut)
    for rows in np.array_split(np.arange(len(xyz)), 7):
        writer.add(xyz[rows], rows)
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
    assert cells.counts.mean() >= CAPACITY / 2 or cut != 0.5


def test_a_road_below_a_few_stray_points_is_not_cut_through_its_noise(tmp_path):
    rng = np.random.default_rng(0)
    road = rng.normal(size=(4_000, 3)) * [0, 0, 0.01] + rng.uniform(size=(4_000, 3)) * [3, 2, 0]
    stray = rng.uniform(size=(40, 3)) * [3, 2, 6]
    cells = cells_of(tmp_path, rng.permutation(np.vstack([road, stray])))
    assert np.isinf(cells.low[:, 2]).all()
    assert np.isinf(cells.high[:, 2]).all()
    assert (cells.high[:, :2] < [3, 2]).any(axis=0).all()


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
    (path,) = tmp_path.glob(f"{cells._names[1]}.*")
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(PointFileError, match=rf"{path.name}: is damaged; begin anew \(restart\)"):
        cells.read(1)


@pytest.mark.parametrize("content", [b"", b"PK", b"[]"])
def test_damaged_boxes_are_named(tmp_path, content):
    cells_of(tmp_path, uneven())
    (tmp_path / "cells.npz").write_bytes(content)
    with pytest.raises(PointFileError, match=r"cells\.npz: cannot be read"):
        Cells(tmp_path)


NATIONAL = np.array([362_000, 5_157_000, 100])
CLOUDS = {
    "continuous": RNG.uniform(0, 9, (3_000, 3)),
    "millimeters": np.round(RNG.uniform(0, 2, (3_000, 3)) + NATIONAL, 3),
    "centimeters on a floor": np.round(RNG.uniform(0, 2, (3_000, 3)) * [1, 1, 0.01], 2),
    "some not rounded": np.vstack(
        [np.round(RNG.uniform(0, 2, (3_000, 3)), 2), RNG.uniform(0, 2, (9, 3))]
    ),
    "single precision": RNG.integers(0, 500, (3_000, 3)) / 64,
    "whole meters": RNG.integers(0, 500, (3_000, 3)) + NATIONAL,
}


@pytest.mark.parametrize("name", CLOUDS)
def test_the_step_of_the_parts_is_that_of_the_cloud(name):
    xyz, whole = CLOUDS[name], WholeCloud()
    for part in np.array_split(xyz, [100, 150, 2_000]):
        whole.add(part)
    found = whole.constants()
    assert found.dtype == ("float32" if name == "single precision" else "float64")
    assert found.step == coordinate_step(xyz.astype(found.dtype))
    assert (found.step > 0) == (name != "continuous")


def test_a_column_stays_until_another_is_written(tmp_path, monkeypatch):
    columns = CellColumns(tmp_path)
    columns.write(0, points=np.ones(10_000))

    def fail(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(_stored_columns.os, "replace", fail)
        with pytest.raises(OSError, match="No space"):
            columns.write(0, points=np.zeros(10_000))
    assert columns.read(0, "points").sum() == 10_000
    columns.write(0, points=np.zeros(10_000))
    assert columns.read(0, "points").sum() == 0
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("content", [b"", b"{", b"\x93NUMPY\x01\x00", b"\xff"])
def test_damaged_columns_and_reports_are_named(tmp_path, content):
    columns = CellColumns(tmp_path)
    for name, read in (("0.points.npy", columns.read), ("0.points.json", columns.report)):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(PointFileError, match=rf"{name}: cannot be read"):
            read(0, "points")


def test_no_pickle_is_loaded(tmp_path):
    np.save(tmp_path / "0.points.npy", np.array([print, None]), allow_pickle=True)
    with pytest.raises(PointFileError, match="Object arrays cannot be loaded"):
        CellColumns(tmp_path).read(0, "points")


@pytest.fixture
def index():
    return NeighborIndex(np.random.default_rng(0).uniform(size=(2_000, 3)), 12)


@pytest.fixture
def whole(index, tmp_path):
    """The points of an index and their neighbors, as those of three cells."""
    columns, starts = CellColumns(tmp_path), [0, 700, 701, 2_000]
    near = index.query_own(slice(0, 2_000)).indices
    for cell in range(3):
        rows = slice(starts[cell], starts[cell + 1])
        points = index.points[rows]
        columns.write(cell, points=points, near=near[rows], scale=np.zeros(len(points)))
        columns.finish(cell, "places", n_places=len(points))
    return StoredColumns(columns, 3)


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
    assert "0.points.npy" not in names
    assert "0.scale.npy" in names
    assert not any(name.endswith(".part") for name in names)


def test_neighbors_are_those_of_the_index(whole, index):
    whole.join("points", "near")
    stored = StoredIndex(whole)
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
    monkeypatch.setattr(_stored_columns, "RELEASE_SECONDS", 0.001)
    monkeypatch.setattr(whole, "release", freed.set)
    with whole.releasing():
        assert freed.wait(30)


@pytest.fixture
def cloud(tmp_path):
    """An uneven cloud in cells, of whose points every third is not meant: search, cells, points."""
    cells, columns = cells_of(tmp_path, np.unique(uneven(3_000), axis=0)), CellColumns(tmp_path)
    for cell in range(len(cells)):
        points = cells.read(cell)["xyz"]
        columns.write(cell, points=points)
        columns.finish(cell, "places", n_places=len(points))
    whole = StoredColumns(columns, len(cells))
    whole.join("points")
    chosen = np.arange(len(whole)) % 3 != 0
    return StoredNearest(whole, cells, chosen), cells, whole.open("points")[chosen]


@pytest.mark.parametrize("k", [1, 17, 300])
def test_each_query_is_visited_once_with_its_nearest_in_the_whole_cloud(cloud, k, monkeypatch):
    monkeypatch.setattr(_search, "AT_ONCE", 2_000)
    search, cells, meant = cloud
    for cell in range(0, len(cells), 4):
        queries = np.vstack([cells.read(cell)["xyz"], [[70.0, 0, 0]]])
        distances, near = NearestPoints(meant).query(queries, k)
        seen = np.zeros(len(queries), int)

        def work(rows, gaps, found, d=distances, near=near, seen=seen):
            seen[rows] += 1
            assert_array_equal(gaps, d[rows])
            assert_array_equal(meant[found], meant[near[rows]])

        search.visit_in(cell, queries, k, work)
        assert (seen == 1).all()


def test_queries_of_many_cells_find_their_nearest(cloud):
    search, _, meant = cloud
    queries = np.random.default_rng(2).uniform(-9, 9, (200, 3))
    found, expected = search.query(queries, 9), NearestPoints(meant).query(queries, 9)
    assert_array_equal(found[0], expected[0])
    assert_array_equal(meant[found[1]], meant[expected[1]])


def test_cells_beyond_reach_are_not_read(cloud, monkeypatch):
    (search, cells, _), read = cloud, []
    load = search._load
    monkeypatch.setattr(search, "_load", lambda cell: read.append(cell) or load(cell))
    search.query(np.full((1, 3), 4.5), 150)  # more than its own cell has
    assert 1 < len(set(read)) < len(cells) / 2


def test_missing_neighbors_are_infinitely_far(cloud):
    search, _, meant = cloud
    gaps, near = search.query(np.zeros((2, 3)), len(meant) + 5)
    assert np.isinf(gaps[:, -5:]).all()
    assert (near[:, -5:] == len(meant)).all()
    assert np.isfinite(gaps[:, :-5]).all()
