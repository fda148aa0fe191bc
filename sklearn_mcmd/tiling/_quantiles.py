"""Ranks among the numbers and points of all cells."""

import numpy as np

__all__ = ["evenly_along_x", "exceeded_by"]

N_BINS = 2**20  # along the first axis


def exceeded_by(parts, share):
    """The number that a share of numbers exceeds, of which all are in memory: 16 bytes for each.

    Parameters
    ----------
    parts : callable
        Returns an iterable of arrays of float64.
    share : float in [0, 1]
    """
    numbers = np.concatenate(list(parts()))
    np.negative(numbers, out=numbers)
    return -np.percentile(numbers, 100 * share, overwrite_input=True)


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
