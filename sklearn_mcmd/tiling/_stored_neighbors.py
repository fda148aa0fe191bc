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
FIRST, MORE = "near", "more"  # files of those that are asked for to the end, and of the others


def bytes_of_neighbors(k):
    """Bytes on disk for the neighbors of a place, about."""
    return (PACKED_NEIGHBOR + (bits_of(k) > 4)) * k


class StoredNeighbors:
    """The k nearest places of each place of a `StoredColumns`, the nearest first.

    A file has how many these are, how many are far, and the arrays of `Packed`, one after the
    other. Those that are freed before the others have files of their own.
    """

    def __init__(self, whole):
        self._whole, self._last = whole, {}  # the cell asked last of each file, and its neighbors

    def __reduce__(self):
        return StoredNeighbors, (self._whole,)  # processes find neighbors in the files

    @property
    def k(self):
        return self._whole.columns.report(ALL, "near")["k"]

    def begin(self, k, first=0):
        """Say how many neighbors are to be stored, and how many of these are asked for longer than
        the others if that is not the same of all, unless an earlier run has."""
        self._whole.columns.once("near", lambda: {"k": k, "first": first or k})

    def write(self, cell, near):
        """Store the neighbors of the places of a cell, int32 (m, k)."""
        first = self._whole.columns.report(ALL, "near")["first"]
        for name, some in zip((FIRST, MORE), np.split(near, [first], axis=1), strict=True):
            if some.shape[1]:
                self._write(self._path(cell, name), some)

    def free(self, cell, all_of_them):
        """Free the disk of neighbors of a cell's places: those beyond the first, or all."""
        for name in (MORE, FIRST) if all_of_them else (MORE,):
            self._path(cell, name).unlink(missing_ok=True)

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
        near = self._packed(cell, FIRST).take(rows, k)
        if near.shape[1] < k and self._path(cell, MORE).exists():
            near = np.hstack([near, self._packed(cell, MORE).take(rows, k - near.shape[1])])
        if k > (width := near.shape[1]):
            raise ValueError(f"{k} neighbors are wanted, and {width} are stored")
        return near

    def _packed(self, cell, name):
        last, packed = self._last.get(name, (-1, None))
        if last != cell:
            packed = self._open(self._whole.rows(cell), self._path(cell, name))
            self._last[name] = cell, packed
        return packed

    def _open(self, own, path):
        parts, end = [], 8
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

    def _write(self, path, near):
        k = near.shape[1]
        step = LARGEST_BLOCK * max(1, AT_ONCE // (LARGEST_BLOCK * k))
        parts = [Packed.of(np.ascontiguousarray(near[some])) for some in slices(len(near), step)]
        known = {name: [getattr(part, name) for part in parts] for name in Packed._fields}
        n_far = np.cumsum([0, *map(len, known["far"])], dtype=np.int32)
        known["starts"] = [s[:-1] + n for s, n in zip(known["starts"], n_far, strict=False)]
        known["starts"].append(n_far[-1:])
        with in_place_of(path) as new, open(new, "wb") as file:
            file.write(np.array([k, n_far[-1]], np.int32).data)
            for values in (part for name in Packed._fields for part in known[name]):
                file.write(values.data)
        self._last = {}

    def _path(self, cell, name):
        return self._whole.columns.folder / f"{cell}.{name}"


def _shapes(m, k, n_far):
    """Dtypes and shapes of the arrays of `Packed`, one after the other in a file."""
    bits, n = bits_of(k), n_blocks_of(m, k)
    lists = ("i4", (n, (1 << bits) - 1)), ("i4", (n + 1,)), ("i4", (n_far,))
    return *lists, (f"u{bits // 4}", (m, k))
