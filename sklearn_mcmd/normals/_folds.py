"""Where a quadric explains a neighborhood: does the surface bend there, or is it folded?

A quadric and two planes have the same number of parameters. At a bend the quadric leaves less, at a
fold the planes do. Of a surface that bends, the normal is that of the quadric at the point, and not
that of the plane of all members: beside an end of a fillet this leans.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.normals._quadrics import QuadricLimits, n_terms, tangents_of, work_arrays
from sklearn_mcmd.planes._principal_planes import student_factors
from sklearn_mcmd.runtime._compiling import compiled_function


class FoldLimits(NamedTuple):
    """When a neighborhood is folded."""

    evidence: float = 1.0  # least ratio of squares that the quadric leaves to those of two planes
    best: float = 0.75  # share of the members whose squares count, as others may be outliers
    # Members farther from the robust plane than this number of its standard deviations are what the
    # second plane is fitted to first.
    off: float = 1.5
    rounds: int = 5  # times that members join the nearer plane, and both are fitted anew


def are_folded(points, around, planes, faces):
    """Whether two planes leave less of neighborhoods than a quadric does: bool (m,).

    `planes` are those of all members, and `faces` the robust planes, each of the majority of the
    members. The points (n, d) are in 2D or 3D.
    """
    folded = np.empty(len(around.sizes), dtype=bool)
    arrays, equations = work_arrays(7, around.indices.shape[1])
    room = arrays[:3], *arrays[3:], arrays.view(np.int64)[3], *equations
    find = compiled_function("normals._folds_numba", "find_folded")
    find(points, around, planes, tangents_of(planes.normals), faces, FoldLimits(), room, folded)
    return folded


def quadric_normals(points, queries, around, planes, left):
    """Tangent planes of quadrics at queries (m, d), in 2D or 3D: normals, centroids and errors.

    `planes` are those of all members, which stay where they determine no quadric, with an error of
    90. `left` (m,) is the standard deviation of the members from their quadric.

    The centroids (m, d) are the points of the quadrics nearest to the queries, along the normals of
    the planes, but no farther off the mean, in the plane, than the farthest member.
    """
    m, d = queries.shape
    normals, centroids, tilt = out = np.empty((m, d)), np.empty((m, d)), np.empty(m)
    arrays, equations = work_arrays(4, around.indices.shape[1])
    room = arrays[:3], arrays[3], *equations, *np.empty((2, n_terms(3)))
    find = compiled_function("normals._folds_numba", "find_quadric_normals")
    tangents, pivot = tangents_of(planes.normals), QuadricLimits().pivot
    find(points, queries, around, planes, tangents, pivot, room, *out)
    freedom = around.sizes - n_terms(d)
    with np.errstate(invalid="ignore"):
        errors = np.degrees(tilt * left) * student_factors(freedom, d)
    return normals, centroids, np.where(errors <= 90.0, errors, 90.0)
