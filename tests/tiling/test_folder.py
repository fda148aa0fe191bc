"""The folder in which a run keeps its work: left, in the way, damaged, too small, or locked."""

import io
import os
import re
import shutil
import warnings
from contextlib import nullcontext

import numpy as np
import pytest

from sklearn_mcmd.io import PointFileError, write_points
from sklearn_mcmd.tiling import TilingError, _tasks, process_files
from sklearn_mcmd.tiling._folder import WorkFolder
from tiled import PCA, but, goes_on, names_in, street

SIZE = {"tile_size": 800}


def everything_in(folder):
    """All that is in a folder: paths, links, and the bytes of files."""
    return {
        path: path.readlink() if path.is_symlink() else path.is_file() and path.read_bytes()
        for path in folder.rglob("*")
    }


def assert_refused_with_all_as_it_was(tmp_path, source, error, match, target="out.las"):
    before = everything_in(tmp_path)
    with pytest.raises(error, match=match):
        process_files(source, tmp_path / target, PCA)
    assert everything_in(tmp_path) == before


@pytest.mark.parametrize("name", ["mine.txt", "results/a.las", "lock", "mark", "cells/ground"])
def test_a_folder_that_no_run_has_made_stays_whatever_names_are_in_it(name, small_file, tmp_path):
    other = tmp_path / "out.las.tiles" / name
    other.parent.mkdir(parents=True)
    other.write_text("mine")
    assert_refused_with_all_as_it_was(tmp_path, small_file, FileExistsError, "in the way")


@pytest.mark.parametrize("is_left", [False, True])
def test_inputs_in_the_folder_of_temporary_files_are_refused_and_stay(is_left, tmp_path):
    if is_left:
        WorkFolder(tmp_path / "city").release()
    (folder := tmp_path / "city.tiles" / "results").mkdir(parents=True)
    for path in (folder / "a.las", tmp_path / "other.las"):
        write_points(path, street(2_000))
    (tmp_path / "link.las").symlink_to(folder / "a.las")
    told = r"lies in .*city.tiles, where temporary files"
    for source in (folder, [tmp_path / "other.las", tmp_path / "link.las"]):
        assert_refused_with_all_as_it_was(tmp_path, source, PointFileError, told, "city")


@pytest.mark.skipif(os.name == "nt", reason="links need rights")
@pytest.mark.parametrize("name", ["", "lock", "lock.tiles", "results", "cells/1.rows", "mark"])
def test_no_link_is_followed_out_of_the_folder_of_temporary_files(name, small_file, tmp_path):
    (mine := tmp_path / "mine").mkdir()
    (mine / "file").write_text("mine")
    WorkFolder(tmp_path / "out.las").release()
    link, to = tmp_path / "out.las.tiles" / name, mine if name in ("", "results") else mine / "file"
    link.parent.mkdir(exist_ok=True)
    if link.exists():
        link.rename(to := mine / "moved")
    link.symlink_to(to)
    assert_refused_with_all_as_it_was(tmp_path, small_file, FileExistsError, "is or holds a link")


def test_too_small_a_disk_is_said_but_a_run_that_goes_on_needs_no_room(
    small_file, ended, tmp_path, monkeypatch
):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(9, 8, 1000))
    with pytest.raises(PointFileError, match="are free"):
        process_files(small_file, tmp_path / "other.las", PCA)
    assert process_files(small_file, ended, PCA, **SIZE).n_resumed == 3
    assert names_in(tmp_path) == ["out.las", "small.las"]


def pickled(_):
    """What NumPy would run as code, if one let it."""
    np.save(stored := io.BytesIO(), np.array([print, None]), allow_pickle=True)
    return stored.getvalue()


@pytest.mark.parametrize(
    ("name", "damage", "said"),
    [
        ("manifest.json", lambda told: told[:-9], ""),
        ("manifest.json", lambda told: told.replace(b'"steps": [0.', b'"steps": [1.'), ""),
        ("cells/cells.npz", lambda _: b"PK", r"cells.npz: cannot be read.*begins anew"),
        ("*/0.results.npy", lambda stored: stored[:99], r"results.npy: cannot be .*begins anew"),
        ("*/0.results.npy", pickled, "results.npy: cannot be read.*begins anew"),
        ("*/0.fit.json", lambda _: b"", ""),
        ("*/0.fit.json", lambda _: b"{", r"0.fit.json: cannot be read.*begins anew"),
    ],
)
def test_a_run_that_meets_a_damaged_file_names_it_and_begins_anew(
    small_file, ended, name, damage, said
):
    (path,) = ended.with_name("out.las.tiles").glob(name)
    before = path.read_bytes()
    path.write_bytes(damage(before))
    assert path.read_bytes() != before
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        report = goes_on(small_file, ended, **SIZE)
    assert re.search(said, "; ".join(str(warning.message) for warning in caught))
    assert report.n_resumed == 0


def test_a_run_that_lost_the_points_of_a_cell_begins_anew(small_file, ended):
    next(ended.with_name("out.las.tiles").glob("cells/*.points")).unlink()
    with pytest.warns(match=r"\.points: is lost"), pytest.warns(match="begins anew"):
        assert goes_on(small_file, ended, **SIZE).n_resumed == 0


def test_a_second_run_is_refused_while_the_first_works(small_file, tmp_path, monkeypatch):
    target, compute = tmp_path / "out.las", _tasks.compute_cells

    def second(*args):
        with pytest.raises(TilingError, match="lock: another run works on this output"):
            process_files(small_file, target, PCA, tile_size=1_600)
        compute(*args)

    monkeypatch.setattr(_tasks, "compute_cells", second)
    process_files(small_file, target, PCA, tile_size=1_200)
    assert names_in(tmp_path) == ["out.las", "small.las"]


@pytest.mark.parametrize("k", [16, 12], ids=["same", "other"])
def test_what_workers_of_a_killed_command_still_write_does_not_matter(
    small_file, tmp_path, monkeypatch, k
):
    """Those of the same run write the same; those of another, where nobody reads."""
    target, tasks = tmp_path / "out.las", []

    def leave(task, cells, todo, n_workers):
        tasks.append(task)
        raise MemoryError("killed")

    def find(cells, cell, *args, of=_tasks.part_of_cell):
        while tasks:  # the worker is at it when the next run has begun
            with nullcontext() if k == 16 else pytest.raises(PointFileError, match="not exist"):
                tasks.pop()(0)
        return of(cells, cell, *args)

    monkeypatch.setattr(_tasks, "compute_cells", leave)
    with pytest.raises(TilingError, match="killed; what was done is kept"):
        process_files(small_file, target, but(PCA, n_neighbors=k), **SIZE)
    folder = tasks[0].keywords["job"].results.folder
    monkeypatch.undo()
    monkeypatch.setattr(_tasks, "part_of_cell", find)
    goes_on(small_file, target, **SIZE)
    assert not tasks
    assert not folder.exists()
