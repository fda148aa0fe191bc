"""Outputs of runs that ended while they were written, above all where they replace inputs."""

import errno
import os
import shutil
import sys
from pathlib import Path

import pytest

from sklearn_mcmd.io import write_points
from sklearn_mcmd.tiling import TilingError, _outputs, _run, process_files
from tiled import OUTLIERS, but, goes_on, is_killed, names_in, street

DETECTOR = but(OUTLIERS, contamination=0.05)
NAMES = ["a.las", "b.las"]
SIZE = {"tile_size": 900}


@pytest.fixture
def folder(tmp_path):
    """Two files, which runs replace."""
    return drive(tmp_path / "drive")


def drive(folder):
    folder.mkdir()
    for seed, name in enumerate(NAMES):
        write_points(folder / name, street(700, seed))
    return folder


def contents(folder):
    return [(folder / name).read_bytes() for name in NAMES]


@pytest.fixture(scope="module")
def replaced(tmp_path_factory):
    """What a whole run makes of such files, and how many outliers it reports."""
    folder = drive(tmp_path_factory.mktemp("whole") / "drive")
    report = process_files(folder, folder, DETECTOR, **SIZE)
    return contents(folder), report.n_outliers


def run_in_place(folder, **options):
    """Returns what `replaced` has, and whether all tiles were resumed; nothing else is left."""
    report = process_files(folder, folder, DETECTOR, **SIZE, **options)
    assert not folder.with_name("drive.tiles").exists()
    assert names_in(folder) == NAMES
    return (contents(folder), report.n_outliers), report.n_resumed == report.n_tiles


def end_at(owner, name, work, folder, monkeypatch):
    """Let a run end where a function is called."""
    with monkeypatch.context() as patch:
        patch.setattr(owner, name, work)
        with pytest.raises(TilingError, match="kept in"):
            process_files(folder, folder, DETECTOR, **SIZE)


def test_inputs_are_kept_until_all_outputs_are_written(folder, replaced, monkeypatch):
    real, calls, before = _outputs.parts_of, [], contents(folder)

    def end(*args):
        calls.append(args)
        if len(calls) == 2:  # at the second output
            raise KeyboardInterrupt
        return real(*args)

    with monkeypatch.context() as patch:
        patch.setattr(_outputs, "parts_of", end)
        with pytest.warns(match="kept in") as caught, pytest.raises(KeyboardInterrupt):
            process_files(folder, folder, DETECTOR, **SIZE)
    assert [warning.filename for warning in caught] == [__file__]
    assert contents(folder) == before
    assert run_in_place(folder) == (replaced, True)


def test_a_run_that_ended_between_two_moves_has_only_to_move(
    folder, replaced, tmp_path, monkeypatch
):
    before, move = contents(folder), _outputs._move
    end_at(_outputs, "_move", lambda moves: move(moves[:1]) or 1 / 0, folder, monkeypatch)
    assert sum(new != old for new, old in zip(contents(folder), before, strict=True)) == 1
    for source, mode in ((folder, "mark"), (drive(tmp_path / "others"), "drop")):
        with pytest.raises(TilingError, match="had replaced some of its inputs"):
            process_files(source, folder, DETECTOR, mode=mode, **SIZE)
    assert run_in_place(folder) == (replaced, True)


def test_a_damaged_list_of_moves_is_told_before_inputs_are_judged_again(
    folder, replaced, monkeypatch
):
    end_at(_outputs, "_move", lambda moves: 1 / 0, folder, monkeypatch)
    moves = folder.with_name("drive.tiles") / "moves.json"
    stored = bytearray(moves.read_bytes())
    stored[-40] ^= 1
    moves.write_bytes(stored)
    with pytest.raises(TilingError, match=r"moves\.json: is damaged, and some inputs"):
        process_files(folder, folder, DETECTOR, **SIZE)
    assert run_in_place(folder, restart=True) == (replaced, False)


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
    folder, replaced, monkeypatch, tmp_path
):
    work, kept = tmp_path / "drive.tiles", tmp_path / "kept"
    end_at(_run.WorkFolder, "remove", lambda _: 1 / 0, folder, monkeypatch)
    assert contents(folder) == replaced[0]
    for path in [path for path in work.glob("*/*.*") if path.is_file()][4:]:
        path.unlink()  # a few are enough
    shutil.copytree(work, kept)
    n, n_resumed = 0, 0
    while is_killed(REMOVAL, folder, n):
        if work.exists():  # else the run was at its end
            found, is_resumed = run_in_place(folder)
            assert found == replaced
            n_resumed += is_resumed
        n += 1
        shutil.copytree(kept, work)
    assert n > n_resumed > 5


def test_an_output_may_be_a_link_to_another_disk(folder, tmp_path, monkeypatch):
    rename, target = os.replace, tmp_path / "out.las"
    (tmp_path / "disk").mkdir()
    target.symlink_to(tmp_path / "disk" / "out.las")

    def rename_on_one_disk(old, new):
        if Path(old).parent.name == "outputs" != Path(new).parent.name:
            raise OSError(errno.EXDEV, "Invalid cross-device link")
        rename(old, new)

    monkeypatch.setattr(os, "replace", rename_on_one_disk)
    goes_on(folder / "a.las", target, **SIZE)
    assert target.is_symlink()
    assert names_in(tmp_path / "disk") == ["out.las"]
