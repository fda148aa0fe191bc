"""Whose plane explains a point? And the graph of neighbors whose planes explain each other."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import radii
from sklearn_mcmd.runtime._chunks import each_slice
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.runtime._progress import progress_part

# Costs that differ by no more than this share of one plus the cost are equal, and the nearest of
# equal planes is the owner: points that were lent one plane differ by rounding.
TIE = 1e-9


class ExplainLimits(NamedTuple):
    """When a plane explains a point. All stages read it here."""

    explained: float = 3.0  # standard deviations of the plane within which it explains points


def explain(queries, candidates, planes, usable, least, likely=False):
    """The plane of its neighbors that explains each query best, however far it is.

    This is the nearest plane, in standard deviations, or the most `likely` one, by Bayes' rule: of
    a flat and a rough plane the flat one then wins.

    A plane reaches as far from its centroid as its neighborhood does from its point. Candidates are
    rows of `planes`, of which those that are `usable` (bool) may explain queries (m, d). `least`
    (m,) is a standard deviation that is added to each plane's.

    Returns the owners (m,), -1 where none reaches the query, and the distances (m,) from their
    planes in standard deviations, inf where there is none.
    """
    owners, distances = np.empty(len(queries), dtype=np.int64), np.empty(len(queries))
    find = _compiled("explain_queries")
    find(queries, candidates, planes, usable, least, likely, TIE, owners, distances)
    return owners, distances


class LinkLimits(NamedTuple):
    """When a point is linked to a neighbor, whose point its plane explains."""

    min_cosine: float  # least cosine of the angle between their normals, whatever their signs
    explained: float  # standard deviations within which a plane explains a point
    max_gap: float  # largest distance between the points, in their units
    mutual: bool  # whether the neighbor's plane must explain the point, too
    both_near: bool  # whether it must be as near to the neighbor as the last of the neighbor's own


def connected_planes(index, k, planes, limits, usable):
    """What hangs together by the links of `row_linker`, as by `connected`, in less memory."""
    link, roots = (
        row_linker(index, k, planes, limits, usable),
        np.arange(len(usable), dtype=np.int32),
    )
    join, links = _compiled("join"), np.empty((index.chunk, k), np.int32)

    def task(rows):
        part = links[: rows.stop - rows.start]
        link(rows, part)
        join(part, rows.start, roots)

    each_slice(len(roots), index.chunk, task, 1)
    return _parts(roots)


def connected(links):
    """Connected parts of a graph; a link in one direction is one in both.

    Links, int32 (n, width), are neighbors, or -1 in their places. Returns the part of each point,
    int32 (n,), from 0 on in the order of their first points, and the sizes of the parts. Which
    points are one part does not depend on the order of points or links.
    """
    roots = np.arange(len(links), dtype=np.int32)
    _compiled("join")(links, 0, roots)
    return _parts(roots)


def _parts(roots):
    labels = _compiled("number_parts")(roots)
    return labels, np.bincount(labels)


def row_linker(index, k, planes, limits, usable=None):
    """What links points to those of their k neighbors that the `LinkLimits` allow.

    Only `usable` points, bool (n,), are linked, all of them with None, and a plane of a negative
    scale explains nothing. Returns a function that takes a slice of m rows and int32 (m, k), which
    becomes the neighbors, the nearest first, with -1 in the places of those that are not linked.
    The point itself is none.
    """
    limits = LinkLimits._make([*map(float, limits[:3]), *map(bool, limits[3:])])
    link, points = _compiled("link_rows"), index.points
    farthest = np.empty(len(points) if limits.both_near else 0)  # distances of the last neighbors

    def measure(rows):
        farthest[rows] = radii(points, points[rows], index.query_own(rows, k))

    if limits.both_near:
        with progress_part(0.0, 0.4):
            each_slice(len(points), index.chunk, measure, None)
    asked = np.empty(0, bool) if usable is None else usable

    def fill(rows, links):
        link(points, index.query_own(rows, k), planes, limits, asked, farthest, rows.start, links)

    return fill


def _compiled(name):
    return compiled_function("planes._explaining_numba", name)
