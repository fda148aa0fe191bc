"""From points with normals to a graph: which neighbors a region may grow to."""

from dataclasses import dataclass

import numpy as np

from sklearn_mcmd.planes._chunks import each_slice
from sklearn_mcmd.planes._rules import MAD_TO_SD

__all__ = ["NeighborLinks", "grow_regions", "link_neighbors", "majority_of", "n_within_median"]

# Smaller clouds take NumPy: loading compiled code would take longer than the work.
COMPILE_FROM = 2_000
# Neighbors a task: what bounds the memory.
CHUNK = 200_000
# A point's nearest neighbors that decide whether growth may pass through it.
NEAREST = 12
# A plane that is so many times farther from its neighbors than is usual runs across an edge.
MOST_UNUSUAL = 2.0
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

    and if 1. and 3. hold for `core_fraction` of the nearest neighbors, and the point itself is
    within that distance of its plane. Automatic distances are limited then to twice the
    lower quartile of the neighbors': next to a kerb the plane of the road has the footpath's
    points among its neighbors, but must not lead to them.

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
    graph = NeighborLinks(np.empty((n, k - 1), np.int32), np.empty(n), np.empty(n))
    limit = np.empty(n)
    measure, link = _measure_numpy, _link_numpy
    if d == 3 and n >= COMPILE_FROM:
        measure = _compiled("measure_neighbors_3d") or measure
        link = _compiled("link_neighbors_3d") or link
    # The paper, without core points, takes its thresholds as they are.
    most = MOST_UNUSUAL if core_fraction > 0 and max_distance is None else np.inf
    longest = np.inf if max_gap is None else float(max_gap)

    def measured(rows):
        distances, indices = index.tree.query(points[rows], k=k)
        indices = indices.reshape(-1, k)
        measure(points, normals, indices, rows.start, graph.offset[rows], limit[rows])
        limit[rows] = np.maximum(limit[rows], floor[rows])
        if max_distance is not None:
            limit[rows] = max_distance
        graph.links[rows] = indices[:, 1:]
        graph.radius[rows] = distances.reshape(-1, k)[:, -1]

    def linked(rows):
        thresholds = min_cosine, longest, most, majority_of(core_fraction, k)
        link(points, normals, rows.start, graph.offset, limit, *thresholds, graph.links[rows])

    chunk = max(1, CHUNK // k)
    each_slice(n, chunk, measured, n_jobs)
    each_slice(n, chunk, linked, n_jobs)
    return graph


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


def _measure_numpy(points, normals, indices, start, offset, limit):
    """Any dimension, one chunk; fills `offset` and the largest distance to the plane."""
    rows = np.arange(start, start + len(indices))
    gaps = points[indices] - points[rows][:, None]
    heights = (gaps * normals[rows][:, None]).sum(axis=-1)
    offset[:] = np.median(heights, axis=1)
    away = np.abs(heights - offset[:, None])
    middle = np.median(away, axis=1)
    spread = MAD_TO_SD * np.median(np.abs(away - middle[:, None]), axis=1)
    limit[:] = middle + N_DEVIATIONS * spread


def _link_numpy(
    points, normals, start, offset, limit, min_cosine, max_gap, most, majority, links
):  # fmt: skip
    """Any dimension, one chunk; leaves in `links` the neighbors that may be added."""
    rows = np.arange(start, start + len(links))
    own = normals[rows][:, None]
    gaps = points[links] - points[rows][:, None]
    away = np.abs((gaps * own).sum(axis=-1) - offset[rows, None])
    largest = limit[rows]
    if most < np.inf:
        around = np.sort(np.column_stack([largest, limit[links]]), axis=1)
        largest = np.minimum(largest, most * around[:, around.shape[1] // 4])
    fits = away <= largest[:, None]
    fits &= np.abs((normals[links] * own).sum(axis=-1)) >= min_cosine
    n_fitting, nearest = majority
    core = np.count_nonzero(fits[:, :nearest], axis=1) >= n_fitting
    if n_fitting > 0:
        core &= np.abs(offset[rows]) <= largest
    fits &= core[:, None] & (np.sqrt(np.square(gaps).sum(axis=-1)) <= max_gap)
    found = np.where(fits, links, -1)
    links[:] = np.take_along_axis(found, np.argsort(~fits, axis=1, kind="stable"), axis=1)


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
        from sklearn_mcmd.segmentation import _graph_numba
    except ImportError:
        return None
    return getattr(_graph_numba, name)
