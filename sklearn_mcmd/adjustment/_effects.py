"""The largest elements of the redundancy matrix, without forming it (Eqs 13, 14, 17)."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from sklearn_mcmd.adjustment._least_squares import CHUNK
from sklearn_mcmd.runtime._chunks import slices

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
    effect = largest_effects(plane, X[rows], X[vertices])
    few = np.flatnonzero(alone[rows])
    same = rows[few, None] == vertices
    effect[few] = largest_effects(plane, X[rows[few]], X[vertices], same)
    return effect * (1.0 if weights is None else weights[rows])


def largest_effects(plane, X, vertices, same=None):
    """``max |a_k' N^-1 a_i|`` over vertices k, for all points i, without those that are the `same`
    point."""
    effect = np.zeros(len(X))
    if len(vertices) == 0:
        return effect
    design = plane.design(plane.whiten(vertices)[0])
    # With many regressors there is no hull, and all points are vertices.
    step = max(CHUNK * FEWEST // (FEWEST + len(vertices)), 1)
    for part in slices(len(X), step):
        product = np.abs(plane.design(plane.whiten(X[part])[0]) @ design.T)
        if same is not None:
            product[same[part]] = 0.0
        effect[part] = product.max(axis=1)
    return effect
