"""The planes of the neighbors: which may a point next to an edge borrow, and how sure is its own?

One point alone lies near many planes by chance, also near wrong ones. So a plane must explain the
patch around the point as well: its nearest neighbors, of which most lie on the same face.

The standard error of a plane says how noise tilts it. It does not say that another plane could
have been chosen: across an edge, on a surface that is not quite flat, or after other points were
removed. Those planes exist, one of each neighbor, and so do their probabilities.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.normals._quadrics import tangents_of
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.runtime._compiling import compiled_function

MODULE = "normals._neighbor_planes_numba"


class PatchLimits(NamedTuple):
    """What the patch of a point is."""

    # Standard deviations within which a plane explains its point. Members of the patch count as
    # this far off at most, since some lie on the other face.
    explained: float
    patch: float = 1 / 3  # share of the neighborhood that is the patch: those nearest to the point

    @classmethod
    def now(cls):
        return cls(ExplainLimits().explained)


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
    lenders = np.empty(len(queries), dtype=np.int64)
    patches = np.empty((queries.shape[1] + 1, around.indices.shape[1]))
    find = compiled_function(MODULE, "find_lenders")
    find(points, queries, around, planes, most, PatchLimits.now(), patches, lenders)
    return lenders


def doubted_errors(points, queries, around, planes, members, bends):
    """Standard errors of normals (m,) in degrees, with the doubt which plane is the right one.

    It is the error of a mixture, within and between its planes:
    ``E^2 + sum of w_j max(0, a_j^2 - 2 (E^2 + E_j^2))``. The planes j are those of the nearest
    third of the neighborhood, w_j their probabilities by the costs of `find_lenders`, and a_j their
    angles to the normal. Where the surface `bends`, bool (m,), what is linear in the place is left
    out of these.

    `planes` are those that the queries have in the end, `members` those of the points before any is
    lent, whose scale is noise: of those that bend, what the quadric leaves.
    """
    errors, width = np.empty(len(queries)), around.indices.shape[1]
    find, limits = compiled_function(MODULE, "doubted_errors"), PatchLimits.now()
    tangents = tangents_of(planes.normals)
    arrays = np.empty((queries.shape[1] + 1, width)), np.empty((6, width))
    find(points, queries, around, planes, tangents, members, bends, limits, *arrays, errors)
    return errors
