"""The folder of a run: arrays and reports of cells, made whole by a rename; one run at a time."""

import hashlib
import json
import os
import shutil
import sys
from contextlib import ExitStack, suppress
from errno import EACCES, EAGAIN
from pathlib import Path
from threading import Lock
from types import SimpleNamespace

import numpy as np

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line, replacing, sync_file, sync_names
from sklearn_mcmd.io._rehearsal import trial_folder

MANIFEST = "manifest.json"
MOVES = "moves.json"
LOCK = "lock"
MARK = "mark"  # which only a run writes, when it makes a folder
# Held while headers of files are read: Python 3.11 may fail where threads parse literals at once.
HEADERS = Lock()


class TilingError(ValueError):
    """A run ended before its output was whole; the message names what is kept of it."""


class CellResults:
    """What tasks have found of cells: arrays by cell and name, and a report, which comes last."""

    def __init__(self, folder):
        self.folder = Path(folder)

    def keep(self, cell, task, found):
        """Keep what a task has found of a cell, by names; what is no array is its report."""
        report = {}
        for name, values in found.items():
            if not isinstance(values, np.ndarray):
                report[name] = values
                continue
            with replacing(self.path(cell, name)) as temporary, open(temporary, "wb") as file:
                write_array(file, values)
        with replacing(self._report(cell, task)) as temporary:
            temporary.write_text(json.dumps(report))

    def is_done(self, cell, task):
        return self._report(cell, task).exists()

    def report(self, cell, task):
        path = self._report(cell, task)
        with one_clear_line(path, "read"):
            return json.loads(path.read_text())

    def read(self, cell, name):
        return np.array(self.mapped(cell, name))

    def mapped(self, cell, name):
        """What `read` returns, of which only what is asked for comes into memory."""
        path = self.path(cell, name)
        with one_clear_line(path, "read"), HEADERS:
            return np.load(path, mmap_mode="r")

    def path(self, cell, name):
        return self.folder / f"{cell}.{name}.npy"

    def _report(self, cell, task):
        return self.folder / f"{cell}.{task}.json"


def write_array(file, values):
    """Write an array to an open file."""
    # To what is no file NumPy writes so that errors say why it failed.
    np.lib.format.write_array(SimpleNamespace(write=file.write), np.asarray(values))


def append(path, values, dtype=np.float64):
    """Write numbers at the end of a file."""
    with one_clear_line(path, "written"), open(path, "ab") as file:
        file.write(np.ascontiguousarray(values, dtype).data)  # unlike tofile, it says why it fails


def appended(path, shape=-1, dtype=np.float64):
    """What was appended to a file, mapped into memory."""
    if not Path(path).exists():  # no error of the system: the same run would meet it again
        raise PointFileError(f"{path}: is lost")
    with one_clear_line(path, "read"):
        return np.memmap(path, dtype, "r").reshape(shape)


class WorkFolder:
    """Temporary files of a run, beside its output.

    A lock keeps other runs out until it is released, or the process ends. The manifest is written
    when all points are in their cells. Sources are the inputs, which must lie elsewhere.
    """

    def __init__(self, target, sources=()):
        self.path, self.key, self.goes_on = self.path_of(target), None, False
        self.cells, self.outputs = self.path / "cells", self.path / "outputs"
        self._manifest, self.moves = self.path / MANIFEST, self.path / MOVES
        for source in sources:
            if Path(os.path.realpath(source)).is_relative_to(self.path):
                told = f"{source}: lies in {self.path}, where temporary files would be"
                raise PointFileError(f"{told}; name another output")
        if not os.path.lexists(self.path):
            self._make()
        is_ours = read_json(self.path / MARK) == self.path.name and not _has_link(self.path)
        if not is_ours and os.path.lexists(self.path):  # else another run has just removed it
            raise FileExistsError(
                f"{self.path} is in the way: it is where temporary files would be, and no run has "
                "made it, or it is or holds a link; move it"
            )
        self._lock = _locked(self.path / LOCK)

    def _make(self):
        """Make the folder, which gets its name when its mark is in it."""
        with trial_folder(self.path.parent) as above:
            (new := above / "tiles").mkdir()
            write_json(new / MARK, self.path.name)
            with suppress(OSError):  # another run may be the first
                new.rename(self.path)

    def begin(self, key, anew=False):
        """Begin or go on; what lies there is removed if it was made with another key, or anew.

        A key tells of inputs and parameters. A worker that another run has left works on, maybe,
        but in the folder of its key: where there is none, its results are nowhere.
        """
        self.key, self.results = key, self.path / f"results-{key[:16]}"
        self.goes_on = not anew and read_json(self._manifest).get("key") == key
        if not self.goes_on:
            self._empty()
            self.moves.unlink(missing_ok=True)
            for folder in (self.cells, self.outputs, self.results):
                folder.mkdir()

    @staticmethod
    def path_of(target):
        return Path(f"{os.path.realpath(target)}.tiles")

    @property
    def constants(self):
        """What is known of the whole cloud, by names, or None if not all points are in cells."""
        return read_json(self._manifest).get("constants")

    def finish_cells(self, constants):
        """Remember that all points are in cells, which are on the disk before."""
        for at, _, names in os.walk(self.cells):
            for name in names:
                sync_file(os.path.join(at, name))
            sync_names(at)
        write_json(self._manifest, {"key": self.key, "constants": constants})

    def release(self):
        """Let other runs in."""
        self._lock.close()

    def remove(self):
        """Remove the folder. The list of moves goes last, with the name, in one step."""
        self._empty()
        if os.name == "nt":  # where open files cannot be moved
            self.release()
        if {file.name for file in self.path.iterdir()} <= {MARK, MOVES, LOCK}:
            with suppress(OSError), trial_folder(self.path.parent) as above:
                self.path.rename(above / "tiles")
        self.moves.unlink(missing_ok=True)  # where others have put files into it
        self.release()

    def _empty(self):
        """Remove all but the list of moves, the mark and locks."""
        self._manifest.unlink(missing_ok=True)  # first: it says that the cells are there
        sync_names(self.path)
        for folder in (self.cells, self.outputs, *self.path.glob("results*")):
            shutil.rmtree(folder, ignore_errors=True)
        for file in self.path.glob(".mcmd-*"):
            with suppress(OSError):
                file.unlink()


def _has_link(folder):
    """Whether a folder is a link, or holds one."""
    within = (os.path.join(at, n) for at, *names in os.walk(folder) for n in (*names[0], *names[1]))
    return any(map(os.path.islink, (folder, *within)))


def _locked(path):
    """A file that is open and locked, until it is closed or the process ends."""
    with suppress(BlockingIOError, FileNotFoundError), ExitStack() as opened:
        file = opened.enter_context(open(path, "a"))  # nothing in it is changed
        try:
            if sys.platform == "win32":
                import msvcrt

                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as err:
            if err.errno in (EACCES, EAGAIN):
                raise BlockingIOError from err
            warn_caller(f"{path}: this disk has no locks; begin no other run with this output")
        if os.path.samestat(os.fstat(file.fileno()), path.stat()):  # else it was just removed
            opened.pop_all()
            return file
    raise TilingError(f"{path}: another run works on this output; wait for it")


def read_json(path):
    """What `write_json` has written; nothing if the file is not as it was, or not there."""
    try:
        digest, _, content = path.read_text().partition("\n")
        return json.loads(content) if digest == _digest(content) else {}
    except (OSError, ValueError):
        return {}


def write_json(path, content):
    content = json.dumps(content)
    with replacing(path) as temporary:
        temporary.write_text(f"{_digest(content)}\n{content}")


def key_of(verb, paths, *known):
    """A hash of a verb, of the files behind paths, and of all else that results depend on."""
    from sklearn_mcmd import __version__

    name, params = type(verb.estimator).__name__, sorted(verb.estimator.get_params().items())
    files = [*paths, *(path for catalog in verb.also for path in catalog.paths)]
    known = verb.content, verb.sensor.key, list(map(os.path.realpath, files)), *known
    return _digest(repr((__version__, name, params, *known)))


def _digest(content):
    return hashlib.sha256(content.encode()).hexdigest()
