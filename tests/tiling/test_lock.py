"""Two runs with one output: the second is refused, and the first goes on."""

import json
import os
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from sklearn_mcmd.tiling import TilingError, _sweeps, process_files
from sklearn_mcmd.tiling._lock import Lock
from tiled import ESTIMATOR, is_killed


def test_a_second_run_is_refused_while_the_first_works(small_file, tmp_path, monkeypatch):
    target, compute = tmp_path / "out.las", _sweeps.compute_cells

    def second(*args):
        with pytest.raises(TilingError, match=rf"lock: another run .*process {os.getpid()} on"):
            process_files(small_file, target, ESTIMATOR, tile_size=4_000)
        compute(*args)

    monkeypatch.setattr(_sweeps, "compute_cells", second)
    process_files(small_file, target, ESTIMATOR, tile_size=3_000)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.las", "small.las"]


def test_a_lock_whose_process_is_no_more_is_taken_over(tmp_path):
    gone = subprocess.run(
        [sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True
    )
    path = tmp_path / "lock"
    path.write_text(json.dumps({"host": socket.gethostname(), "pid": int(gone.stdout)}))
    lock = Lock(path)
    if os.name == "nt":
        pytest.skip("one cannot ask there")
    lock.acquire()
    assert json.loads(path.read_text())["pid"] == os.getpid()
    with pytest.raises(TilingError, match="another run"):
        Lock(path).acquire()
    lock.release()
    assert not path.exists()


@pytest.mark.parametrize("content", ["", '{"host": "elsewhere", "pid": 1}'])
def test_a_lock_of_another_machine_is_respected(content, tmp_path):
    (tmp_path / "lock").write_text(content)
    with pytest.raises(TilingError, match="remove this file if it is no more"):
        Lock(tmp_path / "lock").acquire()


@pytest.mark.parametrize("pid", ["null", "-1", "1e400", "NaN", '"x"', "[]", str(10**30)])
def test_a_damaged_lock_keeps_others_out(pid, tmp_path):
    (tmp_path / "lock").write_text(f'{{"host": "{socket.gethostname()}", "pid": {pid}}}')
    with pytest.raises(TilingError, match="remove this file if it is no more"):
        Lock(tmp_path / "lock").acquire()


@pytest.mark.parametrize("content", ["[]", "1", '"x"', "{}", "\xff", "[" * 100_000])
def test_a_lock_that_tells_of_nobody_keeps_others_out(content, tmp_path):
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
import json, os, sys
from sklearn_mcmd.tiling._folder import WorkFolder
json.dump = os.link = lambda *args: os.kill(os.getpid(), 9)
WorkFolder(sys.argv[1], "key")
"""


def test_a_kill_while_a_lock_is_taken_keeps_nobody_out(small_file, tmp_path):
    assert is_killed(KILLED, tmp_path / "out.las")
    process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=3_000)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.las", "small.las"]
