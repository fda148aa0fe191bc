"""From points with normals to a graph: which neighbors a region may grow to."""

from dataclasses import dataclass

import numpy as np

from sklearn_mcmd._chunks import each_slice
from sklearn_mcmd._rules import MAD_TO_SD

__all__ = ["NeighborLinks", "grow_regions", "link_neighbors", "majority_of", "n_within_median"]

# Smaller clouds take NumPy: loading compiled code would take longer than the work.
COMPILE_FROM = 2_000
# Neighbors a task: what bounds the memory.
CHUNK = 200_000
# A point's nearest neighbors that decide whether growth may pass through it.
NEAREST = 12
# Rule A: neighbors within the median and so many standard deviations of the distances.
N_DEVIATIONS = 2.0


@dataclass
class NeighborLinks:
    """The graph that regions grow on; arrays of the length of the points.

    links : ndarray of int32 of shape (n, width)
        Neighbors that may be added from each point, then -1.
    offset : the plane's signed distance from its point, along the point's normal
    radius : distance to the farthest neighbor looked at
    """

    links: np.ndarray
    offset: np.ndarray
    radius: np.ndarray


def link_neighbors(
    index,
    normals,
    floor,
    *,
    min_cosine,
    max_distance=None,
    max_gap=None,
    core_fraction=0.5,
    n_jobs=None,
):
    """Link each point to the neighbors that may join its region (section 5.2.3).

    The plane of a point has the point's normal and lies at the median height of its
    neighbors, so that the noise of the point itself doesn't matter. A neighbor is linked if

    1. its distance to that plane is at most `max_distance`; by default the median of the
       neighbors' distances and two robust standard deviations,
    2. it is not farther than `max_gap`; by default the median of the neighbors' distances,
       which leaves the nearer half, and 1. is then of these alone,
    3. its normal is within the angle,

    and if 1. and 3. hold for `core_fraction` of the nearest neighbors.

    Parameters
    ----------
    index : NeighborIndex
    normals : ndarray of shape (n, d)
        Unit normals of ``index.points``.
    floor : ndarray of shape (n,)
        Least `max_distance`: what rounding amounts to.
    min_cosine : float
    max_distance, max_gap : float, default=None
    core_fraction : float, default=0.5
    n_jobs : int, default=None

    Returns
    -------
    links : NeighborLinks
    """
    points = index.points
    n, d = points.shape
    # Neighbors beyond the median distance are never linked, and need not be found.
    k = index.n_neighbors if max_gap is not None else n_within_median(index.n_neighbors) + 1
    width = k - 1
    result = NeighborLinks(np.empty((n, width), np.int32), np.empty(n), np.empty(n))
    link = _link_numpy
    if d == 3 and n >= COMPILE_FROM:
        link = _compiled("link_neighbors_3d") or _link_numpy
    threshold = -1.0 if max_distance is None else float(max_distance)
    longest = np.inf if max_gap is None else float(max_gap)

    def task(rows):
        distances, indices = index.tree.query(points[rows], k=k)
        distances, indices = distances.reshape(-1, k), indices.reshape(-1, k)
        arguments = (points, normals, indices, distances, rows.start, floor[rows])
        limits = (min_cosine, threshold, longest, majority_of(core_fraction, k))
        link(*arguments, *limits, result.links[rows], result.offset[rows])
        result.radius[rows] = distances[:, -1]

    each_slice(n, max(1, CHUNK // k), task, n_jobs)
    return result


def grow_regions(links, seeds):
    """Regions of points that can be reached from a seed along links (section 5.2.3).

    Which points these are does not depend on the order in which links are followed.

    Parameters
    ----------
    links : ndarray of int32 of shape (n, width)
        Rows that may be added from each row, then -1.
    seeds : ndarray of int of shape (n,)
        All rows, that of least curvature first.

    Returns
    -------
    labels : ndarray of int32 of shape (n,)
        From 0, in the order of the seeds.
    """
    grow = _grow
    if len(links) >= COMPILE_FROM:
        grow = _compiled("grow") or _grow
    return grow(links, seeds)


def n_within_median(k):
    """Neighbors not farther than their median distance, of k with the point itself."""
    return k // 2


def majority_of(core_fraction, k):
    """How many of the nearest neighbors must fit, and of how many."""
    nearest = min(NEAREST, k - 1)
    return int(np.ceil(core_fraction * nearest)), nearest


def _link_numpy(
    points, normals, indices, distances, start, floor,
    min_cosine, max_distance, max_gap, majority, links, offset,
):  # fmt: skip
    """Any dimension, one chunk; fills `links` and `offset`."""
    rows = np.arange(start, start + len(indices))
    own = normals[rows][:, None]
    heights = ((points[indices] - points[rows][:, None]) * own).sum(axis=-1)
    offset[:] = np.median(heights, axis=1)
    away = np.abs(heights - offset[:, None])
    if max_distance < 0:
        middle = np.median(away, axis=1)
        spread = MAD_TO_SD * np.median(np.abs(away - middle[:, None]), axis=1)
        limit = np.maximum(middle + N_DEVIATIONS * spread, floor)
    else:
        limit = np.full(len(rows), max_distance)
    fits = away <= limit[:, None]
    fits &= np.abs((normals[indices] * own).sum(axis=-1)) >= min_cosine
    n_fitting, nearest = majority
    core = np.count_nonzero(fits[:, 1 : nearest + 1], axis=1) >= n_fitting
    width = links.shape[1]
    linked = fits[:, 1 : width + 1] & (distances[:, 1 : width + 1] <= max_gap) & core[:, None]
    links[:] = np.where(linked, indices[:, 1 : width + 1], -1)
    links[:] = np.take_along_axis(links, np.argsort(~linked, axis=1, kind="stable"), axis=1)


def _grow(links, seeds):
    """The loop of `grow_regions`, which compiles as it is."""
    n, width = links.shape
    labels = np.full(n, -1, np.int32)
    waiting = np.empty(n, np.int32)  # the current seed list, S_c
    region = 0
    for seed in seeds:
        if labels[seed] >= 0:
            continue
        labels[seed] = region
        waiting[0] = seed
        n_waiting = 1
        while n_waiting > 0:
            n_waiting -= 1
            i = waiting[n_waiting]
            for a in range(width):
                j = links[i, a]
                if j < 0:
                    break
                if labels[j] < 0:
                    labels[j] = region
                    waiting[n_waiting] = j
                    n_waiting += 1
        region += 1
    return labels


def _compiled(name):
    """The compiled form of a function, imported on first use; None where Numba cannot be."""
    try:
        from sklearn_mcmd import _region_growing_numba
    except ImportError:
        return None
    return getattr(_region_growing_numba, name)
