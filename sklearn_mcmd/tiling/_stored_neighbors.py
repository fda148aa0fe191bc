"""Neighbors of all places on disk: one file for each cell, packed as in memory."""

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.tiling._stored_columns import ALL, in_place_of

BITS = 4  # binary digits of a place in a group, and of a group in a list
BLOCK = 1 << BITS  # places of a block, and groups that it can name
BLOCKS_AT_ONCE = 4096  # that are packed at once
MOST_PACKED = 128  # neighbors of a place that are packed
PACKED_NEIGHBOR = 1.5  # bytes of each, with its part of lists, about


def bytes_of_neighbors(k):
    """Bytes on disk for the neighbors of a place, about."""
    return PACKED_NEIGHBOR * k if k <= MOST_PACKED else 4 * k


class StoredNeighbors:
    """The k nearest places of each place of a `StoredColumns`, the nearest first.

    Most neighbors of a block of 16 places in succession lie in 16 groups of 16 places each, since
    places near each other come one after another. Such a neighbor is one byte: 4 bits for its
    group, 4 for its place in it. All others of a block are listed with it, in 6 bytes. Of more than
    `MOST_PACKED` neighbors too few lie in 16 groups: each takes 4 bytes.
    """

    def __init__(self, whole):
        self._whole = whole

    @property
    def k(self):
        return self._whole.columns.report(ALL, "near")["k"]

    def begin(self, k):
        """Say how many neighbors are to be stored, unless an earlier run has."""
        if not self._whole.columns.is_done(ALL, "near"):
            self.finish(k)

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
        found = np.empty((len(rows), k), np.int32)
        of = np.searchsorted(self._whole.starts, rows, side="right") - 1
        for cell in np.unique(of):
            some = np.flatnonzero(of == cell)
            found[some] = self._take(cell, rows[some] - self._whole.starts[cell], k)
        return found

    def _take(self, cell, rows, k):
        own, path = self._whole.rows(cell), self._path(cell)
        with one_clear_line(path, "read"):
            m, words = own.stop - own.start, np.memmap(path, np.uint8, "c")
            words = np.asarray(words)  # what is read only would be compiled for anew
            width, n_far = words[:8].view(np.int32)
            if k > width:
                raise ValueError(f"{k} neighbors are wanted, and {width} are stored")
            parts, ends = [], 8
            for dtype, n in _parts(m, width, n_far):
                begin, ends = ends, ends + n * dtype.itemsize
                parts.append(words[begin:ends].view(dtype))
            if ends != len(words):
                raise PointFileError("is damaged; begin anew (restart)")
        if width > MOST_PACKED:
            return parts[0].reshape(m, width)[rows, :k]
        groups, starts, far, places, codes = parts
        groups, codes = groups.reshape(-1, BLOCK), codes.reshape(m, width)
        found = np.empty((len(rows), k), np.int32)
        _compiled("unpack")(codes, BITS, groups, starts, far, places, rows, found)
        return found

    def _write(self, cell, k, near_of):
        own, path, known, n_far = self._whole.rows(cell), self._path(cell), [], 0
        for rows in slices(own.stop - own.start, BLOCK * BLOCKS_AT_ONCE):
            near = np.ascontiguousarray(near_of(rows))
            part = (near,) if k > MOST_PACKED else _packed(near, n_far)
            n_far += 0 if k > MOST_PACKED else len(part[2])
            known.append(part)
        parts = list(zip(*known, strict=True))
        if k <= MOST_PACKED:
            parts[1] = *parts[1], np.array([n_far], np.int32)
        with one_clear_line(path, "written"), in_place_of(path) as new, open(new, "wb") as file:
            file.write(np.array([k, n_far], np.int32).data)
            for values in (part for column in parts for part in column):
                file.write(values.data)

    def _path(self, cell):
        return self._whole.columns.folder / f"{cell}.near"


def _parts(m, k, n_far):
    """Dtypes and lengths of the arrays of a file, one after the other."""
    number, n_blocks = np.dtype(np.int32), -(-m // BLOCK)
    if k > MOST_PACKED:
        return [(number, m * k)]
    lists = [(number, n_blocks * BLOCK), (number, n_blocks + 1), (number, n_far)]
    return [*lists, (np.dtype(np.uint16), n_far), (np.dtype(np.uint8), m * k)]


def _packed(near, n_far):
    """The arrays of successive places, as of `_parts`, before which so many neighbors are far."""
    (m, k), at_once = near.shape, BLOCK * near.shape[1]
    codes, groups = np.empty((m, k), np.uint8), np.empty((-(-m // BLOCK), BLOCK), np.int32)
    starts, far = np.empty(len(groups), np.int32), np.empty(m * k, np.int32)
    places, names = np.empty(m * k, np.uint16), np.empty((3, at_once), np.int64)
    slots = np.full(1 << (2 * at_once - 1).bit_length(), -1)
    n = _compiled("pack")(near, BITS, codes, groups, starts, far, places, slots, names)
    return groups, starts + np.int32(n_far), far[:n].copy(), places[:n].copy(), codes


def _compiled(name):
    return compiled_function("tiling._stored_neighbors_numba", name)
