"""The largest elements of the redundancy matrix, without forming it (Eqs 13, 14, 17)."""

import numpy as np

from sklearn_mcmd.adjustment._hull import hull_vertices
from sklearn_mcmd.adjustment._plane import CHUNK

__all__ = ["bounding_points", "effects_of", "largest_effects", "largest_effects_of_others"]


def bounding_points(plane, X, cofactors, members, alone):
    """Rows that hold the largest effect on each member, even if one row is left out.

    Points with a leverage over 1/2 act most on themselves, which does not count. They are
    kept beside the hull of the others, so leaving one of them out does not change that hull.
    """
    apart = members[alone[members]] if alone.any() else members[:0]
    if len(apart):
        members = np.setdiff1d(members, apart, assume_unique=True)
    if len(members):
        members = hull_vertices(plane, X, cofactors, members)
    return np.concatenate([members, apart])


def effects_of(plane, X, rows, vertices, weights, alone):
    """``max |r_ki|`` over vertices k other than i, for the given rows i."""
    effect = largest_effects(plane, X, X[vertices], rows)
    few = np.flatnonzero(alone[rows])
    effect[few] = largest_effects_of_others(
        plane, X[rows[few]], X[vertices], rows[few, None] == vertices
    )
    return effect if weights is None else effect * weights[rows]


def largest_effects(plane, X, vertices, rows=None):
    """``max |a_k' N^-1 a_i|`` over vertices k, for all points i or those of some rows."""
    n = len(X) if rows is None else len(rows)
    effect = np.zeros(n)
    if len(vertices) == 0:
        return effect
    design = plane.design(plane.whiten(vertices)[0])
    # With many regressors there is no hull, and all points are vertices.
    step = max(CHUNK * 32 // (32 + len(vertices)), 1)
    for start in range(0, n, step):
        part = slice(start, start + step)
        points = X[part] if rows is None else X[rows[part]]
        product = plane.design(plane.whiten(points)[0]) @ design.T
        effect[part] = np.abs(product, out=product).max(axis=1)
    return effect


def largest_effects_of_others(plane, X, vertices, same):
    """Same, without the vertices that are the point itself."""
    if 0 in same.shape:
        return np.zeros(len(X))
    design = plane.design(plane.whiten(vertices)[0])
    product = np.abs(plane.design(plane.whiten(X)[0]) @ design.T)
    product[same] = 0.0
    return product.max(axis=1)
