"""Arrays and reports of cells on disk: made whole by a rename, and on the disk before it counts."""

import json
from pathlib import Path
from threading import Lock
from types import SimpleNamespace

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line, replacing

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
