"""What sweeps leave on disk: a column of all places, or a file for each cell."""

import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd import MCMDOutlierDetector, RegionGrowing
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.tiling import TilingError, _stored_columns, process_files
from sklearn_mcmd.tiling._stored_columns import ALL, CellColumns, StoredColumns
from sklearn_mcmd.tiling._tiled_edges import CreaseColumns
from tiled import ESTIMATOR


@pytest.fixture
def columns(tmp_path):
    """Of two cells, of 2 and 3 places."""
    columns = CellColumns(tmp_path)
    for cell, n in enumerate([2, 3]):
        columns.finish(cell, "places", n_places=n)
    return columns


def test_what_a_sweep_finds_fills_a_column_has_a_file_or_is_reported(columns):
    whole = StoredColumns(columns, 2)
    whole.make(height=float)
    columns.keep(0, "heights", {"height": np.zeros(2), "rows": np.arange(5), "n": 7})
    columns.keep(1, "heights", {"height": np.ones(3), "n": 8})
    assert_array_equal(whole.rows_of("height", slice(None)), [0, 0, 1, 1, 1])
    assert_array_equal(columns.read(0, "rows"), np.arange(5))
    assert [columns.report(cell, "heights") for cell in (0, 1)] == [{"n": 7}, {"n": 8}]
    assert sorted(path.name for path in columns.folder.glob("*height.npy")) == ["all.height.npy"]


def test_what_one_process_has_found_it_does_not_find_again(columns):
    calls = []
    found = [columns.once("usual", lambda: calls.append(0) or {"usual": 3}) for _ in range(2)]
    assert found == [{"usual": 3}] * 2
    assert len(calls) == 1
    assert columns.once("joined", lambda: None) == {}
    assert columns.is_done(ALL, "joined")


def test_each_cell_gets_its_part_of_what_was_found_of_all(columns):
    for cell, n in enumerate([2, 0, 3]):
        columns.write(cell, seen=np.full(n, cell))
    seen = columns.gather(range(3), "seen")
    columns.share(range(3), "seen", twice=2 * seen, rows=np.arange(5))
    assert_array_equal(columns.gather([0, 2], "twice"), [0, 0, 4, 4, 4])
    assert [columns.read(cell, "rows").tolist() for cell in range(3)] == [[0, 1], [], [2, 3, 4]]


def test_threads_read_the_headers_of_files_one_by_one(columns, monkeypatch):
    """Python 3.11 parses no literals in several threads: it raises SystemError now and then."""
    columns.write(0, seen=np.arange(3))
    inside, most = [], []

    def load(*args, load=np.load, **kwargs):
        inside.append(0)
        most.append(len(inside))
        time.sleep(0.001)
        inside.pop()
        return load(*args, **kwargs)

    monkeypatch.setattr(np, "load", load)
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda _: columns.read(0, "seen"), range(50)))
    assert_array_equal(found, [np.arange(3)] * 50)
    assert max(most) == 1


def test_threads_that_ask_for_a_column_at_once_fill_the_same_array(columns, monkeypatch):
    """Else what one of them fills is lost."""
    both, whole = Barrier(2), StoredColumns(columns, 2)
    whole.make(crease=float)
    own = CreaseColumns(whole, slice(0, 5))

    def rows_of(whole, name, rows, rows_of=StoredColumns.rows_of):
        both.wait(10)
        return rows_of(whole, name, rows)

    monkeypatch.setattr(StoredColumns, "rows_of", rows_of)
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(own.__getitem__, ["crease"] * 2)
    assert first is second


@pytest.mark.parametrize("opened", [StoredColumns.column, StoredColumns.open_column])
def test_rows_of_a_column_are_read_in_pieces_that_lie_together(opened, columns, monkeypatch):
    """So that few pages of a file are in memory at once, whatever the order of the rows."""
    monkeypatch.setattr(_stored_columns, "FEW", 20)
    rng, pieces = np.random.default_rng(0), []
    values = rng.normal(size=(100, 3))
    columns.write(ALL, height=values)
    column = opened(StoredColumns(columns, 2), "height")

    class Mapped(np.memmap):
        def __getitem__(self, rows):
            if isinstance(rows, np.ndarray):
                pieces.append(rows)
            return super().__getitem__(rows)

    monkeypatch.setattr(np, "memmap", Mapped)
    for rows in (slice(10, 30), rng.integers(100, size=9), rng.permutation(100)):
        assert_array_equal(column[rows], values[rows])
    rows = rng.integers(100, size=(40, 2))
    assert_array_equal(column[rows], values[rows])
    assert max(map(len, pieces)) == 20
    whole = np.concatenate(pieces[-4:])
    assert_array_equal(whole, np.sort(rows, axis=None))


@pytest.mark.parametrize(
    ("work", "name"),
    [
        (lambda whole, rows: whole.columns.write(1, seen=rows), "1.seen.npy"),
        (lambda whole, rows: whole.columns.finish(1, "seen", rows=rows.tolist()), "1.seen.json"),
        (lambda whole, rows: whole.put(0, rows=rows), "all.rows.npy"),
        (lambda whole, rows: whole.copy(rows="twice"), "all.twice.npy"),
        (lambda whole, rows: whole.make(len(rows), more=float), "all.more.npy"),
    ],
)
def test_what_a_disk_has_no_room_for_is_named(columns, work, name):
    resource = pytest.importorskip("resource")
    whole, rows = StoredColumns(columns, 2), np.arange(5_000.0)
    whole.make(len(rows), rows=float)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8_192, before[1]))
    try:
        with pytest.raises(PointFileError, match=rf"/{name}: cannot be written: file too large"):
            work(whole, rows)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_column_that_is_open_is_opened_anew_after_some_rows(columns, monkeypatch):
    monkeypatch.setattr(_stored_columns, "FEW", 25)
    values, opened = np.random.default_rng(0).normal(size=100), []
    columns.write(ALL, height=values)
    column = StoredColumns(columns, 2).open_column("height")

    def open_one(column, open_one=_stored_columns.Column._mapped):
        opened.append(column)
        return open_one(column)

    monkeypatch.setattr(_stored_columns.Column, "_mapped", open_one)
    for rows in np.split(np.arange(100), 10):
        assert_array_equal(column[rows], values[rows])
    assert len(opened) == 4


def test_numbers_that_a_cell_changes_come_out_bit_by_bit(columns):
    whole = StoredColumns(columns, 2)
    whole.make(normals=(float, 3), scale=float)
    normals = np.array([[0, 1, 0], [0, 0, 0], [0.25, 0, -0.0]])
    whole.change(1, normals=normals, scale=np.array([0, 0, np.nan]))
    assert len(columns.read(1, "changes")) == 2 + 4 * 8  # of 12 numbers 4 differ
    found = {name: whole.rows_of(name, whole.rows(1)) for name in ("normals", "scale")}
    whole.changed(1, **found)
    assert_array_equal(found["normals"], normals)
    assert_array_equal(np.signbit(found["normals"]).sum(axis=0), [0, 0, 1])
    assert_array_equal(found["scale"], [0, 0, np.nan])


@pytest.mark.parametrize(
    ("estimator", "step"),
    [
        *((ESTIMATOR, step) for step in ("joined", "offers1-settled", "bends-settled", "normals")),
        (RegionGrowing(16, random_state=0), "faces-settled"),
        (MCMDOutlierDetector(16, sensor_origin="origin", random_state=0), "rays0"),
    ],
)
def test_a_run_that_ends_before_it_notes_what_a_sweep_did_goes_on(
    estimator, step, small_file, tmp_path, monkeypatch
):
    """What was put elsewhere is not there any more."""

    def fail(columns, cell, sweep, finish=CellColumns.finish, **report):
        if (cell, sweep) == (1, step):
            raise MemoryError("enough")
        finish(columns, cell, sweep, **report)

    with monkeypatch.context() as patch:
        patch.setattr(CellColumns, "finish", fail)
        with pytest.warns(match="tile 1 failed .* enough"), pytest.raises(TilingError):
            process_files(small_file, tmp_path / "out.las", estimator, tile_size=2_000)
    process_files(small_file, tmp_path / "out.las", estimator, tile_size=2_000)
    process_files(small_file, tmp_path / "expected.las", estimator, tile_size=2_000)
    assert (tmp_path / "out.las").read_bytes() == (tmp_path / "expected.las").read_bytes()


def test_all_is_on_the_disk_before_a_step_counts_as_done(tmp_path, monkeypatch):
    columns, synced = CellColumns(tmp_path), []

    def sync(path):
        assert path.read_text() == '{"n": 3}'
        assert not columns.is_done(0, "step")
        synced.append(columns.read(0, "x").tolist())

    monkeypatch.setattr(_stored_columns, "sync_disk", sync)
    columns.keep(0, "step", {"x": np.arange(3), "n": 3})
    assert synced == [[0, 1, 2]]
    assert columns.is_done(0, "step")
