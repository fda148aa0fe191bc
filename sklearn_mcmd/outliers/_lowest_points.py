"""The lowest of some points in squares in plan: what lies lower than all around it."""

import numpy as np

N_BITS = 31  # bits of a place along an axis
HALF = 2 ** (N_BITS - 1)  # places are from -HALF to HALF - 1
SIDE = 2 ** (N_BITS + 1)  # the factor of a place along x in the number of a square


class LowestPoints:
    """The lowest of some points in squares in plan, collected from their parts.

    The sides of the squares are a power of two, such that a square that has any of the points has
    at least `n_usual` on average. They depend on the points alone, not on parts or their order. No
    more than `most_points` will be added; `n_points` were.
    """

    def __init__(self, most_points, n_usual):
        self.most_points, self.n_usual, self.n_points = most_points, n_usual, 0
        self.exponent = -1074
        self.codes = np.empty(0, np.int64)
        self.counts, self.lowest = np.empty(0, np.int64), np.empty(0)

    def add(self, xyz):
        """Take some of the points, (n, 3)."""
        if not len(xyz):
            return
        # Places along an axis are integers of 31 bits, about 0.
        largest = max(np.abs(xyz[:, :2]).max(), np.finfo(float).tiny)
        self._coarsen(max(self.exponent, int(np.frexp(largest)[1]) - (N_BITS - 1)))
        codes = _codes(xyz, self.exponent)
        self.codes, self.counts, self.lowest = _joined(
            codes=np.concatenate([self.codes, codes]),
            counts=np.concatenate([self.counts, np.ones(len(xyz), np.int64)]),
            lowest=np.concatenate([self.lowest, xyz[:, 2]]),
        )
        self.n_points += len(xyz)
        self._limit(self.most_points)

    def are_above(self, xyz):
        """Which points (n, 3) lie lower than all in the smallest square of twofold sides around
        them that has `n_usual` of the points, or than all."""
        low = np.zeros(len(xyz), bool)
        if not len(self.codes) or not len(xyz):
            return low
        self._limit(self.n_points)
        codes, counts, lowest = self.codes, self.counts, self.lowest
        asked, rows = _codes(xyz, self.exponent), np.arange(len(xyz))
        for _ in range(N_BITS):
            places = np.minimum(np.searchsorted(codes, asked), len(codes) - 1)
            enough = (codes[places] == asked) & (counts[places] >= self.n_usual)
            low[rows[enough]] = xyz[rows[enough], 2] < lowest[places[enough]]
            asked, rows = _twofold(asked[~enough]), rows[~enough]
            if not len(rows):
                return low
            codes, counts, lowest = _joined(_twofold(codes), counts, lowest)
        low[rows] = xyz[rows, 2] < lowest.min()
        return low

    def _limit(self, n_points):
        """Let squares have enough of so many points on average; four at 0 are the largest."""
        most = max(1, n_points // self.n_usual)
        while len(self.codes) > most and (_twofold(self.codes) != self.codes).any():
            self._coarsen(self.exponent + 1)

    def _coarsen(self, exponent):
        """Make the squares as large as this power of two."""
        if len(self.codes) and exponent > self.exponent:
            codes = self.codes
            for _ in range(exponent - self.exponent):
                codes = _twofold(codes)
            self.codes, self.counts, self.lowest = _joined(codes, self.counts, self.lowest)
        self.exponent = exponent


def _codes(xyz, exponent):
    """A number for the square of each point, of its places along x and y."""
    with np.errstate(over="ignore"):
        places = np.floor(np.ldexp(xyz[:, :2], -exponent))
    x, y = np.clip(places, -HALF, HALF - 1).astype(np.int64).T
    return x * SIDE + y


def _twofold(codes):
    """Codes of the squares of twofold sides that hold those of some codes."""
    x = (codes + HALF) // SIDE
    return (x >> 1) * SIDE + ((codes - x * SIDE) >> 1)


def _joined(codes, counts, lowest):
    """One entry for each code, in their order."""
    if (codes[1:] < codes[:-1]).any():
        order = np.argsort(codes, kind="stable")
        codes, counts, lowest = codes[order], counts[order], lowest[order]
    starts = np.flatnonzero(np.append(True, codes[1:] != codes[:-1]))
    return codes[starts], np.add.reduceat(counts, starts), np.minimum.reduceat(lowest, starts)
