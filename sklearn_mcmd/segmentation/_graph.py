"""From points with normals to a graph: which neighbors a region may grow to."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import quantile_around
from sklearn_mcmd.planes._chunks import each_slice
from sklearn_mcmd.planes._compiling import compiled_function
from sklearn_mcmd.planes._linking import LinkLimits, link_planes
from sklearn_mcmd.planes._rules import MAD_TO_SD

__all__ = ["GrowthRules", "grow_regions", "link_neighbors", "n_within_median"]

# Smaller clouds take NumPy: loading compiled code would take longer than the work.
COMPILE_FROM = 2_000
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


def link_neighbors(index, planes, floor, rules, n_jobs=None):
    """Link each point to the neighbors that may join its region (section 5.2.3).

    A neighbor is linked if

    1. its distance to the point's plane is at most `max_distance`; by default three standard
       deviations of the plane,
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
    planes : Planes
        Of ``index.points``: centroids, normals and scales, which are no less than `floor`.
    floor : ndarray of shape (n,)
        What rounding amounts to.
    rules : GrowthRules
    n_jobs : int, default=None

    Returns
    -------
    links : ndarray of int32 of shape (n, width)
        Neighbors that may be added from each point, nearest first, then -1.
    radius : ndarray of shape (n,)
        Distance of the farthest neighbor looked at.
    """
    n, max_gap = len(index.points), rules.max_gap
    # Neighbors beyond the median distance are never linked, and need not be found.
    k = index.n_neighbors if max_gap is not None else n_within_median(index.n_neighbors) + 1
    radius, limit, usable = np.empty(n), planes.scale, np.ones(n, dtype=bool)
    if rules.max_distance is not None:
        limit = np.full(n, float(rules.max_distance))
    elif not rules.mutual:
        limit = np.empty(n)

    def measured(rows):
        around = index.query_own(rows, k)
        farthest = index.points[around.indices[:, -1]] - index.points[rows]
        radius[rows] = np.linalg.norm(farthest, axis=1)
        if rules.mutual:
            usable[rows] = _is_quiet(planes.scale, rows, around, radius, index.n_neighbors, rules)
        elif rules.max_distance is None:
            found = _rule_a(index.points, planes.take(rows), around)
            limit[rows] = np.maximum(found, floor[rows])

    each_slice(n, index.chunk, measured, n_jobs)
    explained = CUTOFF if limit is planes.scale else 1.0
    limits = LinkLimits(
        rules.min_cosine, explained, np.inf if max_gap is None else max_gap, rules.mutual
    )
    planes, compiled = planes._replace(scale=limit), n >= COMPILE_FROM
    return link_planes(index, k, planes, limits, usable, compiled, n_jobs), radius


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


def _is_quiet(scale, rows, around, radius, n_neighbors, rules):
    """Whether planes are no noisier than is usual around, and than curvature makes them."""
    usual = quantile_around(scale, around, USUAL, compiled=len(scale) >= COMPILE_FROM)
    bent = BENT * np.arccos(min(rules.min_cosine, 1.0)) * radius[rows]
    # The standard error of a standard deviation that so many neighbors tell.
    most = 1 + N_ERRORS / np.sqrt(2 * n_neighbors)
    return scale[rows] <= most * np.hypot(usual, bent)


def _rule_a(points, planes, around):
    """The paper's automatic distance from planes, by those of the neighbors."""
    gaps = points[around.indices] - planes.centroids[:, None]
    away = np.abs(np.einsum("mkd,md->mk", gaps, planes.normals))
    middle = np.median(away, axis=1)
    spread = MAD_TO_SD * np.median(np.abs(away - middle[:, None]), axis=1)
    return middle + N_DEVIATIONS * spread


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
