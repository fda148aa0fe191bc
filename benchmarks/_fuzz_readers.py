"""What `fuzz_files` calls with a broken file, and which errors that may raise."""

import shutil
from contextlib import suppress
from types import SimpleNamespace

from _fuzz_seeds import seeds_of

from sklearn_mcmd.cli._info import summarize
from sklearn_mcmd.io import PointFileError, read_points, read_trajectory
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.tiling import Catalog, TilingError
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._folder import CellResults, WorkFolder
from sklearn_mcmd.tiling._outputs import resume_moves

STORED = "manifest.json moves.json cells.npz 0.a.npy 0.a.json"


def reader_of(name, folder):
    """The function that reads a path, and the errors that it may raise."""
    if name in ("las", "laz"):
        return _read_las, PointFileError
    if name == "trajectory":
        return read_trajectory, PointFileError
    if name == "index":
        (folder / "a.las").write_bytes(next(iter(seeds_of("las", folder))))
        return Catalog, PointFileError
    if name == "store":
        return _stores(folder), (PointFileError, TilingError, FileExistsError)
    return _read_all, PointFileError


def _read_all(path):
    """Read, and say what was read."""
    cloud = read_points(path)
    summarize(path, cloud)
    return cloud


def _read_las(path):
    """In one part and in several: what one way reads, the other does."""
    cloud = _read_all(path)
    if sum(map(len, read_parts(path, 2))) != len(cloud) + cloud.n_dropped:
        raise AssertionError("parts differ from the whole")


def _stores(folder):
    """What a run finds in its folder, whichever of its files is broken."""
    target = folder / "out.las"
    verb = SimpleNamespace(
        estimator=SimpleNamespace(get_params=dict), content="", sensor=SimpleNamespace(key="")
    )
    catalog = SimpleNamespace(paths=[folder / "a.las"])
    place = WorkFolder.path_of(target)

    def store(path):
        for name in STORED.split():
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
            shutil.copyfile(path, place / name)
            try:
                opened = WorkFolder(target)
            except FileExistsError:
                continue
            _ = opened.constants
            columns = CellResults(place)
            for read, args in ((Cells, [place]), (columns.read, "0a"), (columns.report, "0a")):
                with suppress(PointFileError):
                    read(*args)
            with suppress(TilingError):
                resume_moves(verb, catalog, [target], opened)
            opened.remove()

    return store
