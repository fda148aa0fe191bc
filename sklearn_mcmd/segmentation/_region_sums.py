"""Sizes, moments, sums and medians of regions, which depend on no order of points.

Sums are of numbers that are rounded to a grid first, so coarse that no sum is rounded again, and of
what is left, to a finer one (Demmel and Nguyen, "Parallel reproducible summation", IEEE
Transactions on Computers 64, 2015). So they are exact in any order, and nearly those of the numbers
themselves.
"""

from typing import NamedTuple

import numpy as np

BITS = 52  # of a number of double precision


class Moments(NamedTuple):
    """What is known of regions."""

    sizes: np.ndarray  # points, or the sum of their weights
    centroids: np.ndarray  # (n_regions, d)
    covariances: np.ndarray  # (n_regions, d, d)


class Groups(NamedTuple):
    """Rows by their regions; points of label -1 belong to none."""

    rows: np.ndarray  # region after region
    regions: np.ndarray  # (m,), ascending, those that have points
    starts: np.ndarray  # where the rows of each region start,
    counts: np.ndarray  # and how many they are

    @classmethod
    def of(cls, labels):
        """The groups of labels (n,)."""
        sizes = np.bincount(labels + 1, minlength=1)  # the first of those in no region
        regions = np.flatnonzero(sizes[1:])
        counts = sizes[1:][regions]
        rows = np.argsort(labels, kind="stable")[sizes[0] :]
        return cls(rows, regions, np.cumsum(counts) - counts, counts)

    def split(self):
        """The rows of each region."""
        return np.split(self.rows, self.starts[1:]) if len(self.regions) else []

    def spread(self, values):
        """The value of its region, for each row."""
        return np.repeat(values[self.regions], self.counts)

    def sums(self, values, n_regions, extent, bits):
        """Sums (n_regions,) of the rows' values: less than 2 ** bits of each region, and all of
        them below 2 ** extent, both (n_regions,)."""
        sums = np.zeros(n_regions)
        for level in range(2 if len(self.rows) else 0):
            # Beside this number, doubles have the step of the grid.
            large = self.spread(np.ldexp(1.5, extent + bits + level * (bits - BITS)))
            rounded = (values + large) - large
            sums[self.regions] += np.add.reduceat(rounded, self.starts)
            values = values - rounded
        return sums


def n_regions_of(labels):
    """How many regions there are, if these are numbered without gaps."""
    return int(labels.max(initial=-1)) + 1


def region_sizes(labels, n_regions, weights=None):
    """Points of each region from 0 on, or the sum of their whole weights: float64."""
    return np.bincount(labels + 1, weights, n_regions + 1)[1:].astype(np.float64)


def region_moments(points, labels, n_regions, weights=None):
    """The `Moments` of regions; weights (n,) of int are copies."""
    d, groups = points.shape[1], Groups.of(labels)
    low, high = np.zeros((2, d, n_regions))
    sizes = region_sizes(labels, n_regions, weights)
    local = points[groups.rows].T.copy()
    if len(groups.rows):
        low[:, groups.regions] = np.minimum.reduceat(local, groups.starts, axis=1)
        high[:, groups.regions] = np.maximum.reduceat(local, groups.starts, axis=1)
    # A power of two is the unit, so that squares are near 1.
    unit = int(np.clip(np.frexp((high - low).max(initial=0.0))[1], -1000, 1000))
    extent = np.frexp(np.ldexp(high - low, -unit))[1]
    divisor = np.maximum(sizes, 1.0)
    # A sum of so many numbers has so many bits more, and one more where weights are not equal.
    bits = np.frexp(divisor)[1] + (weights is not None)
    weights = 1 if weights is None else weights[groups.rows]

    def mean(values, extent):
        return groups.sums(values * weights, n_regions, extent, bits) / divisor

    means, covariances = np.empty((d, n_regions)), np.empty((n_regions, d, d))
    for i in range(d):
        local[i] = (local[i] - groups.spread(low[i])) * 2.0**-unit
        means[i] = mean(local[i], extent[i])
        local[i] -= groups.spread(means[i])
    with np.errstate(over="ignore"):
        for a, b in zip(*np.tril_indices(d), strict=True):
            # Rounding may make a deviation longer than the extent.
            moment = mean(local[a] * local[b], extent[a] + extent[b] + 2)
            covariances[:, a, b] = covariances[:, b, a] = np.ldexp(moment, 2 * unit)
    return Moments(sizes, (low + np.ldexp(means, unit)).T.copy(), covariances)


def sums_by_region(values, labels, n_regions):
    """Sums (n_regions,) of values that are not negative."""
    groups, extent = Groups.of(labels), np.frexp(values.max(initial=0.0))[1]
    bits = np.frexp(float(max(len(labels), 1)))[1]
    extents, all_bits = np.full(n_regions, extent), np.full(n_regions, bits)
    return groups.sums(values[groups.rows], n_regions, extents, all_bits)


def median_by_region(values, labels, n_regions):
    """Median of the values of each region, for an even number the upper one."""
    order, sizes = np.lexsort((values, labels)), np.bincount(labels + 1, minlength=n_regions + 1)
    medians, (n_free, *_), sizes = np.full(n_regions, np.nan), sizes, sizes[1:]
    middle = n_free + np.cumsum(sizes) - sizes + sizes // 2
    medians[sizes > 0] = values[order[middle[sizes > 0]]]
    return medians
