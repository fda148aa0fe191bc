"""Columns of all places of a cloud, cell after cell in one file each, and an index over them."""

import os
import secrets

import numpy as np

from sklearn_mcmd.planes._record import Neighborhoods, Planes

__all__ = ["StoredIndex", "WholeColumns"]

CHUNK = 4096  # rows that are asked for at once
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

    def open(self, name):
        """The array of a column. What is written to it stays in memory, and is not kept."""
        # Of a mapped file that is read only, Numba would compile everything anew.
        return np.asarray(np.load(self._path(name), mmap_mode="c"))

    def has(self, name):
        """Whether all cells have a column."""
        return self.columns.is_done(ALL, name) or self.columns.has(0, name)

    def planes(self):
        """The planes of all places, as `RegionGrowing` knows them."""
        nothing = np.empty(0)
        vectors = (self.open(name) for name in ("centroids", "normals"))
        radius = self.open("radius") if self.columns.is_done(ALL, "radius") else nothing
        return Planes(
            *vectors, np.empty((0, 3)), self.open("scale"), nothing, radius, nothing, nothing
        )

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
        self.points, self.near = whole.open("points"), whole.open("near")
        self.n_neighbors = self.near.shape[1]

    def query_own(self, rows, k=None, keep=True):
        """As of `NeighborIndex`."""
        k = self.n_neighbors if k is None else k
        near = np.ascontiguousarray(self.near[rows, :k])
        return Neighborhoods(near, np.full(len(near), k))
