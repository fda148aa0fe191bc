"""From points with normals to a graph: which neighbors a region may grow to."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import quantile_around
from sklearn_mcmd.planes._chunks import each_slice
from sklearn_mcmd.planes._compiling import compiled_function
from sklearn_mcmd.planes._linking import LinkLimits, link_planes
from sklearn_mcmd.planes._record import Neighborhoods, Planes
from sklearn_mcmd.planes._rules import MAD_TO_SD

__all__ = ["GrowthRules", "grow_regions", "link_neighbors", "n_within_median"]

# Smaller clouds take NumPy: loading compiled code would take longer than the work.
COMPILE_FROM = 2_000
# Neighbors a task: what bounds the memory.
CHUNK = 200_000
# A plane explains a point that is within so many of its standard deviations.
CUTOFF = 3.0
# What is usual around is this quantile of the neighbors' noise: next to an edge less than half
# of them have planes of their own face. A plane may be noisier by so many standard errors ...
USUAL = 0.25
N_ERRORS = 3.0
# ... and by what curvature explains. Points of a disk of radius r on a cylinder whose normals
# turn by an angle over r deviate from their plane by this share of angle * r (root mean square).
BENT = 1 / 8
# The paper's rule A: neighbors within the median and so many standard deviations.
N_DEVIATIONS = 2.0


class GrowthRules(NamedTuple):
    """What makes neighbors parts of one surface; the parameters of `RegionGrowing`.

    min_cosine : least cosine of the angle between their normals
    max_distance, max_gap : lengths in units of the points, or None
    mutual : whether planes must explain each other
    """

    min_cosine: float
    max_distance: float | None = None
    max_gap: float | None = None
    mutual: bool = True


class RuleA(NamedTuple):
    """The paper's automatic distance: the median and `n_deviations` of `mad_to_sd` each."""

    n_deviations: float
    mad_to_sd: float


def link_neighbors(index, normals, noise, floor, rules, n_jobs=None):
    """Link each point to the neighbors that may join its region (section 5.2.3).

    The plane of a point has the point's normal and lies at the median height of its
    neighbors, so that the noise of the point itself doesn't matter. A neighbor is linked if

    1. its distance to that plane is at most `max_distance`; by default three standard deviations
       of the plane,
    2. it is not farther than `max_gap`; by default the median of the neighbors' distances,
       which leaves the nearer half,
    3. its normal is within the angle,

    and, if `mutual`, also the point is within such a distance of the neighbor's plane, and both
    planes are quiet: no noisier than is usual around and than surfaces are whose normals
    turn by the angle over a neighborhood. A plane that runs across an edge is noisier. Without
    `mutual` the distance is by default the paper's: the median of the neighbors' distances and
    two robust standard deviations.

    Parameters
    ----------
    index : NeighborIndex
    normals : ndarray of shape (n, d)
        Unit normals of ``index.points``.
    noise : ndarray of shape (n,)
        Standard deviations along them.
    floor : ndarray of shape (n,)
        What rounding amounts to.
    rules : GrowthRules
    n_jobs : int, default=None

    Returns
    -------
    links : ndarray of int32 of shape (n, width)
        Neighbors that may be added from each point, nearest first, then -1.
    planes : Planes
        The centroid is the point's projection on its plane, the scale is at least `floor`, and the
        radius is the distance to the farthest neighbor looked at. What growth does not ask for is
        not a number.
    """
    n, d = index.points.shape
    max_gap = rules.max_gap
    # Neighbors beyond the median distance are never linked, and need not be found.
    k = index.n_neighbors if max_gap is not None else n_within_median(index.n_neighbors) + 1
    unknown = np.full(n, np.nan)
    planes = Planes(
        np.empty((n, d)), normals, np.full((n, d), np.nan), np.maximum(noise, floor), unknown,
        np.empty(n), unknown, unknown,
    )  # fmt: skip
    others, limit, usable = np.empty((n, k - 1), np.int32), np.empty(n), np.ones(n, dtype=bool)
    measure = _measure_numpy
    compiled = n >= COMPILE_FROM
    if compiled and d == 3:
        measure = _compiled("measure_neighbors_3d") or measure
    rule_a = RuleA(N_DEVIATIONS, MAD_TO_SD)

    def measured(rows):
        distances, near = index.tree.query(index.points[rows], k=k)
        distances, near = distances.reshape(-1, k), near.reshape(-1, k)
        others[rows], planes.radius[rows] = near[:, 1:], distances[:, -1]
        offset = np.empty(len(near))
        measure(index.points, normals, near, rows.start, rule_a, offset, limit[rows])
        planes.centroids[rows] = index.points[rows] + offset[:, None] * normals[rows]
        if rules.mutual:
            around = Neighborhoods(near.astype(np.int32), np.full(len(near), k))
            quick = measure is not _measure_numpy
            usable[rows] = _is_quiet(planes, rows, around, index.n_neighbors, rules, quick)

    each_slice(n, max(1, CHUNK // k), measured, n_jobs)
    explained, scale = CUTOFF, planes.scale
    if rules.max_distance is not None:
        explained, scale = 1.0, np.full(n, float(rules.max_distance))
    elif not rules.mutual:
        explained, scale = 1.0, np.maximum(limit, floor)
    limits = LinkLimits(
        rules.min_cosine, explained, np.inf if max_gap is None else max_gap, rules.mutual
    )
    neighbors = Neighborhoods(others, np.full(n, k - 1))
    links = link_planes(
        index.points, neighbors, planes._replace(scale=scale), limits, usable, compiled, n_jobs
    )
    return links, planes


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


def _is_quiet(planes, rows, around, n_neighbors, rules, compiled):
    """Whether planes are no noisier than is usual around, and than curvature makes them."""
    usual = quantile_around(planes.scale, around, USUAL, compiled)
    bent = BENT * np.arccos(min(rules.min_cosine, 1.0)) * planes.radius[rows]
    # The standard error of a standard deviation that so many neighbors tell.
    most = 1 + N_ERRORS / np.sqrt(2 * n_neighbors)
    return planes.scale[rows] <= most * np.hypot(usual, bent)


def _measure_numpy(points, normals, indices, start, rule, offset, limit):
    """Any dimension, one chunk; fills `offset` and the paper's distance to the plane."""
    rows = np.arange(start, start + len(indices))
    gaps = points[indices] - points[rows][:, None]
    heights = (gaps * normals[rows][:, None]).sum(axis=-1)
    offset[:] = np.median(heights, axis=1)
    away = np.abs(heights - offset[:, None])
    middle = np.median(away, axis=1)
    spread = rule.mad_to_sd * np.median(np.abs(away - middle[:, None]), axis=1)
    limit[:] = middle + rule.n_deviations * spread


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
    return compiled_function("segmentation._graph_numba", name)
