"""Counts, sums and medians of regions, which depend neither on the order of points nor on parts.

Sums are of numbers that are rounded to a grid first, so coarse that no sum is rounded again, and of
what is left, to a finer one (Demmel and Nguyen, "Parallel reproducible summation", IEEE
Transactions on Computers 64, 2015). So they are exact in any order, and nearly those of the numbers
themselves. Points are taken in parts, whose arrays may lie on disk.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array

from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.segmentation._parts import PART, Parts

SAMPLES = 64  # values that a part shows of a region of which others have points, too
BITS = 52  # of a number of double precision


class Moments(NamedTuple):
    """What is known of regions."""

    sizes: np.ndarray  # points, or the sum of their weights
    centroids: np.ndarray  # (n_regions, d), as low and high
    covariances: np.ndarray  # (n_regions, d, d)
    low: np.ndarray  # corners of their boxes
    high: np.ndarray


def n_regions_of(labels):
    """How many regions there are, if these are numbered without gaps."""
    return max((int(labels[rows].max()) + 1 for rows in slices(len(labels), PART)), default=0)


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


def region_moments(points, labels, n_regions, weights=None, n_jobs=None, parts=None):
    """The `Moments` of regions; points of label -1 belong to none.

    Weights (n,) of int are copies.
    """
    d, parts = points.shape[1], parts or Parts(len(labels), n_jobs)
    sizes, low, high = _boxes(parts, points, labels, n_regions, weights)
    inside = np.isfinite(low[0])
    low[:, ~inside] = high[:, ~inside] = 0.0
    # A power of two is the unit, so that squares are near 1.
    unit = int(np.clip(np.frexp((high - low).max(initial=0.0))[1], -1000, 1000))
    factor, extent = 2.0**-unit, np.frexp(np.ldexp(high - low, -unit))[1]
    divisor = np.maximum(sizes, 1.0)
    bits = np.frexp(divisor)[1] + (weights is not None)
    known = points, weights, low, factor
    means = _sums(parts, labels, n_regions, _coordinates, known, extent, bits) / divisor
    pairs = [(i, j) for i in range(d) for j in range(i + 1)]
    # Rounding may make a deviation longer than the extent.
    extents = [extent[i] + extent[j] + 2 for i, j in pairs]
    known = *known, means, pairs
    moments = _sums(parts, labels, n_regions, _products, known, extents, bits) / divisor
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


def _boxes(parts, points, labels, n_regions, weights):
    """Sizes of regions, and the low and high corners (d, n_regions) of their boxes."""
    d, sizes = points.shape[1], np.zeros(n_regions)
    low, high = np.full((d, n_regions), np.inf), np.full((d, n_regions), -np.inf)
    for there, weight, least, most in filter(None, parts.each(_box, points, labels, weights)):
        sizes[there] += weight
        low[:, there] = np.minimum(low[:, there], least)
        high[:, there] = np.maximum(high[:, there], most)
    return sizes, low, high


def _box(part, points, labels, weights):
    """Regions, and of each its size and corners; None if there are none."""
    if (groups := _grouped(labels[part], part)) is None:
        return None
    weight, own = groups.counts, list(groups.columns_of(points))
    if weights is not None:
        weight = np.add.reduceat(groups.take(weights) * 1.0, groups.starts)
    least, most = ([f.reduceat(x, groups.starts) for x in own] for f in (np.minimum, np.maximum))
    return groups.regions, weight, least, most


def _coordinates(groups, points, weights, low, factor):
    """Each coordinate from the corner of its region, times a factor, and times the weight."""
    return _weighted(groups, weights, _local(groups, points, low, factor))


def _products(groups, points, weights, low, factor, means, pairs):
    """Products of such coordinates, less their means, times the weight."""
    gaps = _local(groups, points, low, factor)
    gaps = [x - groups.spread(mean) for x, mean in zip(gaps, means, strict=True)]
    return _weighted(groups, weights, (gaps[i] * gaps[j] for i, j in pairs))


def _local(groups, points, low, factor):
    own = groups.columns_of(points)
    return ((x - groups.spread(a)) * factor for x, a in zip(own, low, strict=True))


def _weighted(groups, weights, values):
    if weights is None:
        return values
    own = groups.take(weights)
    return (some * own for some in values)


def sums_by_region(values, labels, n_regions, parts=None):
    """Sums (n_regions,) of values that are not negative."""
    parts = parts or Parts(len(labels))
    extent = np.full(n_regions, np.frexp(max(parts.each(_largest, values), default=0.0))[1])
    bits = np.full(n_regions, np.frexp(float(max(len(labels), 1)))[1])
    return _sums(parts, labels, n_regions, _themselves, (values,), [extent], bits)[0]


def _largest(part, values):
    return float(values[part].max())


def _themselves(groups, values):
    return [groups.take(values)]


def _sums(parts, labels, n_regions, values_of, known, extents, bits):
    """Sums by region of the values that ``values_of(groups, *known)`` gives, one after the other;
    for the rest see `_two_sums`."""
    sums = np.zeros((len(extents), 2, n_regions))
    for regions, found in filter(None, parts.each(_sum, labels, values_of, known, extents, bits)):
        sums[..., regions] += found
    return sums.sum(axis=1)


def _sum(part, labels, values_of, known, extents, bits):
    """Regions, and two sums of each kind of their values; None if there are none."""
    if (groups := _grouped(labels[part], part)) is None:
        return None
    pairs = zip(values_of(groups, *known), extents, strict=True)
    return groups.regions, np.stack([_two_sums(groups, *pair, bits) for pair in pairs])


def median_by_region(values, labels, n_regions, parts=None):
    """Median of the values of each region, for an even number the upper one."""
    return medians_by_region([values], labels, n_regions, parts)[0]


def medians_by_region(columns, labels, n_regions, parts=None):
    """Medians (m, n_regions) of m columns of values.

    Of a region in several parts each shows some of its sorted values, which bound the median; what
    lies between the bounds is then sorted.
    """
    parts, sizes = parts or Parts(len(labels)), region_sizes(labels, n_regions).astype(np.int64)
    medians, shown = np.full((len(columns), n_regions), np.nan), {}
    for regions, found, samples in filter(None, parts.each(_show, columns, labels, sizes)):
        medians[:, regions] = found
        for key, sample in samples.items():
            shown.setdefault(key, []).append(sample)
    if not shown:
        return medians
    bounds, between = np.full((2, *medians.shape), np.nan), {key: [] for key in shown}
    for (column, region), samples in shown.items():
        bounds[:, column, region] = _bounds(samples, sizes[region] // 2)
    for found in parts.each(_between, columns, labels, bounds):
        for key, counts_and_values in found.items():
            between[key].append(counts_and_values)
    for (column, region), found in between.items():
        below, equal, some = zip(*found, strict=True)
        place, some = sizes[region] // 2 - sum(below), np.concatenate(some)
        low, high = bounds[:, column, region]
        if place < sum(equal):
            medians[column, region] = low
        elif (place := place - sum(equal)) < len(some):
            medians[column, region] = np.partition(some, place)[place]
        else:
            medians[column, region] = high
    return medians


def _show(part, columns, labels, sizes):
    """Regions of which the part has all points, their medians, and samples of all others: places
    and values, by column and region; None if there are none."""
    if (groups := _grouped(labels[part], part)) is None:
        return None
    complete, samples = groups.counts == sizes[groups.regions], {}
    medians = np.empty((len(columns), len(complete)))
    for column, values in enumerate(columns):
        own = np.split(groups.take(values), groups.starts[1:])
        for i, some in enumerate(own):
            if complete[i]:
                some.partition(len(some) // 2)
                medians[column, i] = some[len(some) // 2]
                continue
            some.sort()
            places = np.append(np.arange(0, len(some), -(-len(some) // SAMPLES)), len(some) - 1)
            samples[column, int(groups.regions[i])] = places, some[places]
    return groups.regions[complete], medians[:, complete], samples


def _bounds(samples, middle):
    """Two of the values between which that of a place is, if samples show some of each part."""
    values = np.unique(np.concatenate([some for _, some in samples]))
    least, most = np.zeros(len(values), np.int64), np.zeros(len(values), np.int64)
    for places, some in samples:
        ends = np.append(places, places[-1] + 1)  # at most so many are less than a value,
        most += ends[np.searchsorted(some, values)]
        least += np.append(0, places + 1)[np.searchsorted(some, values, side="right")]
    return values[np.flatnonzero(most <= middle)[-1]], values[np.argmax(least > middle)]


def _between(part, columns, labels, bounds):
    """Of each column and region with bounds: how many values are less, or equal to the lower one,
    and those between both."""
    found = {}
    if (groups := _grouped(labels[part], part)) is None:
        return found
    for column, values in enumerate(columns):
        own = groups.take(values)
        for i in np.flatnonzero(~np.isnan(bounds[0, column, groups.regions])):
            region, some = int(groups.regions[i]), own[groups.starts[i] :][: groups.counts[i]]
            low, high = bounds[:, column, region]
            less, equal = np.count_nonzero(some < low), np.count_nonzero(some == low)
            found[column, region] = less, equal, some[(some > low) & (some < high)]
    return found


class _Groups(NamedTuple):
    """Rows of a part by their regions."""

    rows: np.ndarray  # region after region
    regions: np.ndarray  # (m,), ascending
    starts: np.ndarray  # where the rows of each region start,
    counts: np.ndarray  # and how many they are
    part: slice

    def take(self, values):
        return values[self.part][self.rows]

    def columns_of(self, values):
        """Each column of values (n, d), one after the other."""
        return (column[self.rows] for column in values[self.part].T)

    def spread(self, values):
        """The value of its region, for each row."""
        return np.repeat(values[self.regions], self.counts)


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
