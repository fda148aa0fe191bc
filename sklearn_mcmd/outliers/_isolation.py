"""Isolation: how far a single point is from others, in spacings that are usual around it."""

import numpy as np

from sklearn_mcmd.planes._around import ratio

__all__ = [
    "chosen_rows",
    "isolation_of",
    "mean_distance",
    "mean_distance_to_rest",
    "steps_between",
    "usual_of",
]

AT_ONCE = 1_000_000  # rows that are copied


def usual_of(spacings, share):
    """The spacing (m,) that is usual among the nearest points on surfaces, (m, k)."""
    place = int(share * spacings.shape[1])
    return np.partition(spacings, place, axis=1)[:, place]


def mean_distance_to_rest(queries, distances, counts, box, n_near):
    """Mean distance to the nearest off-surface points. Those that are missing are as far away as
    the cloud, whose low and high corner are the `box`, is large with the query in it."""
    low, high = box
    extent = np.maximum(queries, high) - np.minimum(queries, low)
    extent = np.linalg.norm(extent, axis=1)
    distances = np.where(np.isinf(distances), extent[:, None], distances)
    return mean_distance(distances, counts, n_near)


def isolation_of(among_rest, among_all, usual, rest_weight):
    """Most weight is on off-surface points: what lies near surfaces may be alone off them."""
    return ratio(among_rest**rest_weight * among_all ** (1 - rest_weight), usual)


def steps_between(usual, usual_there, distances):
    """Distances (m, w) to neighbors in usual spacings, the smaller of both points'."""
    return ratio(distances, np.minimum(usual[:, None], usual_there))


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
