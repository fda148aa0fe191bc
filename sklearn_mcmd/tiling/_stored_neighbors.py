"""Neighbors of all places on disk: one file for each cell, packed as in memory."""

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.planes._neighbor_table import Packed, bits_of, n_blocks_of
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.tiling._stored_columns import ALL, in_place_of

AT_ONCE = 4_000_000  # neighbors that are packed at once, what bounds the memory
LARGEST_BLOCK = 256  # places of a block of `Packed`, at most
PACKED_NEIGHBOR = 1.5  # bytes of one, with its part of lists, about; 2.5 where codes are longer


def bytes_of_neighbors(k):
    """Bytes on disk for the neighbors of a place, about."""
    return (PACKED_NEIGHBOR + (bits_of(k) > 4)) * k


class StoredNeighbors:
    """The k nearest places of each place of a `StoredColumns`, the nearest first.

    A file has k, how many neighbors are far, and the arrays of `Packed`, one after the other.
    """

    def __init__(self, whole):
        self._whole, self._last = whole, (-1, None)  # the cell asked last, and its neighbors

    def __reduce__(self):
        return StoredNeighbors, (self._whole,)  # processes find neighbors in the files

    @property
    def k(self):
        return self._whole.columns.report(ALL, "near")["k"]

    def begin(self, k):
        """Say how many neighbors are to be stored, unless an earlier run has."""
        self._whole.columns.once("near", lambda: {"k": k})

    def finish(self, k):
        """Say how many neighbors are stored of all places."""
        self._whole.columns.finish(ALL, "near", k=k)

    def write(self, cell, near):
        """Store the neighbors of the places of a cell, int32 (m, k)."""
        self._write(cell, near.shape[1], near.__getitem__)

    def narrow(self, cell, k):
        """Keep the first k neighbors of a cell's places; with 0 nothing."""
        if not k:
            self._path(cell).unlink(missing_ok=True)
            return
        own = self._whole.rows(cell)

        def near(rows):
            return self.take(np.arange(own.start + rows.start, own.start + rows.stop), k)

        self._write(cell, k, near)

    def take(self, rows, k):
        """The first k neighbors of some places: int32 (m, k)."""
        if isinstance(rows, slice):
            rows = np.arange(*rows.indices(len(self._whole)))
        starts = self._whole.starts
        if len(rows):
            first, last = np.searchsorted(starts, [rows.min(), rows.max()], side="right") - 1
            if first == last:
                return self._take(first, rows - starts[first], k)
        found = np.empty((len(rows), k), np.int32)
        of = np.searchsorted(starts, rows, side="right") - 1
        for cell in np.unique(of):
            some = np.flatnonzero(of == cell)
            found[some] = self._take(cell, rows[some] - starts[cell], k)
        return found

    def __getitem__(self, rows):
        """All that are stored of some places."""
        return self.take(rows, self.k)

    def _take(self, cell, rows, k):
        last, packed = self._last
        if last != cell:
            packed = self._open(cell)
            self._last = cell, packed
        if k > (width := packed.codes.shape[1]):
            raise ValueError(f"{k} neighbors are wanted, and {width} are stored")
        return packed.take(rows, k)

    def _open(self, cell):
        own, path, parts, end = self._whole.rows(cell), self._path(cell), [], 8
        with one_clear_line(path, "read"):
            # An array that is read only would be compiled for anew.
            stored = np.asarray(np.memmap(path, np.uint8, "c"))
            width, n_far = stored[:8].view(np.int32)
            for dtype, shape in _shapes(own.stop - own.start, int(width), n_far):
                begin, end = end, end + np.dtype(dtype).itemsize * int(np.prod(shape))
                parts.append(stored[begin:end].view(dtype).reshape(shape))
            if end != len(stored):
                raise PointFileError("is damaged; begin anew (restart)")
        return Packed(*parts)

    def _write(self, cell, k, near_of):
        own, path = self._whole.rows(cell), self._path(cell)
        step = LARGEST_BLOCK * max(1, AT_ONCE // (LARGEST_BLOCK * k))
        rows = slices(own.stop - own.start, step)
        parts = [Packed.of(np.ascontiguousarray(near_of(some))) for some in rows]
        known = {name: [getattr(part, name) for part in parts] for name in Packed._fields}
        n_far = np.cumsum([0, *map(len, known["far"])], dtype=np.int32)
        known["starts"] = [s[:-1] + n for s, n in zip(known["starts"], n_far, strict=False)]
        known["starts"].append(n_far[-1:])
        with in_place_of(path) as new, open(new, "wb") as file:
            file.write(np.array([k, n_far[-1]], np.int32).data)
            for values in (part for name in Packed._fields for part in known[name]):
                file.write(values.data)
        self._last = -1, None

    def _path(self, cell):
        return self._whole.columns.folder / f"{cell}.near"


def _shapes(m, k, n_far):
    """Dtypes and shapes of the arrays of `Packed`, one after the other in a file."""
    bits, n = bits_of(k), n_blocks_of(m, k)
    lists = ("i4", (n, 1 << bits)), ("i4", (n + 1,)), ("i4", (n_far,)), ("i4", (n_far,))
    return *lists, (f"u{bits // 4}", (m, k))
