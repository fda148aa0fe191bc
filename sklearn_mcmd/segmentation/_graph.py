"""From points with normals to a graph: which neighbors a region may grow to."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import most_noise_around, radii, ratio
from sklearn_mcmd.planes._explaining import LinkLimits, row_linker
from sklearn_mcmd.planes._rules import MAD_TO_SD
from sklearn_mcmd.runtime._chunks import each_slice, run
from sklearn_mcmd.runtime._compiling import compiled_function

# Seeds are as flat, or as near to their planes, if they differ by less than these bits ...
VARIATION_BITS = 30  # ... of the surface variation, and
HEIGHT_BITS = 16  # ... of the plane's standard deviation


class GrowthLimits(NamedTuple):
    """When a region may grow on."""

    # A plane may be noisier than is usual around by what curvature explains. Points of a disk of
    # radius r on a cylinder whose normals turn by an angle over r deviate from their plane by this
    # share of angle * r (root mean square).
    bent: float = 1 / 8
    # Share of the neighbors that tell what noise is usual around. Next to an edge less than half of
    # them have planes of their own face. What fewer tell is small by chance, and faces fall apart.
    usual: float = 0.25
    n_deviations: float = 2.0  # the paper's rule A: the median and this many standard deviations


class GrowthRules(NamedTuple):
    """What makes neighbors parts of one surface; the parameters of `RegionGrowing`."""

    min_cosine: float  # least cosine of the angle between their normals
    max_distance: float | None = None  # in units of the points, as `max_gap`
    max_gap: float | None = None
    mutual: bool = True  # whether planes must explain each other


def link_neighbors(index, planes, floor, rules, n_jobs=None):
    """Link each point to the neighbors that may join its region (section 5.2.3).

    `floor` (n,) is what rounding adds to the distance from a plane. Returns links (n, width) of
    int32, neighbors that may be added from each point, or -1 in their places; and the distance of
    the farthest neighbor looked at.
    """
    # Step 1: how far neighbors are, and how far from a plane they may lie (rule A of the paper).
    k, growth, n = n_linked(index, rules), GrowthLimits(), len(index.points)
    radius, limit = np.empty(n), np.full(n, float(rules.max_distance or 0.0))

    def measure(rows):
        around = index.query_own(rows, k)
        radius[rows] = radii(index.points, index.points[rows], around)
        if rules.max_distance is None:
            limit[rows] = floor[rows] + _rule_a(index.points, planes.take(rows), around)

    each_slice(n, index.chunk, measure, n_jobs)
    # Step 2: links, but none from planes that are noisier than is usual around.
    links = np.empty((n, k), np.int32)
    limits = LinkLimits(
        min_cosine=rules.min_cosine,
        explained=1.0,
        max_gap=np.inf if rules.max_gap is None else rules.max_gap,
        mutual=rules.mutual,
        both_near=False,
    )
    link = row_linker(index, k, planes._replace(scale=limit, radius=radius), limits)

    def link_part(rows):
        link(rows, links[rows])
        if rules.mutual:
            around = index.query_own(rows, k)
            bend = growth.bent * np.arccos(min(rules.min_cosine, 1.0)) * radius[rows]
            most = most_noise_around(planes.scale, around, index.n_neighbors, growth.usual, bend)
            links[rows][planes.scale[rows] > most] = -1

    each_slice(n, index.chunk, link_part, n_jobs)
    return links, radius


def grow_regions(links, seeds):
    """Regions of points that can be reached from a seed along links (section 5.2.3).

    Each point has the region of the first seed from which links lead to it: the order in which
    links are followed does not matter. Seeds are rows, that of least curvature first. Labels,
    int32, count from 0 in their order; what no seed reaches has -1.
    """
    labels = np.full(len(links), -1, np.int32)
    waiting = np.empty_like(labels)
    compiled_function("segmentation._regions_numba", "grow")(links, seeds, waiting, labels)
    return labels


def seed_order(variation, points, planes):
    """Rows in the order in which regions start at them: least curvature first.

    Points that borrowed the same plane have the same curvature. Among them those nearest to the
    plane come first, so that the order of rows does not decide, and last their coordinates tell.
    Both are rounded, so that neither do rounding errors, which change with the place of the cloud.
    """
    flatness = np.rint(np.ldexp(variation, VARIATION_BITS)).astype(np.int32)  # of 1/d at most
    seeds = np.argsort(flatness)  # not stable, which takes longer
    same = np.diff(flatness[seeds]) == 0
    tied = np.flatnonzero(np.append(same, False) | np.append(False, same))
    equal = seeds[tied]
    places = points[equal]
    gaps = places - planes.centroids[equal]
    heights = np.abs(np.einsum("nd,nd->n", gaps, planes.normals[equal]))
    heights = np.rint(np.ldexp(ratio(heights, planes.scale[equal]), HEIGHT_BITS))
    seeds[tied] = equal[np.lexsort((*places.T, heights, flatness[equal]))]
    return seeds


def by_place(points, rows):
    """Rows in the order of their points' coordinates, in which all sums over few points are."""
    return rows[np.lexsort(points[rows].T)]


def answers_of(function, items, n_jobs):
    """The answers of a function to all items, in their order, found in threads."""
    answers: list = [None] * len(items)

    def task(i):
        answers[i] = function(items[i])

    run([(i,) for i in range(len(items))], task, n_jobs)
    return answers


def n_linked(index, rules):
    """Neighbors that may be linked: without `max_gap` none beyond the median distance."""
    return index.n_neighbors if rules.max_gap else n_within_median(index.n_neighbors) + 1


def n_within_median(k):
    """Neighbors not farther than their median distance, of k with the point itself."""
    return k // 2


def _rule_a(points, planes, around):
    """The paper's automatic distance from planes, by those of the neighbors."""
    gaps = points[around.indices] - planes.centroids[:, None]
    away = np.abs(np.einsum("mkd,md->mk", gaps, planes.normals))
    middle = np.median(away, axis=1)
    spread = MAD_TO_SD * np.median(np.abs(away - middle[:, None]), axis=1)
    return middle + GrowthLimits().n_deviations * spread
