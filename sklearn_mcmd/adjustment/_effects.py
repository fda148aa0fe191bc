"""The largest elements of the redundancy matrix, without forming it (Eqs 13, 14, 17)."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from sklearn_mcmd.adjustment._least_squares import CHUNK

MAX_DIMENSIONS = 5  # in more a hull has too many vertices to save time; then all points are taken
FEWEST = 32  # members that a hull has; of fewer all are taken


def bounding_points(plane, X, members, alone):
    """Rows that hold the largest effect on each member, even if one row is left out.

    Points with a leverage over 1/2 act most on themselves, which does not count. They are
    kept beside the hull of the others, so leaving one of them out does not change that hull.
    """
    apart = members[alone[members]] if alone.any() else members[:0]
    if len(apart):
        members = np.setdiff1d(members, apart, assume_unique=True)
    if len(members):
        members = hull_vertices(plane, X, members)
    return np.concatenate([members, apart])


def hull_vertices(plane, X, members):
    """Members at which every affine function of the regressors reaches its largest size.

    Members and result are rows of X, ascending: the vertices of the members' convex hull, or all
    members where a hull saves no time.
    """
    if plane.rank == 1:
        return members[:1]
    if len(members) <= FEWEST or plane.rank > MAX_DIMENSIONS + 1:
        return members
    U = plane.whiten(X[members])[0]
    U -= U.mean(axis=0)
    # For any affine rank: along the axes that the members span.
    _, spread, axes = np.linalg.svd(np.linalg.qr(U, mode="r"))
    U = U @ axes[spread > 1e-13 * max(spread[0], np.finfo(float).tiny)].T
    if U.shape[1] == 0:
        return members[:1]
    if U.shape[1] == 1:
        return members[np.unique([U[:, 0].argmin(), U[:, 0].argmax()])]
    try:
        return members[np.sort(ConvexHull(U).vertices)]
    except QhullError:  # flat except for rounding
        return members


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
    step = max(CHUNK * FEWEST // (FEWEST + len(vertices)), 1)
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
