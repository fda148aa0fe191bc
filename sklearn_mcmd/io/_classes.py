"""Classes of LAS: which points of a cloud are used, and which noise is low."""

from operator import index
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.io._point_cloud import PointFileError

__all__ = [
    "GROUND",
    "HIGH_NOISE",
    "LOW_NOISE",
    "Choice",
    "LowestPoints",
    "class_numbers",
    "classes_of",
    "classes_of_noise",
    "ground_in",
    "noise_classes",
]

# ASPRS LAS 1.4. Point formats 0 to 5 define no high noise: they have 18 reserved.
GROUND, LOW_NOISE, HIGH_NOISE = 2, 7, 18
LARGEST = 255  # class of LAS 1.4
LEVELS = 31  # bits of a place along an axis


class Choice(NamedTuple):
    """Which points of a file are used, by what the file says of each.

    Points that are marked withheld are never used, nor those of `ignored` classes. If there are any
    `only`, all other classes are left out.
    """

    ignored: tuple[int, ...] = ()
    only: tuple[int, ...] = ()

    def of(self, cloud):
        """A mask of the points that are used; None if all are.

        Raise if classes are asked for, and the cloud has none.
        """
        used = np.ones(len(cloud), bool)
        if "withheld" in cloud.attributes:
            used &= np.asarray(cloud.attributes["withheld"]) == 0
        if self.ignored or self.only:
            classes = classes_of(cloud)
            used &= ~np.isin(classes, self.ignored)
            if self.only:
                used &= np.isin(classes, self.only)
        return None if used.all() else used


def class_numbers(classes):
    """Classes in order, each once; raise a ValueError if they are no list of classes."""
    try:
        numbers = {-1 if isinstance(number, bool) else index(number) for number in classes}
    except TypeError:
        numbers = {-1}
    if not all(0 <= number <= LARGEST for number in numbers):
        raise ValueError(f"is no list of classes, whole numbers from 0 to {LARGEST}")
    return tuple(sorted(numbers))


def classes_of(cloud):
    """The class of each point."""
    if "classification" not in cloud.attributes:
        raise PointFileError(
            "has no classes, which are asked for: points need an attribute 'classification'"
        )
    return np.asarray(cloud.attributes["classification"])


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
        """Which points (n, 3) lie lower than all around them.

        Around a point is the smallest square of twofold sides that has `n_usual` of the points,
        or all of them.
        """
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


def noise_classes(cloud, marked, flagged, used, n_usual):
    """The class of each outlier: low or high noise; 0 for all other points.

    Of three masks (n,) of points, `marked` get a class, no other is compared with `flagged`, and
    the verdict is based on `used`. Low is what lies lower than all ground around it, if there is
    ground, else than all that was used; `n_usual` is of `LowestPoints`.
    """
    compared = ground_in(cloud)
    if compared is None or np.count_nonzero(compared & ~flagged) < n_usual:
        compared = used
    lowest = LowestPoints(len(cloud), n_usual)
    lowest.add(cloud.xyz[compared & ~flagged])
    classes = np.zeros(len(cloud), np.uint8)
    classes[marked] = classes_of_noise(lowest, cloud.xyz[marked])
    return classes


def ground_in(cloud):
    """A mask of the points of the ground, without those that are withheld; None without classes."""
    if "classification" not in cloud.attributes:
        return None
    ground = np.asarray(cloud.attributes["classification"]) == GROUND
    if "withheld" in cloud.attributes:
        ground &= np.asarray(cloud.attributes["withheld"]) == 0
    return ground


def classes_of_noise(lowest, xyz):
    """Low or high noise, for outliers (n, 3)."""
    return np.where(lowest.are_above(xyz), LOW_NOISE, HIGH_NOISE).astype(np.uint8)


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
    """Codes of the squares of twofold sides that hold those of some codes; they keep their order.

    The first bit of each axis is its sign. Halving repeats it, as a shift of negative numbers does.
    """
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
