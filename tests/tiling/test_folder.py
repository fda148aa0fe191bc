"""The folder in which a run keeps its work: left, in the way, damaged, too small, or locked."""

import io
import os
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext

import numpy as np
import pytest

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.tiling import TilingError, _sweeps, process_files
from sklearn_mcmd.tiling._folder import WorkFolder
from sklearn_mcmd.tiling._sweeps import lock_of_tiles
from tiled import ESTIMATOR, in_memory, is_killed, names_in


def test_what_a_run_left_that_died_while_it_was_removed_is_in_no_ones_way(small_file, tmp_path):
    """Killed amid the removal of cells, or between the writing and the renaming of a manifest."""
    left = tmp_path / "out.las.tiles"
    for name in ("manifest.json.0123abcd.part", "lock"):
        (left / "cells").mkdir(parents=True)
        (left / name).write_text("{}")
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
        assert not left.exists()


def test_a_run_that_ended_while_its_folder_was_removed_has_only_to_remove_it(
    small_file, tmp_path, monkeypatch
):
    target = tmp_path / "out.las"

    def remove_part(path, **_):
        if (path / "cells.npz").exists():
            (path / "cells.npz").unlink()
            raise MemoryError("too much")

    with monkeypatch.context() as patch:
        patch.setattr("shutil.rmtree", remove_part)
        with pytest.raises(MemoryError, match="too much"):
            process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    assert process_files(small_file, target, ESTIMATOR, tile_size=2_000).n_resumed == 4
    assert names_in(tmp_path) == ["out.las", "small.las"]


def test_a_folder_of_others_is_not_removed(small_file, tmp_path):
    other = tmp_path / "out.las.tiles" / "mine.txt"
    other.parent.mkdir()
    other.write_text("mine")
    with pytest.raises(FileExistsError, match="in the way"):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR)
    assert other.read_text() == "mine"


@pytest.fixture
def ended(small_file, tmp_path, failing):
    """The output of a run that ended, of whose four tiles three are done."""
    failing.add(1)
    with pytest.warns(match="tile 1 failed"), pytest.raises(TilingError):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    failing.clear()
    return tmp_path / "out.las"


def test_too_small_a_disk_is_said_but_a_run_that_goes_on_needs_no_room(
    small_file, ended, tmp_path, monkeypatch
):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(9, 8, 1000))
    with pytest.raises(PointFileError, match="are free"):
        process_files(small_file, tmp_path / "other.las", ESTIMATOR)
    assert process_files(small_file, ended, ESTIMATOR, tile_size=2_000).n_resumed == 3
    assert names_in(tmp_path) == ["out.las", "small.las"]


@pytest.mark.parametrize("damage", [lambda told: told[:-9], lambda told: told.replace(b"f", b"i")])
def test_a_manifest_that_is_not_as_it_was_written_begins_anew(small_file, ended, tmp_path, damage):
    manifest = tmp_path / "out.las.tiles" / "manifest.json"
    manifest.write_bytes(damage(manifest.read_bytes()))
    assert process_files(small_file, ended, ESTIMATOR, tile_size=2_000).n_resumed == 0
    assert ended.read_bytes() == in_memory(small_file, tmp_path / "e.las").read_bytes()


@pytest.mark.filterwarnings("ignore:tile . failed")
def test_a_damaged_file_is_named_and_to_begin_anew_helps(small_file, ended, tmp_path):
    path = tmp_path / "out.las.tiles" / "cells" / "cells.npz"
    path.write_bytes(b"PK")
    with pytest.raises(TilingError, match=f"{path}: cannot be read"):
        process_files(small_file, ended, ESTIMATOR, tile_size=2_000)
    options = {"tile_size": 2_000, "restart": True}
    assert process_files(small_file, ended, ESTIMATOR, **options).n_resumed == 0


@pytest.mark.filterwarnings("ignore:tile . failed")
@pytest.mark.parametrize(
    ("name", "damage"),
    [("0.near", lambda stored: stored[:400]), ("all.points.npy", lambda _: pickled())],
)
def test_a_tile_that_meets_a_damaged_file_names_it(small_file, ended, tmp_path, name, damage):
    path = tmp_path / "out.las.tiles" / "results" / name
    path.write_bytes(damage(path.read_bytes()))
    said = rf"tile \d failed .*{name}: (cannot be read|is damaged)"
    with pytest.warns(UserWarning, match=said), pytest.raises(TilingError):
        process_files(small_file, ended, ESTIMATOR, tile_size=2_000)


@pytest.mark.parametrize(
    ("files", "said"),
    [("points", "points: is damaged; begin anew"), ("rows", r"rows: cannot be read")],
)
def test_a_cell_that_was_cut_off_is_named(files, said, small_file, tmp_path, monkeypatch):
    def cut_off(folder, constants, finish=WorkFolder.finish_cells):
        finish(folder, constants)
        for path in folder.cells.glob(f"*.{files}"):
            path.write_bytes(path.read_bytes()[:-3])

    monkeypatch.setattr(WorkFolder, "finish_cells", cut_off)
    with (
        pytest.warns(match=said) if files == "points" else nullcontext(),
        pytest.raises(TilingError, match="kept" if files == "points" else said),
    ):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)


def pickled():
    """What NumPy would run as code, if one let it."""
    np.save(stored := io.BytesIO(), np.array([print, None]), allow_pickle=True)
    return stored.getvalue()


def test_a_second_run_is_refused_while_the_first_works(small_file, tmp_path, monkeypatch):
    target, compute = tmp_path / "out.las", _sweeps.compute_cells

    def second(*args):
        with pytest.raises(TilingError, match="lock: another run works on this output"):
            process_files(small_file, target, ESTIMATOR, tile_size=4_000)
        compute(*args)

    monkeypatch.setattr(_sweeps, "compute_cells", second)
    process_files(small_file, target, ESTIMATOR, tile_size=3_000)
    assert names_in(tmp_path) == ["out.las", "small.las"]


def test_one_of_many_that_ask_at_once_gets_the_lock(tmp_path):
    def ask(_):
        try:
            return WorkFolder(tmp_path / "out.las")
        except TilingError:
            return None

    with ThreadPoolExecutor(20) as pool:
        (folder,) = filter(None, pool.map(ask, range(20)))
    folder.remove()
    assert names_in(tmp_path) == []


KILLED = """
import os, sys
from sklearn_mcmd.tiling._folder import WorkFolder
from sklearn_mcmd.tiling._sweeps import lock_of_tiles
folder = WorkFolder(sys.argv[1])
os.kill(os.getpid(), 9)
"""


def test_the_lock_of_a_process_that_was_killed_keeps_nobody_out(small_file, tmp_path):
    assert is_killed(KILLED, tmp_path / "out.las")
    process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=3_000)
    assert names_in(tmp_path) == ["out.las", "small.las"]


@pytest.mark.skipif(os.name != "posix", reason="no shared locks")
def test_a_run_waits_for_tiles_that_one_still_computes_whose_command_was_killed(tmp_path):
    folder, ended = WorkFolder(tmp_path / "out.las"), threading.Event()

    def begin():
        folder.begin("key")
        ended.set()

    with lock_of_tiles(folder.path):
        threading.Thread(target=begin, daemon=True).start()
        assert not ended.wait(0.3)
    assert ended.wait(60)
    folder.remove()
    assert names_in(tmp_path) == []
