"""The few points that enclose all others: vertices of a convex hull."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from sklearn_mcmd.adjustment._plane import row_chunks

__all__ = ["hull_vertices"]

# In more dimensions a hull has too many vertices to save time; then all points are taken.
MAX_DIMENSIONS = 5
# Number of points, at even steps, whose hull contains nearly all others, by dimension.
N_PICKED = {2: 4096, 3: 1024, 4: 512, 5: 256}


def hull_vertices(plane, X, cofactors, members):
    """Members at which every affine function of the regressors reaches its largest size.

    The coordinates are the plane's whitened regressors. Its cofactors at X are squared distances
    from the center plus a constant. Members and result are rows of X, ascending: the vertices of
    the members' convex hull, or all members where a hull saves no time.
    """
    q = plane.rank - 1
    if q == 0:
        return members[:1]
    if len(members) <= 32 or q > MAX_DIMENSIONS:
        return members
    if q > 1:
        members = _outside_picked_hull(plane, X, cofactors, members)
    return members[_vertices(plane.whiten(X[members])[0])]


def _outside_picked_hull(plane, X, cofactors, members):
    """Members outside the hull of a few of them. All vertices are among these."""
    picked = members[:: len(members) // N_PICKED[plane.rank - 1] + 1]
    if len(picked) == len(members):
        return members
    try:
        equations = ConvexHull(plane.whiten(X[picked])[0]).equations
    except QhullError:
        return members
    normals, offsets = equations[:, :-1], equations[:, -1]
    # Points nearer to the center than the nearest facet are inside and need no product.
    reach = max(-offsets.max(), 0.0)
    distant = cofactors[members] >= 0.999 * reach**2 + 1 / plane.sum_weights
    members = members[distant]
    tolerance = 1e-9 * np.abs(offsets).max()
    outside = np.empty(len(members), dtype=bool)
    for rows in row_chunks(len(members)):
        U = plane.whiten(X[members[rows]])[0]
        outside[rows] = (U @ normals.T + offsets).max(axis=1) >= -tolerance
    return members[outside]


def _vertices(U):
    """Positions of the vertices of the convex hull of U, for any affine rank."""
    U = U - U.mean(axis=0)
    _, spread, axes = np.linalg.svd(U, full_matrices=False)
    U = U @ axes[spread > 1e-13 * max(spread[0], np.finfo(float).tiny)].T
    if U.shape[1] == 0:
        return np.array([0])
    if U.shape[1] == 1:
        return np.unique([U[:, 0].argmin(), U[:, 0].argmax()])
    try:
        return np.sort(ConvexHull(U).vertices)
    except QhullError:  # flat except for rounding
        return np.arange(len(U))
