"""Values of given ranks among more than memory holds, exact."""

import numpy as np

__all__ = ["evenly_along_x", "exceeded_by", "median_of"]

DIGIT = 16  # bits of a number that are counted at once
N_BINS = 2**20  # along the first axis


def exceeded_by(parts, share):
    """The number that a share of numbers exceeds: ``-numpy.percentile(-numbers, 100 * share)``.

    Parameters
    ----------
    parts : callable
        Returns an iterable of arrays of float64.
    share : float in [0, 1]
    """
    n = sum(len(values) for values in parts())
    place = (n - 1) * (100 * share / 100)
    low = int(np.floor(place))
    a, b = (-_of_rank(parts, max(n - 1 - rank, 0)) for rank in (low, low + 1))
    step, rise = place - low, b - a
    return -(b - rise * (1 - step) if step >= 0.5 else a + rise * step)


def median_of(parts):
    """The median of numbers, ``numpy.median``.

    Parameters
    ----------
    parts : callable
        As of `exceeded_by`.
    """
    n = sum(len(values) for values in parts())
    low, high = (_of_rank(parts, rank) for rank in ((n - 1) // 2, n // 2))
    return (low + high) / 2


def evenly_along_x(load, n_cells, n, step):
    """Every step-th of n points in the order of their coordinates.

    Parameters
    ----------
    load : callable
        Returns the points of a cell.
    n_cells, n, step : int

    Yields
    ------
    cell : int
    rows : ndarray of int
    """
    low = min(load(cell)[:, 0].min() for cell in range(n_cells))
    high = max(load(cell)[:, 0].max() for cell in range(n_cells))
    width = (high - low) / N_BINS or 1.0

    def bins_of(points):
        return np.minimum((points[:, 0] - low) / width, N_BINS).astype(np.int64)

    counts = sum(np.bincount(bins_of(load(cell)), minlength=N_BINS + 1) for cell in range(n_cells))
    ends = np.cumsum(counts)
    ranks = np.arange(0, n, step)
    wanted = np.zeros(N_BINS + 1, bool)
    wanted[np.searchsorted(ends, ranks, side="right")] = True
    found = [np.empty((0, 3))]
    places = [np.empty((0, 2), np.int64)]
    for cell in range(n_cells):
        points = load(cell)
        rows = np.flatnonzero(wanted[bins_of(points)])
        found.append(points[rows])
        places.append(np.stack([np.full(len(rows), cell), rows], axis=1))
    order = np.lexsort(np.vstack(found).T[::-1])
    # Of points in bins that are not wanted, as many come before.
    before = np.cumsum(np.where(wanted, 0, counts))
    bins = np.searchsorted(ends, ranks, side="right")
    places = np.vstack(places)[order[ranks - before[bins]]]
    for cell in np.unique(places[:, 0]):
        yield int(cell), places[places[:, 0] == cell, 1]


def _of_rank(parts, rank):
    """The number of a rank, from 0: bits of numbers sort as they do, but for those of the sign."""
    prefix, n_before = 0, 0
    for shift in range(64 - DIGIT, -1, -DIGIT):
        counts = np.zeros(2**DIGIT, np.int64)
        for values in parts():
            bits = _sorting(values + 0.0)
            if shift + DIGIT < 64:
                bits = bits[bits >> np.uint64(shift + DIGIT) == np.uint64(prefix)]
            digits = (bits >> np.uint64(shift)) & np.uint64(2**DIGIT - 1)
            counts += np.bincount(digits.astype(np.intp), minlength=2**DIGIT)
        ends = np.cumsum(counts)
        digit = int(np.searchsorted(ends, rank - n_before, side="right"))
        n_before += int(ends[digit - 1]) if digit else 0
        prefix = (prefix << DIGIT) | digit
    sign = prefix >> 63
    bits = prefix ^ (2**63 if sign else 2**64 - 1)
    return float(np.array(bits, np.uint64).view(np.float64))


def _sorting(values):
    """Bits of numbers that sort as the numbers do."""
    bits = values.view(np.int64)
    bits = bits ^ ((bits >> 63) & np.int64(2**63 - 1))
    return bits.view(np.uint64) ^ np.uint64(2**63)
