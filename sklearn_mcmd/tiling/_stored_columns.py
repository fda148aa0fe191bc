"""Values of places on disk, which one sweep over the cells writes for the next.

A place is a distinct point; its copies lie in the same cell. `CellColumns` has a file for each
cell and column, `StoredColumns` one for each column of all cells.
"""

import json
import os
import shutil
from functools import cached_property, partial
from pathlib import Path
from threading import Lock
from types import SimpleNamespace

import numpy as np

from sklearn_mcmd.io._files import one_clear_line, replacing, sync_disk
from sklearn_mcmd.io._point_cloud import PointFileError
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import slices

MOST_PLACES = 2**31 - 1  # rows are numbers of 32 bits
STARTS = "first_rows"  # the column of the first row of each cell
# Held while headers of files are read: Python 3.11 may fail where threads parse literals at once.
HEADERS = Lock()
# Rows whose pages are in memory at once. Opening columns for each border that votes took half as
# long again.
FEW = 2**15
ALL = "all"  # stands for all cells, in the place of a cell's number
# As `replacing`, of one of many files, which `CellColumns.finish` syncs all at once.
in_place_of = partial(replacing, synced=False)


class CellColumns:
    """Arrays by their cell and name; a sweep writes its report of a cell last."""

    def __init__(self, folder):
        self.folder = Path(folder)

    def read(self, cell, name):
        return np.array(self.mapped(cell, name))

    def gather(self, cells, name):
        """What `read` returns of some cells, one after the other."""
        return np.concatenate([self.read(cell, name) for cell in cells])

    def share(self, cells, like, **arrays):
        """Write for each of some cells its part, of as many rows as it has of the column `like`."""
        ends = np.cumsum([len(self.mapped(cell, like)) for cell in cells])
        for name, values in arrays.items():
            for cell, part in zip(cells, np.split(values, ends[:-1]), strict=True):
                self.write(cell, **{name: part})

    def mapped(self, cell, name):
        """What `read` returns, of which only what is asked for comes into memory."""
        return mapped(self.path(cell, name), "r")

    def write(self, cell, **arrays):
        for name, values in arrays.items():
            with in_place_of(self.path(cell, name)) as temporary, open(temporary, "wb") as file:
                write_array(file, values)

    def keep(self, cell, sweep, found):
        """Write what a sweep has found of a cell, by names; what is no array is its report.

        An array fills its part of the column of all places, if there is one, else it has a file.
        """
        whole, report = StoredColumns(self), {}
        for name, values in found.items():
            if not isinstance(values, np.ndarray):
                report[name] = values
            elif whole.has(name):
                whole.put(cell, **{name: values})
            else:
                self.write(cell, **{name: values})
        self.finish(cell, sweep, **report)

    def once(self, sweep, find):
        """What one process reports of all cells, which is found once."""
        if not self.is_done(ALL, sweep):
            self.finish(ALL, sweep, **(find() or {}))
        return self.report(ALL, sweep)

    def finish(self, cell, sweep, **report):
        """Remember that a sweep has written all of a cell, which is on the disk before, and what
        it reports of it."""
        with in_place_of(self._report(cell, sweep)) as temporary:
            temporary.write_text(json.dumps(report))
            sync_disk(temporary)

    def is_done(self, cell, sweep):
        return self._report(cell, sweep).exists()

    def report(self, cell, sweep):
        path = self._report(cell, sweep)
        with one_clear_line(path, "read"):
            return json.loads(path.read_text())

    def all_have(self, n_cells, name):
        """Whether each cell has a column."""
        return all(self.path(cell, name).exists() for cell in range(n_cells))

    def drop(self, cell, *names):
        """Free the disk of what no later sweep asks for."""
        for name in names:
            self.path(cell, name).unlink(missing_ok=True)

    def path(self, cell, name):
        return self.folder / f"{cell}.{name}.npy"

    def _report(self, cell, sweep):
        return self.folder / f"{cell}.{sweep}.json"


class StoredColumns:
    """What sweeps have found of all places, as arrays that lie on disk.

    A place is known by its row: those of the first cell come first. Parts of an array come into
    memory when they are asked for, and the system takes their memory when it needs it. The columns
    of cells have the reports of `find_places`, how many each cell has.
    """

    def __init__(self, columns, n_cells=0):
        self.columns, self.n_cells, self._known = columns, n_cells, {}
        if columns.path(ALL, STARTS).exists():
            self.starts = columns.read(ALL, STARTS)
            return
        sizes = [
            columns.report(cell, "places")["n_places"] if columns.is_done(cell, "places") else 0
            for cell in range(n_cells)
        ]
        self.starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)

    def __len__(self):
        return int(self.starts[-1])

    def rows(self, cell):
        """Those of a cell, a slice."""
        return slice(int(self.starts[cell]), int(self.starts[cell + 1]))

    def xyz(self, cells, cell):
        """The coordinates of the points of a cell, wherever they are."""
        columns = self.columns
        if not columns.is_done(cell, "places"):
            return cells.points(cell)
        if columns.path(cell, "points").exists():  # until `join_points` has been there
            points = columns.read(cell, "points")
        else:
            points = self.rows_of("points", self.rows(cell))
        return points[columns.read(cell, "place_of")]

    def make(self, n_rows=None, /, **columns):
        """Make files for columns, given as the dtype of a row, for each place or `n_rows`."""
        if len(self) > MOST_PLACES:
            raise ValueError(f"{len(self):,} different points are more than {MOST_PLACES:,}")
        self.columns.write(ALL, **{STARTS: self.starts})  # so that nobody asks all cells again
        n_rows = len(self) if n_rows is None else n_rows
        for name, row in columns.items():
            if not self.columns.is_done(ALL, name):
                dtype = np.dtype(row)
                made(self._path(name), dtype.base, (n_rows, *dtype.shape))
                self.columns.finish(ALL, name)

    def put(self, cell, **arrays):
        """Fill what a cell has of columns."""
        for name, values in arrays.items():
            self.write(name, self.rows(cell).start, values)

    def write(self, name, start, values):
        """Fill rows of a column, from one on; no other bytes are written."""
        self.column(name)[start : start + len(values)] = values

    def change(self, cell, **arrays):
        """Keep beside columns the numbers that a cell changes of them, until all cells are done."""
        own, at, numbers = self.rows(cell), [], []
        for name, values in arrays.items():
            values, before = values.ravel(), self.rows_of(name, own).ravel()
            at.append(values.view(np.int64) != before.view(np.int64))
            numbers.append(values[at[-1]].view(np.uint8))
        self.columns.write(
            cell, changes=np.concatenate([np.packbits(np.concatenate(at)), *numbers])
        )

    def changed(self, cell, **arrays):
        """Change arrays of the places of a cell as `change` has kept it."""
        own = [values.reshape(-1) for values in arrays.values()]
        ends = np.cumsum([*map(len, own)])
        at, numbers = np.split(self.columns.read(cell, "changes"), [-(-ends[-1] // 8)])
        at, numbers = np.unpackbits(at).view(bool), np.frombuffer(numbers.tobytes())
        for values, some in zip(own, np.split(at, ends), strict=False):
            values[some], numbers = np.split(numbers, [np.count_nonzero(some)])

    def copy(self, again=False, /, **names):
        """Keep columns under another name, as they are; once, or `again`."""
        for name, other in names.items():
            if again or not self.columns.is_done(ALL, other):
                with one_clear_line(self._path(other), "written"):
                    shutil.copyfile(self._path(name), self._path(other))
                self.columns.finish(ALL, other)

    def has(self, name):
        """Whether the file of a column is there."""
        return self._path(name).exists()

    def remove(self, *names):
        """Free the disk of columns that no later sweep asks for."""
        self.columns.drop(ALL, *names)

    def open(self, name, private=False):
        """The array of a column, as a file that is mapped into memory.

        With `private`, what is written stays in the memory of this process. It is opened as if it
        were to be written to: of an array that is read only Numba would compile everything anew.
        """
        return np.asarray(mapped(self._path(name), "c" if private else "r+"))

    def rows_of(self, name, rows):
        """Some rows of a column, of which nothing else stays in memory."""
        return self.column(name)[rows]

    def column(self, name):
        """The `Column` of this name."""
        return self._known.setdefault(name, Column(self._path(name)))

    def open_column(self, name):
        """The `OpenColumn` of this name."""
        return OpenColumn(self._path(name))

    def planes(self, private=False):
        """The planes of all places, as far as they are stored; spacing is another one."""
        names = [name for name in Planes._fields if name != "spacing" and self.has(name)]
        return Planes.empty(0, 3)._replace(**{name: self.open(name, private) for name in names})

    def _path(self, name):
        return self.columns.path(ALL, name)


class Column:
    """A column by its rows, in any process: what is asked for comes into memory, and is written to
    the file, and nothing else."""

    def __init__(self, path):
        self.path = path

    def __len__(self):
        return self.shape[0]

    @property
    def shape(self):
        return self._known[2]

    @cached_property
    def _known(self):
        """Where the values begin in the file, their type, and the shape."""
        stored = mapped(self.path, "r")
        return stored.offset, stored.dtype, stored.shape

    def __getitem__(self, rows):
        offset, dtype, shape = self._known
        with one_clear_line(self.path, "read"):
            if isinstance(rows, slice):  # read, which is faster than mapped and copied
                start, stop, _ = rows.indices(shape[0])
                width = int(np.prod(shape[1:]))
                offset += start * width * dtype.itemsize
                found = np.fromfile(self.path, dtype, max(0, stop - start) * width, offset=offset)
                return found.reshape(max(0, stop - start), *shape[1:])
            return self._of_rows(rows)

    def _mapped(self):
        offset, dtype, shape = self._known
        return np.memmap(str(self.path), dtype, "r", offset, shape)

    def _of_rows(self, rows):
        """What it has of some rows, in pieces: the pages of one are free before the next."""
        _, dtype, shape = self._known
        found, rows_of = np.empty((rows.size, *shape[1:]), dtype), rows.ravel()
        order = np.argsort(rows_of) if rows.size > FEW else np.arange(rows.size)
        for some in slices(len(order), FEW):
            piece = order[some]
            found[piece] = self._mapped()[rows_of[piece]]
        return found.reshape(*rows.shape, *shape[1:])

    def __setitem__(self, rows, values):
        offset, dtype, shape = self._known
        if isinstance(rows, slice):
            parts = [(rows.indices(shape[0])[0], values)] * (len(values) > 0)
        else:
            order = np.argsort(rows)
            rows, values = rows[order], np.broadcast_to(values, rows.shape + shape[1:])
            ends = np.flatnonzero(np.diff(rows, prepend=-2) != 1)  # one part for each run of rows
            parts = zip(rows[ends].tolist(), np.split(values[order], ends[1:]), strict=False)
        width = int(np.prod(shape[1:])) * dtype.itemsize
        with one_clear_line(self.path, "written"), open(self.path, "r+b") as file:
            for start, some in parts:
                file.seek(offset + width * start)
                file.write(np.ascontiguousarray(some, dtype).data)


class OpenColumn(Column):
    """A column that stays open for some rows, then is opened anew: few pages stay in memory."""

    def __init__(self, path):
        super().__init__(path)
        self._held = None, 0  # the open file, and for how many rows it stays open

    def __getitem__(self, rows):
        if isinstance(rows, slice) or rows.size > FEW:
            return super().__getitem__(rows)
        opened, left = self._held
        if left <= 0:
            opened, left = np.asarray(self._mapped()), FEW
        self._held = opened, left - rows.size
        return opened[rows]


class RevisedColumn(Column):
    """A column that is changed once; what it was is kept beside it, for `restore`."""

    def __setitem__(self, rows, values):
        with replacing(self._before) as temporary, open(temporary, "wb") as file:
            np.savez(file, rows=rows, values=self[rows])
        super().__setitem__(rows, values)

    def restore(self):
        """Make it what it was, if a run has ended after it was changed."""
        if self._before.exists():
            with np.load(self._before) as before:
                super().__setitem__(before["rows"], before["values"])

    @property
    def _before(self):
        return self.path.with_suffix(".before")


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
