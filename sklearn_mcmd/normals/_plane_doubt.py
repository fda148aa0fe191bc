"""How well a normal is known, given that its plane was chosen among many.

The standard error of a plane tells how noise tilts it. It does not tell that another plane could
have been chosen: across an edge, on a surface that is not quite flat, or after other points were
removed. Those planes exist, one of each neighbor, and so do their probabilities.
"""

import numpy as np

from sklearn_mcmd.normals._neighbor_planes import EXPLAINED, PATCH, PatchLimits
from sklearn_mcmd.normals._quadrics import tangents_of
from sklearn_mcmd.runtime._compiling import compiled_function

__all__ = ["doubted_errors"]


def doubted_errors(points, queries, around, planes, members, bends):
    """Standard errors of normals (m,) in degrees, with the doubt which plane is the right one.

    It is the error of a mixture, within and between its planes:
    ``E^2 + sum of w_j max(0, a_j^2 - 2 (E^2 + E_j^2))``. The planes j are those of the nearest
    third of the neighborhood, w_j their probabilities by the costs of `find_lenders`, and a_j their
    angles to the normal. Where the surface `bends`, bool (m,), what is linear in the place is left
    out of these.

    `planes` are those that the queries have in the end. `members` are those of the points before
    any is lent, rows of which `around` has; their scale is noise: of those that bend, what the
    quadric leaves. Points and queries are float64, in 2D or 3D.
    """
    errors, width = np.empty(len(queries)), around.indices.shape[1]
    find = compiled_function("normals._plane_doubt_numba", "doubted_errors")
    tangents = tangents_of(planes.normals)
    limits = PatchLimits(EXPLAINED, PATCH)
    arrays = np.empty((queries.shape[1] + 1, width)), np.empty((6, width))
    find(points, queries, around, planes, tangents, members, bends, limits, *arrays, errors)
    return errors
