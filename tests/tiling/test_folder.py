"""The folder in which a run keeps its work: left, in the way, damaged, too small, or locked."""

import json
import os
import shutil
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.tiling import TilingError, _sweeps, process_files
from sklearn_mcmd.tiling._folder import Lock
from tiled import ESTIMATOR, in_memory, is_killed, names_in


def test_what_a_run_left_that_died_while_it_was_removed_is_in_no_ones_way(small_file, tmp_path):
    """Killed amid the removal of cells, or between the writing and the renaming of a manifest."""
    left = tmp_path / "out.las.tiles"
    for name in ("manifest.json.0123abcd.part", "0.written"):
        (left / "cells").mkdir(parents=True)
        (left / name).write_text("{}")
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
        assert not left.exists()


def test_cells_that_are_removed_in_part_are_read_again(small_file, tmp_path, monkeypatch):
    target = tmp_path / "out.las"

    def remove_part(path, **_):
        if (path / "cells.npz").exists():
            (path / "cells.npz").unlink()
            raise MemoryError("too much")

    with monkeypatch.context() as patch:
        patch.setattr("shutil.rmtree", remove_part)
        with pytest.raises(TilingError, match="too much"):
            process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    assert process_files(small_file, target, ESTIMATOR, tile_size=2_000).n_resumed == 0
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


def test_a_second_run_is_refused_while_the_first_works(small_file, tmp_path, monkeypatch):
    target, compute = tmp_path / "out.las", _sweeps.compute_cells

    def second(*args):
        with pytest.raises(TilingError, match=rf"lock: another run .*process {os.getpid()} on"):
            process_files(small_file, target, ESTIMATOR, tile_size=4_000)
        compute(*args)

    monkeypatch.setattr(_sweeps, "compute_cells", second)
    process_files(small_file, target, ESTIMATOR, tile_size=3_000)
    assert names_in(tmp_path) == ["out.las", "small.las"]


def test_a_lock_whose_process_is_no_more_is_taken_over(tmp_path):
    if os.name == "nt":
        pytest.skip("one cannot ask there")
    code = "import os; print(os.getpid())"
    gone = subprocess.run([sys.executable, "-c", code], capture_output=True)
    path = tmp_path / "lock"
    path.write_text(json.dumps({"host": socket.gethostname(), "pid": int(gone.stdout)}))
    lock = Lock(path)
    lock.acquire()
    assert json.loads(path.read_text())["pid"] == os.getpid()
    with pytest.raises(TilingError, match="another run"):
        Lock(path).acquire()
    lock.release()
    assert not path.exists()


HERE = f'{{"host": "{socket.gethostname()}", "pid": %s}}'
NO_PROCESS = ["null", "-1", "1e400", "NaN", '"x"', "[]", str(10**30)]
NO_OWNER = ["", "[]", "1", '"x"', "{}", "\xff", "[" * 100_000]


@pytest.mark.parametrize(
    "content",
    ['{"host": "elsewhere", "pid": 1}', *NO_OWNER, *(HERE % pid for pid in NO_PROCESS)],
    ids=lambda content: content[:20],
)
def test_a_lock_of_another_machine_or_a_damaged_one_keeps_others_out(content, tmp_path):
    (tmp_path / "lock").write_text(content, encoding="latin-1")
    with pytest.raises(TilingError, match="remove this file if it is no more"):
        Lock(tmp_path / "lock").acquire()


@pytest.mark.parametrize("has_links", [True, False])
def test_one_of_many_that_ask_at_once_gets_the_lock(tmp_path, monkeypatch, has_links):
    def no_links(*args):
        raise PermissionError(1, "Operation not permitted")

    if not has_links:
        monkeypatch.setattr(os, "link", no_links)
    locks = [Lock(tmp_path / "lock") for _ in range(20)]
    with ThreadPoolExecutor(20) as pool:
        errors = [asked.exception() for asked in [pool.submit(lock.acquire) for lock in locks]]
    assert sum(lock.is_held for lock in locks) == errors.count(None) == 1
    assert {type(error) for error in errors} == {TilingError, type(None)}
    assert json.loads((tmp_path / "lock").read_text())["pid"] == os.getpid()
    assert os.listdir(tmp_path) == ["lock"]


KILLED = """
import os, sys
from sklearn_mcmd.tiling._folder import WorkFolder
os.link = lambda *args: os.kill(os.getpid(), 9)
WorkFolder(sys.argv[1], "key")
"""


def test_a_kill_while_a_lock_is_taken_keeps_nobody_out(small_file, tmp_path):
    assert is_killed(KILLED, tmp_path / "out.las")
    process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=3_000)
    assert names_in(tmp_path) == ["out.las", "small.las"]
