"""Outputs of runs that ended while they were written, above all where they replace inputs."""

import errno
import os
import shutil
import sys
from pathlib import Path

import pytest

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.io import write_points
from sklearn_mcmd.tiling import TilingError, _outputs, _run, process_files
from tiled import ESTIMATOR, is_killed, names_in, street

DETECTOR = MCMDOutlierDetector(16, contamination=0.05, random_state=0)
NAMES = ["a.las", "b.las"]
SIZE = {"tile_size": 1_500}


@pytest.fixture
def drive(tmp_path):
    """A function that makes a folder of two files."""

    def make(name):
        (tmp_path / name).mkdir()
        for seed, file in enumerate(NAMES):
            write_points(tmp_path / name / file, street(1_200, seed))
        return tmp_path / name

    return make


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def end_at_second_output(monkeypatch, source, target, estimator=DETECTOR, **options):
    """Interrupt a run when it begins the second of two outputs."""
    real, calls = _outputs.parts_of, []

    def end(*args):
        calls.append(args)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*args)

    with monkeypatch.context() as patch:
        patch.setattr(_outputs, "parts_of", end)
        with pytest.warns(match="kept in") as caught, pytest.raises(KeyboardInterrupt):
            process_files(source, target, estimator, **SIZE, **options)
        assert [warning.filename for warning in caught] == [__file__]


@pytest.fixture
def replaced(drive):
    """A folder whose files a whole run has replaced, and its report."""
    folder = drive("whole")
    report = process_files(folder, folder, DETECTOR, **SIZE)
    return contents(folder), report.n_outliers


def test_inputs_are_kept_until_all_outputs_are_written(drive, replaced, monkeypatch):
    folder = drive("early")
    before = contents(folder)
    end_at_second_output(monkeypatch, folder, folder)
    assert {name: contents(folder)[name] for name in NAMES} == before
    report = process_files(folder, folder, DETECTOR, **SIZE)
    assert (contents(folder), report.n_outliers) == replaced
    assert not folder.with_name("early.tiles").exists()


def test_a_run_that_ended_between_two_moves_has_only_to_move(drive, replaced, monkeypatch):
    folder = drive("early")
    before, move = contents(folder), _outputs._move
    with monkeypatch.context() as patch:
        patch.setattr(_outputs, "_move", lambda moves: move(moves[:1]) or 1 / 0)
        with pytest.raises(TilingError, match="kept in"):
            process_files(folder, folder, DETECTOR, **SIZE)
    assert sum(contents(folder)[name] != before[name] for name in NAMES) == 1
    for source, mode in ((folder, "mark"), (drive("others"), "drop")):
        with pytest.raises(TilingError, match="had replaced some of its inputs"):
            process_files(source, folder, DETECTOR, mode=mode, **SIZE)
    report = process_files(folder, folder, DETECTOR, **SIZE)
    assert (contents(folder), report.n_outliers) == replaced
    assert report.n_resumed == report.n_tiles
    assert not folder.with_name("early.tiles").exists()


# A process that is killed at the n-th call of the system that changes names.
REMOVAL = """
import os, signal, sys
from sklearn_mcmd.tiling._folder import WorkFolder

left = [int(sys.argv[2])]

def counted(work):
    def call(*args, **kwargs):
        if left[0] == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        left[0] -= 1
        return work(*args, **kwargs)
    return call

folder = WorkFolder(sys.argv[1])
for name in "unlink", "rmdir", "rename", "replace", "mkdir":
    setattr(os, name, counted(getattr(os, name)))
folder.remove()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="processes are forked")
def test_outputs_in_place_are_not_judged_again_wherever_the_removal_is_killed(
    drive, replaced, monkeypatch, tmp_path
):
    folder, work, kept = drive("early"), tmp_path / "early.tiles", tmp_path / "kept"
    with monkeypatch.context() as patch:
        patch.setattr(_run.WorkFolder, "remove", lambda _: 1 / 0)
        with pytest.raises(TilingError, match="kept in"):
            process_files(folder, folder, DETECTOR, **SIZE)
    assert contents(folder) == replaced[0]
    for path in [path for path in work.glob("*/*.*") if path.is_file()][4:]:
        path.unlink()  # a few are enough
    shutil.copytree(work, kept)
    n, n_resumed = 0, 0
    while is_killed(REMOVAL, folder, n):
        if work.exists():  # else the run was at its end
            report = process_files(folder, folder, DETECTOR, **SIZE)
            n_resumed += report.n_resumed == report.n_tiles
            assert (contents(folder), report.n_outliers) == replaced
        assert not work.exists()
        n += 1
        shutil.copytree(kept, work)
    assert n > n_resumed > 5


def test_an_output_may_be_a_link_to_another_disk(drive, tmp_path, monkeypatch):
    source, rename = drive("in"), os.replace
    (tmp_path / "disk").mkdir()
    target = tmp_path / "out.las"
    target.symlink_to(tmp_path / "disk" / "out.las")

    def rename_on_one_disk(old, new):
        if Path(old).parent.name == "outputs" != Path(new).parent.name:
            raise OSError(errno.EXDEV, "Invalid cross-device link")
        rename(old, new)

    monkeypatch.setattr(os, "replace", rename_on_one_disk)
    process_files(source / "a.las", target, ESTIMATOR, **SIZE)
    monkeypatch.undo()
    process_files(source / "a.las", tmp_path / "expected.las", ESTIMATOR, **SIZE)
    assert target.is_symlink()
    assert target.read_bytes() == (tmp_path / "expected.las").read_bytes()
    assert names_in(tmp_path / "disk") == ["out.las"]


def test_a_damaged_list_of_moves_is_told_before_inputs_are_judged_again(
    drive, replaced, monkeypatch
):
    folder = drive("early")
    with monkeypatch.context() as patch:
        patch.setattr(_outputs, "_move", lambda moves: 1 / 0)
        with pytest.raises(TilingError, match="kept in"):
            process_files(folder, folder, DETECTOR, **SIZE)
    moves = folder.with_name("early.tiles") / "moves.json"
    stored = bytearray(moves.read_bytes())
    stored[-40] ^= 1
    moves.write_bytes(stored)
    with pytest.raises(TilingError, match=r"moves\.json: is damaged, and some inputs"):
        process_files(folder, folder, DETECTOR, **SIZE)
    process_files(folder, folder, DETECTOR, restart=True, **SIZE)
    assert contents(folder) == replaced[0]
