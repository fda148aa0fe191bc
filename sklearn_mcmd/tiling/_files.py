"""Arrays and reports of cells on disk: made whole by a rename, and on the disk before it counts."""

import json
import os
from functools import partial
from pathlib import Path
from threading import Lock
from types import SimpleNamespace

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line, replacing, sync_disk

ALL = "all"  # stands for all cells, in the place of a cell's number
# Held while headers of files are read: Python 3.11 may fail where threads parse literals at once.
HEADERS = Lock()
# As `replacing`, of one of many files, which `CellResults.finish` syncs all at once.
in_place_of = partial(replacing, synced=False)


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
            with in_place_of(self.path(cell, name)) as temporary, open(temporary, "wb") as file:
                write_array(file, values)
        with in_place_of(self._report(cell, task)) as temporary:
            temporary.write_text(json.dumps(report))
            sync_disk(temporary)

    def once(self, task, find):
        """What one process finds of all cells, once: its report."""
        if not self.is_done(ALL, task):
            self.keep(ALL, task, find() or {})
        return self.report(ALL, task)

    def is_done(self, cell, task):
        return self._report(cell, task).exists()

    def report(self, cell, task):
        path = self._report(cell, task)
        with one_clear_line(path, "read"):
            return json.loads(path.read_text())

    def has(self, cell, name):
        return self.path(cell, name).exists()

    def read(self, cell, name):
        return np.array(self.mapped(cell, name))

    def mapped(self, cell, name):
        """What `read` returns, of which only what is asked for comes into memory."""
        return mapped(self.path(cell, name), "r")

    def drop(self, cell, *names):
        """Free the disk of what no later task asks for."""
        for name in names:
            self.path(cell, name).unlink(missing_ok=True)

    def path(self, cell, name):
        return self.folder / f"{cell}.{name}.npy"

    def _report(self, cell, task):
        return self.folder / f"{cell}.{task}.json"


def write_array(file, values):
    """Write an array to an open file."""
    # To what is no file NumPy writes so that errors say why it failed.
    np.lib.format.write_array(SimpleNamespace(write=file.write), np.asarray(values))


def mapped(path, mode):
    """The array of a file, mapped into memory."""
    with one_clear_line(path, "read"), HEADERS:
        return np.load(path, mmap_mode=mode)


def made(path, dtype, shape):
    """An array in a file that is mapped into memory.

    Its disk is taken at once: where there is too little, this is an error. Writing to memory for
    which the disk has no room would end the process.
    """
    with one_clear_line(path, "written"):
        stored = np.lib.format.open_memmap(path, "w+", dtype, tuple(shape))
    if hasattr(os, "posix_fallocate"):  # not on Windows and macOS
        try:
            with one_clear_line(path, "written"), open(path, "r+b") as file:
                os.posix_fallocate(file.fileno(), 0, os.path.getsize(path))
        except PointFileError:
            path.unlink()
            raise
    return stored
