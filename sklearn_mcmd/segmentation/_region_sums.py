"""Counts, sums and medians of regions, which depend neither on the order of points nor on parts.

Sums are of numbers that are rounded to a grid first, so coarse that no sum is rounded again, and of
what is left, to a finer one (Demmel and Nguyen, "Parallel reproducible summation", IEEE
Transactions on Computers 64, 2015). So they are exact in any order, and nearly those of the numbers
themselves. Points are taken in parts, whose arrays may lie on disk.
"""

from functools import partial
from threading import Lock
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array

from sklearn_mcmd.runtime._chunks import run, slices

PART = 2**18  # points at once; it limits the memory
AT_ONCE = 2_000_000  # values whose medians are sought at once, or of one region with more,
PASSES = 4  # and in so many passes at least
BITS = 52  # of a number of double precision


class Moments(NamedTuple):
    """What is known of regions."""

    sizes: np.ndarray  # points, or the sum of their weights
    centroids: np.ndarray  # (n_regions, d), as low and high
    covariances: np.ndarray  # (n_regions, d, d)
    low: np.ndarray  # corners of their boxes
    high: np.ndarray


def region_sizes(labels, n_regions, weights=None):
    """Points of each region from 0 on, or the sum of their whole weights: float64."""
    sizes = np.zeros(n_regions + 1)
    for rows in slices(len(labels), PART):
        some = None if weights is None else weights[rows]
        sizes += np.bincount(labels[rows] + 1, some, n_regions + 1)  # those of -1 come first
    return sizes[1:]


def relabeled(labels, number):
    """Labels, changed: the new number of each point's region. The last of `number` is for -1."""
    for rows in slices(len(labels), PART):
        labels[rows] = number[labels[rows]]
    return labels


def rows_of(labels, wanted):
    """Rows whose region is wanted; the last of `wanted` tells of -1."""
    rows = [np.empty(0, np.intp)]
    for part in slices(len(labels), PART):
        rows.append(part.start + np.flatnonzero(wanted[labels[part]]))
    return np.concatenate(rows)


def region_moments(points, labels, n_regions, weights=None, n_jobs=None):
    """The `Moments` of regions; points of label -1 belong to none.

    Weights (n,) of int are copies.
    """
    d, visit = points.shape[1], partial(_visit, labels, n_jobs)
    sizes, low, high = _boxes(points, visit, n_regions, weights)
    inside = np.isfinite(low[0])
    low[:, ~inside] = high[:, ~inside] = 0.0
    # A power of two is the unit, so that squares are near 1.
    unit = int(np.clip(np.frexp((high - low).max(initial=0.0))[1], -1000, 1000))
    factor, extent = 2.0**-unit, np.frexp(np.ldexp(high - low, -unit))[1]
    divisor = np.maximum(sizes, 1.0)
    bits = np.frexp(divisor)[1] + (weights is not None)

    def local(groups, i):
        gaps = groups.take(points[:, i]) - np.repeat(low[i, groups.regions], groups.counts)
        gaps *= factor
        return gaps

    def weighted(groups, values):
        return values if weights is None else values * groups.take(weights)

    def columns(groups):
        return (weighted(groups, local(groups, i)) for i in range(d))

    means = _sums(visit, n_regions, columns, extent, bits) / divisor
    pairs = [(i, j) for i in range(d) for j in range(i + 1)]

    def products(groups):
        of_mean = [np.repeat(means[i, groups.regions], groups.counts) for i in range(d)]
        gaps = [local(groups, i) - of_mean[i] for i in range(d)]
        return (weighted(groups, gaps[i] * gaps[j]) for i, j in pairs)

    # Rounding may make a deviation longer than the extent.
    extents = [extent[i] + extent[j] + 2 for i, j in pairs]
    moments = _sums(visit, n_regions, products, extents, bits) / divisor
    covariances = np.empty((n_regions, d, d))
    with np.errstate(over="ignore"):
        for (i, j), moment in zip(pairs, moments, strict=True):
            covariances[:, i, j] = covariances[:, j, i] = np.ldexp(moment, 2 * unit)
    centroids = np.where(inside, low + np.ldexp(means, unit), 0.0)
    return Moments(
        sizes=sizes,
        centroids=centroids.T.copy(),
        covariances=covariances,
        low=low.T.copy(),
        high=high.T.copy(),
    )


def _boxes(points, visit, n_regions, weights):
    """Sizes of regions, and the low and high corners (d, n_regions) of their boxes."""
    d, sizes = points.shape[1], np.zeros(n_regions)
    low, high = np.full((d, n_regions), np.inf), np.full((d, n_regions), -np.inf)

    def measure(groups, lock):
        weight = groups.counts
        if weights is not None:
            weight = np.add.reduceat(groups.take(weights) * 1.0, groups.starts)
        own, there = [groups.take(points[:, i]) for i in range(d)], groups.regions
        least = [np.minimum.reduceat(column, groups.starts) for column in own]
        most = [np.maximum.reduceat(column, groups.starts) for column in own]
        with lock:
            sizes[there] += weight
            low[:, there] = np.minimum(low[:, there], least)
            high[:, there] = np.maximum(high[:, there], most)

    visit(measure)
    return sizes, low, high


def sums_by_region(values, labels, n_regions, n_jobs=None):
    """Sums (n_regions,) of values that are not negative."""
    most = max((float(values[rows].max()) for rows in slices(len(labels), PART)), default=0.0)
    extent = np.full(n_regions, np.frexp(most)[1])
    bits = np.full(n_regions, np.frexp(float(max(len(labels), 1)))[1])
    visit = partial(_visit, labels, n_jobs)
    return _sums(visit, n_regions, lambda groups: [groups.take(values)], [extent], bits)[0]


def _sums(visit, n_regions, columns, extents, bits):
    """Sums by region of the values that ``columns(groups)`` gives; for the rest see `_two_sums`."""
    sums = np.zeros((len(extents), 2, n_regions))

    def add(groups, lock):
        pairs = zip(columns(groups), extents, strict=True)
        found = [_two_sums(groups, values, extent, bits) for values, extent in pairs]
        with lock:
            for total, pair in zip(sums, found, strict=True):
                total[:, groups.regions] += pair

    visit(add)
    return sums.sum(axis=1)


def median_by_region(values, labels, n_regions):
    """Median of the values of each region, for an even number the upper one."""
    sizes = region_sizes(labels, n_regions).astype(np.int64)
    medians, first, most = np.empty(n_regions), 0, min(AT_ONCE, len(labels) // PASSES)
    before = np.concatenate([[0], np.cumsum(sizes)])
    while first < n_regions:  # as many regions as have few enough points, or one with more
        last = int(np.searchsorted(before, before[first] + most, side="right")) - 1
        last = max(last, first + 1)
        number = np.full(n_regions + 1, -1, np.int64)
        number[first:last] = np.arange(last - first)
        medians[first:last] = _medians(values, labels, number, last - first)
        first = last
    return medians


def _medians(values, labels, number, n_regions):
    """Medians of some regions, which `number` numbers anew."""
    own, numbers = [], []
    for rows in slices(len(labels), PART):
        some = number[labels[rows]]
        inside = np.flatnonzero(some >= 0)
        own.append(values[rows][inside])
        if n_regions > 1:
            numbers.append(some[inside].astype(np.int32))
    own, regions, medians = np.concatenate(own), [0], np.full(n_regions, np.nan)
    if n_regions > 1:
        groups = _grouped(np.concatenate(numbers))
        regions, own = groups.regions, np.split(own[groups.rows], groups.starts[1:])
    else:
        own = [own]
    for region, some in zip(regions, own, strict=True):
        some.partition(len(some) // 2)
        medians[region] = some[len(some) // 2]
    return medians


class _Groups(NamedTuple):
    """Rows of a part by their regions."""

    rows: np.ndarray  # region after region
    regions: np.ndarray  # (m,), ascending
    starts: np.ndarray  # where the rows of each region start,
    counts: np.ndarray  # and how many they are
    part: slice

    def take(self, values):
        return values[self.part][self.rows]


def _grouped(labels, part=slice(None)):
    """The `_Groups` of labels, sorted by counting; None if there are none."""
    inside = np.flatnonzero(labels >= 0)
    if not len(inside):
        return None
    own = labels[inside]
    least = own.min()
    shape = int(own.max() - least) + 1, len(labels)
    groups = coo_array((np.ones(len(own), np.int8), (own - least, inside)), shape=shape).tocsr()
    counts = np.diff(groups.indptr)
    some = np.flatnonzero(counts)
    return _Groups(groups.indices, some + least, groups.indptr[some], counts[some], part)


def _visit(labels, n_jobs, work):
    """Call ``work(groups, lock)`` for the groups of each part of labels."""
    lock = Lock()

    def task(part):
        groups = _grouped(labels[part], part)
        if groups is not None:
            work(groups, lock)

    run([(part,) for part in slices(len(labels), PART)], task, n_jobs)


def _two_sums(groups, values, extent, bits):
    """Sums (2, m) of values rounded to a coarse grid, and of what is left, to a fine one: less than
    2 ** bits values below 2 ** extent, both by region."""
    extent, bits = extent[groups.regions], bits[groups.regions]
    sums = np.empty((2, len(groups.regions)))
    for level in range(2):
        # Beside this number, doubles have the step of the grid.
        large = np.repeat(np.ldexp(1.5, extent + bits + level * (bits - BITS)), groups.counts)
        rounded = (values + large) - large
        sums[level] = np.add.reduceat(rounded, groups.starts)
        values = values - rounded
    return sums
