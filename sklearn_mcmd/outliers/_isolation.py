"""Isolation: how far a single point is from others, in spacings that are usual around it."""

import numpy as np

__all__ = ["chosen_rows", "mean_distance", "mean_distance_to_rest"]

AT_ONCE = 1_000_000  # rows that are copied at once; it limits the memory


def mean_distance_to_rest(queries, distances, counts, box, n_near):
    """Mean distance to the nearest off-surface points. Those that are missing are as far away as
    the cloud, whose low and high corner are the `box`, is large with the query in it."""
    low, high = box
    extent = np.maximum(queries, high) - np.minimum(queries, low)
    extent = np.linalg.norm(extent, axis=1)
    distances = np.where(np.isinf(distances), extent[:, None], distances)
    return mean_distance(distances, counts, n_near)


def mean_distance(distances, counts, n_near):
    """Mean distance to the `n_near` nearest measurements, or to all that there are.

    Distances (m, w) to neighbors are ascending; `counts` are the measurements at each of these.
    """
    reached = np.minimum(np.cumsum(counts, axis=1), n_near)
    taken = np.diff(reached, axis=1, prepend=0)
    return (taken * distances).sum(axis=1) / np.maximum(reached[:, -1], 1)


def chosen_rows(index, values, chosen):
    """Those of the values (n, ...) that are chosen, bool (n,), as an array of the index."""
    rows = index.empty((np.count_nonzero(chosen), *values.shape[1:]), values.dtype)
    end = 0
    for first in range(0, len(values), AT_ONCE):  # so that no more is in memory
        part = values[first : first + AT_ONCE][chosen[first : first + AT_ONCE]]
        rows[end : end + len(part)], end = part, end + len(part)
    return rows
