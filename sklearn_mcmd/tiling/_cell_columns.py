"""Values of the places of cells on disk, which one sweep over the cells writes for the next."""

import json
import os
import secrets
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from sklearn_mcmd.io._files import one_clear_line

__all__ = ["CellColumns", "in_place_of"]


class CellColumns:
    """Arrays by their cell and name, a file each.

    A place is a distinct point; its copies lie in the same cell. What a sweep has written of a cell
    counts when its report is there, which is the last that it writes.
    """

    def __init__(self, folder):
        self.folder = Path(folder)

    def read(self, cell, name):
        path = self._path(cell, name)
        with one_clear_line(path, "read"):
            return np.load(path)

    def write(self, cell, **arrays):
        for name, values in arrays.items():
            with in_place_of(self._path(cell, name)) as temporary, open(temporary, "wb") as file:
                np.save(file, values)

    def finish(self, cell, sweep, **report):
        """Remember that a sweep has written all of a cell, and what it tells of it."""
        with in_place_of(self._report(cell, sweep)) as temporary:
            temporary.write_text(json.dumps(report))

    def is_done(self, cell, sweep):
        return self._report(cell, sweep).exists()

    def report(self, cell, sweep):
        path = self._report(cell, sweep)
        with one_clear_line(path, "read"):
            return json.loads(path.read_text())

    def n_done(self, n_cells, sweep):
        """Cells of which a sweep has written all."""
        return sum(self.is_done(cell, sweep) for cell in range(n_cells))

    def total(self, n_cells, sweep, name):
        """The sum over all cells of a number in their reports."""
        return sum(self.report(cell, sweep)[name] for cell in range(n_cells))

    def remove(self, n_cells, *names):
        """Free the disk of arrays that no later sweep asks for."""
        for cell in range(n_cells):
            for name in names:
                self._path(cell, name).unlink(missing_ok=True)

    def _path(self, cell, name):
        return self.folder / f"{cell}.{name}.npy"

    def _report(self, cell, sweep):
        return self.folder / f"{cell}.{sweep}.json"


@contextmanager
def in_place_of(path):
    """A name that no other process takes; its file replaces `path`, which others may read."""
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
