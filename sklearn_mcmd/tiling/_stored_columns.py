"""Columns of all places of a cloud, cell after cell in one file each."""

import mmap
import os
import secrets
import shutil
from contextlib import contextmanager, suppress
from threading import Event, Thread

import numpy as np

from sklearn_mcmd.io._files import PointFileError, one_clear_line
from sklearn_mcmd.planes._record import Planes

__all__ = ["ALL", "StoredColumns", "made", "whole_of"]

SECONDS = 0.2  # after which what was read is freed
MOST_PLACES = 2**31 - 1  # rows are numbers of 32 bits
ALL = "all"  # in the place of a cell's number


class StoredColumns:
    """What sweeps have found of all places, as arrays that lie on disk.

    A place is known by its row: those of the first cell come first. Parts of an array come into
    memory when they are asked for, and the system takes their memory when it needs it. The columns
    of cells have the reports of `find_places`, how many each cell has.
    """

    def __init__(self, columns, n_cells):
        self.columns, self.n_cells = columns, n_cells
        sizes = [
            columns.report(cell, "places")["n_places"] if columns.is_done(cell, "places") else 0
            for cell in range(n_cells)
        ]
        self.starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._open, self._headers = [], {}

    def __len__(self):
        return int(self.starts[-1])

    def rows(self, cell):
        """Those of a cell, a slice."""
        return slice(int(self.starts[cell]), int(self.starts[cell + 1]))

    def join(self, *names):
        """Put columns of all cells into one file each; those of the cells are removed."""
        cells = np.flatnonzero(np.diff(self.starts))
        for name in names:
            if not self.columns.is_done(ALL, name):
                first = self.columns.read(cells[0], name)
                made(self._path(name), first.dtype, (len(self), *first.shape[1:]))
                for cell in cells:
                    self.put(cell, **{name: self.columns.read(cell, name)})
                self.columns.finish(ALL, name)
            self.columns.remove(self.n_cells, name)

    def make(self, n_rows=None, /, **columns):
        """Make files for columns that `put` fills, by their names and (dtype, shape of a row).

        They have a row for each place, or `n_rows`.
        """
        if len(self) > MOST_PLACES:
            raise ValueError(f"{len(self):,} different points are more than {MOST_PLACES:,}")
        for name, (dtype, shape) in columns.items():
            if not self.columns.is_done(ALL, name):
                made(self._path(name), dtype, (len(self) if n_rows is None else n_rows, *shape))
                self.columns.finish(ALL, name)

    def put(self, cell, **arrays):
        """Fill what a cell has of columns."""
        for name, values in arrays.items():
            self.write(name, self.rows(cell).start, values)

    def write(self, name, start, values):
        """Fill rows of a column, from one on; no other bytes are written."""
        dtype, shape, offset = self._header(name)
        row = dtype.itemsize * int(np.prod(shape[1:]))
        with open(self._path(name), "r+b") as file:
            file.seek(offset + row * int(start))
            file.write(np.ascontiguousarray(values, dtype).data)

    def remove(self, *names):
        """Free the disk of columns that no later sweep asks for."""
        for name in names:
            self._path(name).unlink(missing_ok=True)

    def open(self, name, changing=False, private=False):
        """The array of a column, as a file that is mapped into memory.

        With `private`, what is written stays in the memory of this process. With `changing`, it is
        the array of a copy, which may be written to. The column itself may not, but is opened as
        if: of an array that is read only Numba would compile everything anew.
        """
        path = self._path(name)
        if changing:
            path = shutil.copyfile(path, path.with_suffix(".changed"))
        stored = np.load(path, mmap_mode="c" if private else "r+")
        if not private:  # to free it would undo what was written
            self._open.append(stored)
        return np.asarray(stored)

    def scratch(self, shape, dtype):
        """An array on disk for the work on what is open; its file has no name."""
        if 0 in np.atleast_1d(shape):
            return np.empty(shape, dtype)
        path = self._path(f"scratch.{secrets.token_hex(4)}")
        self._open.append(made(path, dtype, np.atleast_1d(shape)))
        with suppress(PermissionError):  # Windows, where it stays while it is mapped
            path.unlink()
        return np.asarray(self._open[-1])

    @contextmanager
    def releasing(self):
        """Free what was read of open arrays, time and again, while the work goes on.

        Without this the system does so when others need the memory.
        """
        done = Event()

        def release():
            while not done.wait(SECONDS):
                self.release()

        thread = Thread(target=release, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()

    def release(self):
        """Free the memory of what was read or written of open arrays."""
        for stored in list(self._open):
            if hasattr(mmap, "MADV_DONTNEED"):  # not on Windows; files keep what was written
                stored._mmap.madvise(mmap.MADV_DONTNEED)

    def rows_of(self, name, rows):
        """Some rows of a column, of which nothing else stays in memory."""
        dtype, shape, offset = self._header(name)
        if not isinstance(rows, slice):
            return np.memmap(self._path(name), dtype, "r", offset, shape)[rows]
        width, n = int(np.prod(shape[1:])), rows.stop - rows.start
        offset += rows.start * width * dtype.itemsize
        return np.fromfile(self._path(name), dtype, n * width, offset=offset).reshape(
            -1, *shape[1:]
        )

    def _header(self, name):
        """The dtype and the shape of a column, and where its file has the first row."""
        if name not in self._headers:
            stored = np.load(self._path(name), mmap_mode="r")
            self._headers[name] = stored.dtype, stored.shape, stored.offset
        return self._headers[name]

    def planes(self, changing=False):
        """The planes of all places, as `RegionGrowing` knows them; `changing` as of `open`."""
        nothing = np.empty(0)
        faces = [self.open(name, changing) for name in ("centroids", "normals", "scale")]
        radius = self.open("radius") if self.columns.is_done(ALL, "radius") else nothing
        return Planes(*faces[:2], np.empty((0, 3)), faces[2], nothing, radius, nothing, nothing)

    def _path(self, name):
        return self.columns.folder / f"{ALL}.{name}.npy"


def whole_of(job):
    """The columns of all places that the sweep over a job's cells has found."""
    cells, columns = job.open()
    return StoredColumns(columns, len(cells))


def made(path, dtype, shape):
    """An array in a file that is mapped into memory.

    Its disk is taken at once: where there is too little, this is an error. Writing to memory for
    which the disk has no room would end the process.
    """
    stored = np.lib.format.open_memmap(path, "w+", dtype, tuple(shape))
    if hasattr(os, "posix_fallocate"):  # not on Windows and macOS
        try:
            with one_clear_line(path, "written"), open(path, "r+b") as file:
                os.posix_fallocate(file.fileno(), 0, os.path.getsize(path))
        except PointFileError:
            path.unlink()
            raise
    return stored
