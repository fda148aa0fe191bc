"""Whose plane may a point next to an edge borrow? That which explains the patch around the point.

One point alone lies near many planes by chance, also near wrong ones. So a plane must explain the
nearest neighbors as well, of which most lie on the same face as the point.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._compiling import compiled_function

__all__ = ["find_lenders"]

# Number of its standard deviations within which a plane explains its point. Members of the patch
# count as this far off at most, since some lie on the other face.
EXPLAINED = 3.0
# Share of the neighborhood that is the patch: those nearest to the point.
PATCH = 1 / 3


class PatchLimits(NamedTuple):
    """What the compiled form is told."""

    explained: float
    patch: float


def find_lenders(points, queries, around, planes, most):
    """The neighbors whose planes are the most likely ones of patches.

    By Bayes' rule this is the plane with the least sum of ``log S + (r / S)^2 / 2 - log f``, where
    r is a point's distance to the plane, S the plane's standard deviation and f the share of its
    neighborhood that it keeps, the prior probability. The query weighs as much as all other points
    of the patch. The weights of these fall by the same step from each to the next farther one.

    Planes that are not noisier than `most` (m,) and explain the query come first. A plane reaches
    as far from its centroid as its neighborhood does from its point. Points and queries are
    float64, and `around` has rows of both `points` and `planes`. Returns rows of `planes`, int64
    (m,), -1 where none reaches the query.
    """
    limits, lenders = PatchLimits(EXPLAINED, PATCH), np.empty(len(queries), dtype=np.int64)
    find = compiled_function("normals._neighbor_planes_numba", "find_lenders")
    find(points, queries, around, planes, most, limits, lenders)
    return lenders
