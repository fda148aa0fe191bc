"""The nearest neighbors of all points of a cloud, found once and kept in half of their size."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._compiling import compiled_function

AT_ONCE = 200_000  # neighbors that are found at once, what bounds the memory of a search
LONGEST_PART = 4096  # rows of a part, at most
BITS = 4  # binary digits of the place in a group of 16 points
MOST_GROUPS = 2 ** (16 - BITS)  # that one code of two bytes can number


class NeighborTable:
    """The k nearest of n fixed points to each of them, searched when they are first asked for.

    The points are in spatial order, so the neighbors of near points lie in few groups of 16 rows
    in succession. Rows near each other share a list of these groups. A neighbor is then two
    bytes: the place of its group in the list, and its own place in the group.

    ``search(rows, k)`` returns the neighbors, int32 (m, k), of a slice of rows. If `sizes` (n,)
    says how many each needs, parts hold as many as any of their rows does.
    """

    def __init__(self, search, n, k, sizes=None):
        self.search, self.n, self.k, self.sizes = search, n, k, sizes
        self.part_size = part_size(k)
        self.parts = [None] * -(-n // self.part_size)
        # A block has no more groups than neighbors.
        self.block = min(64, MOST_GROUPS // k)
        self.packs = bool(self.block) and n >= self.block

    def query(self, rows, k, keep=True):
        """Neighbors of some rows, the nearest first: int32 (m, k), where k is at most the table's.

        What must be searched is kept for the next time with `keep`, or if rows are no slice.
        """
        if isinstance(rows, slice):
            first, last, _ = rows.indices(self.n)
            found = np.empty((max(last - first, 0), k), np.int32)
            end = -(-last // self.part_size) if len(found) else 0
            for i in range(first // self.part_size, end):
                begin = i * self.part_size
                some = slice(max(first, begin), min(last, begin + self.part_size))
                if keep or self.parts[i] is not None:
                    near = self._take(i, np.arange(some.start, some.stop) - begin, k)
                else:
                    near = self.search(some, k)
                found[some.start - first : some.stop - first] = near
            return found
        found = np.empty((len(rows), k), np.int32)
        part_of = rows // self.part_size
        order = np.argsort(part_of, kind="stable")
        ends = np.cumsum(np.bincount(part_of))
        for i in np.unique(part_of):
            places = order[ends[i - 1] if i else 0 : ends[i]]
            found[places] = self._take(i, rows[places] - i * self.part_size, k)
        return found

    def _part(self, i):
        """A part, which is searched if this was not done before."""
        part = self.parts[i]
        if part is None:
            rows = slice(i * self.part_size, min((i + 1) * self.part_size, self.n))
            k = self.k if self.sizes is None else int(self.sizes[rows].max())
            part = self.search(rows, k)
            self.parts[i] = part = _packed(part, self.block) if self.packs else part
        return part

    def _take(self, i, rows, k):
        """The first k neighbors of some rows of a part; those it does not hold repeat the first."""
        part = self._part(i)
        near = part.take(rows, k) if self.packs else part[rows, :k]
        missing = k - near.shape[1]
        return np.hstack([near, np.repeat(near[:, :1], missing, axis=1)]) if missing else near


class Packed(NamedTuple):
    """Neighbors of successive rows, two bytes each."""

    # uint16 (m, k): place of a neighbor's group in its block's list, times 16, and in the group.
    codes: np.ndarray
    groups: np.ndarray  # int32, the lists of all blocks
    starts: np.ndarray  # int64 (n_blocks + 1,), where the list of each block starts
    block: int  # rows of a block

    def take(self, rows, k):
        found = np.empty((len(rows), min(k, self.codes.shape[1])), np.int32)
        rows = np.array(rows, np.int64)  # of one kind, for which alone `unpack` is compiled
        _compiled("unpack")(self.codes, self.groups, self.starts, self.block, BITS, rows, found)
        return found


def part_size(k):
    """Rows of a part: a power of two."""
    return min(LONGEST_PART, 1 << (max(AT_ONCE // k, 1).bit_length() - 1))


def _packed(indices, block):
    """A part of a table in half of its size."""
    m, k = indices.shape
    codes = np.empty((m, k), np.uint16)
    groups, starts = np.empty(m * k, np.int32), np.empty(-(-m // block) + 1, np.int64)
    size, slots = 1 << (2 * block * k - 1).bit_length(), np.empty(block * k, np.int64)
    names, places = np.full(size, -1, np.int32), np.empty(size, np.int32)
    _compiled("pack")(indices, block, BITS, codes, groups, starts, names, places, slots)
    return Packed(codes, groups[: starts[-1]].copy(), starts, block)


def _compiled(name):
    return compiled_function("planes._neighbor_table_numba", name)
