"""The folder in which a run by tiles keeps its work: left, in the way, damaged or too small."""

import shutil

import pytest

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.tiling import TilingError, process_files
from sklearn_mcmd.tiling._cloud_constants import Constants
from sklearn_mcmd.tiling._folder import WorkFolder
from tiled import ESTIMATOR, in_memory


def test_what_a_run_left_that_died_while_it_was_removed_is_in_no_ones_way(small_file, tmp_path):
    """Killed amid the removal of cells, or between the writing and the renaming of a manifest."""
    left = tmp_path / "out.las.tiles"
    for name in ("manifest.json.0123abcd.part", "0.written"):
        (left / "cells").mkdir(parents=True)
        (left / name).write_text("{}")
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
        assert not left.exists()


def test_the_manifest_goes_before_the_cells_that_it_tells_of(tmp_path, monkeypatch):
    folder = WorkFolder(tmp_path / "out.las", "key")
    folder.clear()
    folder.finish_cells(Constants("float64", 0.0))

    def fail(*_, **__):
        raise MemoryError

    monkeypatch.setattr("shutil.rmtree", fail)
    with pytest.raises(MemoryError):
        folder.remove()
    assert folder.constants is None


def test_a_folder_of_others_is_not_removed(small_file, tmp_path):
    other = tmp_path / "out.las.tiles" / "mine.txt"
    other.parent.mkdir()
    other.write_text("mine")
    with pytest.raises(FileExistsError, match="in the way"):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR)
    assert other.read_text() == "mine"


def test_too_small_a_disk_is_said_before_the_work(small_file, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(9, 8, 1000))
    with pytest.raises(PointFileError, match="are free"):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR)
    assert [path.name for path in tmp_path.iterdir()] == ["small.las"]


def test_a_run_that_goes_on_needs_no_room_for_what_is_there(
    small_file, tmp_path, monkeypatch, failing
):
    failing.add(1)
    with pytest.warns(match="tile 1 failed"), pytest.raises(TilingError):
        process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    failing.clear()
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(9, 8, 1000))
    report = process_files(small_file, tmp_path / "out.las", ESTIMATOR, tile_size=2_000)
    assert report.n_resumed == 3


@pytest.mark.parametrize("damage", [lambda told: told[:-9], lambda told: told.replace(b"f", b"i")])
def test_a_manifest_that_is_not_as_it_was_written_begins_anew(
    small_file, tmp_path, failing, damage
):
    target = tmp_path / "out.las"
    failing.add(1)
    with pytest.warns(match="tile 1 failed"), pytest.raises(TilingError):
        process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    failing.clear()
    manifest = tmp_path / "out.las.tiles" / "manifest.json"
    manifest.write_bytes(damage(manifest.read_bytes()))
    report = process_files(small_file, target, ESTIMATOR, tile_size=2_000)
    assert report.n_resumed == 0
    assert target.read_bytes() == in_memory(small_file, tmp_path / "e.las").read_bytes()
