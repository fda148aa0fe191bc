"""The lowest of some points in squares in plan: what lies lower than all around it."""

import numpy as np

LEVELS = 31  # bits of a place along an axis


class LowestPoints:
    """The lowest of some points in squares in plan, collected from their parts.

    The sides of the squares are a power of two, such that a square that has any of the points has
    at least `n_usual` on average. They depend on the points alone, not on parts or their order. No
    more than `most_points` will be added; `n_points` were.
    """

    def __init__(self, most_points, n_usual):
        self.most_points, self.n_usual, self.n_points = most_points, n_usual, 0
        self.exponent = -1074
        self.codes = np.empty(0, np.uint64)
        self.counts, self.lowest = np.empty(0, np.int64), np.empty(0)

    def add(self, xyz):
        """Take some of the points, (n, 3)."""
        if not len(xyz):
            return
        # Places along an axis are integers of 31 bits, about 0.
        largest = max(np.abs(xyz[:, :2]).max(), np.finfo(float).tiny)
        self._coarsen(max(self.exponent, int(np.frexp(largest)[1]) - (LEVELS - 1)))
        codes = _codes(xyz, self.exponent)
        parts = (codes, np.ones(len(xyz), np.int64), xyz[:, 2])
        both = zip((self.codes, self.counts, self.lowest), parts, strict=True)
        self.codes, self.counts, self.lowest = _joined(*map(np.concatenate, both))
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
        for _ in range(LEVELS):
            places = np.minimum(np.searchsorted(codes, asked), len(codes) - 1)
            known = (codes[places] == asked) & (counts[places] >= self.n_usual)
            low[rows[known]] = xyz[rows[known], 2] < lowest[places[known]]
            asked, rows = _twofold(asked[~known]), rows[~known]
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
    """A number for the square of each point, with the bits of x and y in turn."""
    half = 2 ** (LEVELS - 1)
    with np.errstate(over="ignore"):
        places = np.floor(np.ldexp(xyz[:, :2], -exponent))
    places = np.clip(places, -half, half - 1).astype(np.int64) + half
    x, y = (_spread(axis.astype(np.uint64)) for axis in places.T)
    return x << np.uint64(1) | y


def _spread(bits):
    """Bits with a zero between each two."""
    for shift, mask in (
        (16, 0x0000FFFF0000FFFF),
        (8, 0x00FF00FF00FF00FF),
        (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333),
        (1, 0x5555555555555555),
    ):
        bits = (bits | bits << np.uint64(shift)) & np.uint64(mask)
    return bits


def _twofold(codes):
    """Codes of the squares of twofold sides that hold those of some codes, in their order. The
    first bit of each axis is its sign, which halving repeats, as a shift of negatives does."""
    top = np.uint64(2 * LEVELS - 2)
    signs = codes >> top
    rest = (codes & np.uint64((1 << 2 * LEVELS - 2) - 1)) >> np.uint64(2)
    return signs << top | (signs ^ np.uint64(3)) << (top - np.uint64(2)) | rest


def _joined(codes, counts, lowest):
    """One entry for each code, in their order."""
    if (codes[1:] < codes[:-1]).any():
        order = np.argsort(codes, kind="stable")
        codes, counts, lowest = codes[order], counts[order], lowest[order]
    starts = np.flatnonzero(np.append(True, codes[1:] != codes[:-1]))
    return codes[starts], np.add.reduceat(counts, starts), np.minimum.reduceat(lowest, starts)
