"""The nearest neighbors of all points of a cloud, found once and kept in a third of their size."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._compiling import compiled_function

AT_ONCE = 400_000  # neighbors that are found at once, what bounds the memory of a search
LONGEST_PART = 4096  # rows of a part, at most
MOST_SHORT = 128  # neighbors of a point at most whose codes have one byte


class NeighborTable:
    """The k nearest of n fixed points to each of them, searched when they are first asked for.

    The points are in spatial order, so most neighbors of 16 rows in succession lie in 15 groups of
    16 rows. Such a neighbor is one byte: 4 bits for the group, 4 for the place in it. A 16th group
    stands for the others, which are listed. Of more than `MOST_SHORT` neighbors it is 256 instead
    of 16, and two bytes.

    ``search(rows, k)`` returns the neighbors, int32 (m, k), of a slice of rows. If `sizes` (n,)
    says how many each needs, parts hold as many as any of their rows does.
    """

    def __init__(self, search, n, k, sizes=None):
        self.search, self.n, self.k, self.sizes = search, n, k, sizes
        self.part_size = part_size(k)
        self.parts = [None] * -(-n // self.part_size)

    def query(self, rows, k, keep=True):
        """Neighbors of some rows, the nearest first: int32 (m, k), where k is at most the table's.

        What must be searched is kept for the next time with `keep`, or if rows are no slice.
        """
        searched = isinstance(rows, slice) and not keep
        if isinstance(rows, slice):
            rows = np.arange(*rows.indices(self.n))
        neighbors = np.empty((len(rows), k), np.int32)
        part_of = rows // self.part_size
        order = np.argsort(part_of, kind="stable")
        ends = np.cumsum(np.bincount(part_of))
        for i in np.unique(part_of):
            places = order[ends[i - 1] if i else 0 : ends[i]]
            part = rows[places]
            if searched and self.parts[i] is None:
                neighbors[places] = self.search(slice(part[0], part[-1] + 1), k)
            else:
                neighbors[places] = self._take(i, part - i * self.part_size, k)
        return neighbors

    def asking(self, marked):
        """Which rows have a neighbor, or themselves, among those that are `marked`, bool (n,); of
        rows that were not searched it is not known."""
        asking, block = np.zeros(self.n, bool), 1 << bits_of(self.k)
        groups = np.logical_or.reduceat(marked, np.arange(0, self.n, block))
        for i, part in enumerate(self.parts):
            if part is not None:
                rows = part.near_groups(groups, marked)
                asking[i * self.part_size + rows] = marked[part.take(rows, self.k)].any(axis=1)
        return asking

    def _part(self, i):
        """A part, which is searched if this was not done before."""
        part = self.parts[i]
        if part is None:
            rows = slice(i * self.part_size, min((i + 1) * self.part_size, self.n))
            k = self.k if self.sizes is None else int(self.sizes[rows].max())
            self.parts[i] = part = Packed.of(self.search(rows, k))
        return part

    def _take(self, i, rows, k):
        """The first k neighbors of some rows of a part; those it does not hold repeat the first."""
        near = self._part(i).take(rows, k)
        missing = k - near.shape[1]
        return np.hstack([near, np.repeat(near[:, :1], missing, axis=1)]) if missing else near


class Packed(NamedTuple):
    """Neighbors of successive rows, in blocks of 16 or 256."""

    groups: np.ndarray  # int32 (n_blocks, size of a block - 1), those that codes name
    starts: np.ndarray  # int32 (n_blocks + 1,), where the far ones of each block start
    far: np.ndarray  # int32, neighbors in other groups, in the order of the codes
    codes: np.ndarray  # uint8 or uint16 (m, k)

    @classmethod
    def of(cls, near):
        """Pack neighbors, int32 (m, k)."""
        (m, k), bits = near.shape, bits_of(near.shape[1])
        block, n_blocks = 1 << bits, -(-m // (1 << bits))
        groups, starts = np.zeros((n_blocks, block - 1), np.int32), np.empty(n_blocks + 1, np.int32)
        codes, far = np.empty((m, k), f"u{bits // 4}"), np.empty(m * k, np.int32)
        slots = np.full(1 << (2 * block * k - 1).bit_length(), -1)
        names = np.empty((3, block * k), np.int64)
        starts[-1] = n = _compiled("pack")(near, bits, codes, groups, starts, far, slots, names)
        return cls(groups, starts, far[:n].copy(), codes)

    def near_groups(self, groups, marked):
        """The rows of blocks with neighbors in some of all `groups`, or far ones that are `marked`,
        both bool."""
        n_far = np.append(0, np.cumsum(marked[self.far]))[self.starts]
        asking = groups[self.groups].any(axis=1) | (n_far[1:] > n_far[:-1])
        return np.flatnonzero(np.repeat(asking, self.groups.shape[1] + 1)[: len(self.codes)])

    def take(self, rows, k):
        """The first k neighbors of some of the rows; those that they have, if these are fewer."""
        neighbors = np.empty((len(rows), min(k, self.codes.shape[1])), np.int32)
        rows = np.array(rows, np.int64)  # of one kind, for which alone `unpack` is compiled
        _compiled("unpack")(
            codes=self.codes,
            bits=bits_of(self.codes.shape[1]),
            groups=self.groups,
            starts=self.starts,
            far=self.far,
            rows=rows,
            neighbors=neighbors,
        )
        return neighbors


def bits_of(k):
    """Binary digits of a place in a group, and of a group in its list, for k neighbors."""
    return 4 if k <= MOST_SHORT else 8


def part_size(k):
    """Rows of a part: a power of two."""
    return min(LONGEST_PART, 1 << (max(AT_ONCE // k, 1).bit_length() - 1))


def _compiled(name):
    return compiled_function("planes._neighbor_table_numba", name)
