"""Columns of all places of a cloud, cell after cell in one file each, and an index over them."""

import mmap
import os
import secrets
import shutil

import numpy as np

from sklearn_mcmd.planes._record import Neighborhoods, Planes

__all__ = ["StoredIndex", "WholeColumns"]

CHUNK = 4096  # rows that are asked for at once
RELEASED = 1_000_000  # rows that are asked for until the memory is freed
ALL = "all"  # in the place of a cell's number


class WholeColumns:
    """What sweeps have found of all places, as arrays that lie on disk.

    A place is known by its row: those of the first cell come first. Parts of an array come into
    memory when they are asked for, and the system takes their memory when it needs it.

    Parameters
    ----------
    columns : Columns
    n_cells : int
    """

    def __init__(self, columns, n_cells):
        self.columns, self.n_cells = columns, n_cells
        sizes = [columns.report(cell, "planes")["n_places"] for cell in range(n_cells)]
        self.starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._open = []

    def __len__(self):
        return int(self.starts[-1])

    def rows(self, cell):
        """Those of a cell, a slice."""
        return slice(int(self.starts[cell]), int(self.starts[cell + 1]))

    def join(self, *names):
        """Put columns of all cells into one file each; those of the cells are removed."""
        for name in names:
            if not self.columns.is_done(ALL, name):
                self._join(name)
                self.columns.finish(ALL, name)
            self.columns.remove(self.n_cells, name)

    def open(self, name, changing=False):
        """The array of a column, as a file that is mapped into memory.

        With `changing`, that of a copy, which may be written to. The column itself may not, but is
        opened as if: of an array that is read only Numba would compile everything anew.
        """
        path = self._path(name)
        if changing:
            path = shutil.copyfile(path, path.with_suffix(".changed"))
        stored = np.load(path, mmap_mode="r+")
        self._open.append(stored)
        return np.asarray(stored)

    def release(self):
        """Free the memory of what was read or written of open arrays; it is read again if need be.

        Without this the system does so when others need the memory.
        """
        for stored in self._open:
            if hasattr(mmap, "MADV_DONTNEED"):  # not on Windows; files keep what was written
                stored._mmap.madvise(mmap.MADV_DONTNEED)

    def close(self):
        """Forget open arrays, whose files may then be removed once nobody uses them."""
        self._open.clear()

    def rows_of(self, name, rows):
        """Some rows of a column, of which nothing else stays in memory."""
        return np.load(self._path(name), mmap_mode="r")[rows]

    def remove(self, *names):
        """Free the disk of what is no longer asked for."""
        for name in names:
            self._path(name).unlink(missing_ok=True)

    def has(self, name):
        """Whether all cells have a column."""
        return self.columns.is_done(ALL, name) or self.columns.has(0, name)

    def planes(self, changing=False):
        """The planes of all places, as `RegionGrowing` knows them; `changing` as of `open`."""
        nothing = np.empty(0)
        faces = [self.open(name, changing) for name in ("centroids", "normals", "scale")]
        radius = self.open("radius") if self.columns.is_done(ALL, "radius") else nothing
        return Planes(*faces[:2], np.empty((0, 3)), faces[2], nothing, radius, nothing, nothing)

    def _path(self, name):
        return self.columns.folder / f"{ALL}.{name}.npy"

    def _join(self, name):
        first = self.columns.read(0, name, mmap=True)
        header = {
            "descr": np.lib.format.dtype_to_descr(first.dtype),
            "fortran_order": False,
            "shape": (len(self), *first.shape[1:]),
        }
        path = self._path(name)
        temporary = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
        try:
            with open(temporary, "wb") as file:
                np.lib.format.write_array_header_1_0(file, header)
                for cell in range(self.n_cells):
                    file.write(np.ascontiguousarray(self.columns.read(cell, name)).data)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


class StoredIndex:
    """A `NeighborIndex` of all places, whose neighbors were searched for and stored.

    Parameters
    ----------
    whole : WholeColumns
        With the columns points and near.
    """

    chunk = CHUNK

    def __init__(self, whole):
        self._whole, self.points = whole, whole.open("points")
        self.n_neighbors = whole.open("near").shape[1]
        self._n_asked = 0

    def query_own(self, rows, k=None, keep=True):
        """As of `NeighborIndex`."""
        k = self.n_neighbors if k is None else k
        near = np.ascontiguousarray(self._near(rows, k))
        return Neighborhoods(near, np.full(len(near), k))

    def _near(self, rows, k):
        near = self._whole.rows_of("near", rows)[:, :k]
        self._n_asked += len(near)
        if self._n_asked > RELEASED:  # who asks for neighbors reads points and planes as well
            self._n_asked = 0
            self._whole.release()
        return near
