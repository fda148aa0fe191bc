"""The sign of a normal, decided in one place."""

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    connected_components,
    minimum_spanning_tree,
)

__all__ = ["count_upright", "orient_by_spanning_tree", "orient_toward", "point_up"]

UPRIGHT = 80.0  # tilt in degrees from which on noise may decide which normal points up


def count_upright(normals):
    """How many normals (n, 3) are those of upright faces, which have no upper side."""
    return int(np.count_nonzero(np.abs(normals[:, 2]) < np.cos(np.radians(UPRIGHT))))


def point_up(normals):
    """Flip normals (n, d) in place so that the last coordinate that is not zero is positive."""
    undecided = np.arange(len(normals))
    for axis in reversed(range(normals.shape[1])):
        values = normals[undecided, axis]
        down = undecided[values < 0]
        normals[down] = -normals[down]
        undecided = undecided[values == 0]
        if undecided.size == 0:
            break
    return normals


def orient_toward(normals, directions):
    """Flip normals (n, d) in place to the side of directions, (d,) or (n, d).

    Normals at right angles to their direction keep their sign.
    """
    against = np.einsum("ij,ij->i", normals, np.broadcast_to(directions, normals.shape)) < 0
    normals[against] = -normals[against]
    return normals


def orient_by_spanning_tree(normals, points, indices):
    """Make normals of neighbors agree (Hoppe et al., 1992), in place.

    The sign travels along the minimum spanning tree of the neighborhood graph. An edge costs less
    the more parallel its normals are. In each connected part the normal of the highest point is
    made to point up.

    Parameters
    ----------
    normals : ndarray of shape (n, d)
    points : ndarray of shape (n, d)
    indices : ndarray of int of shape (n, k)
        Neighbors of each point.
    """
    n, k = indices.shape
    cost = np.empty((n, k))
    for column, neighbors in zip(cost.T, indices.T, strict=True):
        agreement = np.abs(np.einsum("ij,ij->i", normals, normals[neighbors]))
        # SciPy takes a zero as no edge at all.
        column[:] = 1.0 + 1e-9 - np.minimum(agreement, 1.0)
    # Before SciPy 1.17.1 the spanning tree takes indices of 32 bits only.
    ends = np.arange(0, n * k + 1, k, dtype=np.int32 if n * k < 2**31 else np.int64)
    graph = csr_array((cost.ravel(), indices.ravel(), ends), shape=(n, n))
    tree = minimum_spanning_tree(graph, overwrite=True)
    n_parts, part = connected_components(tree, directed=False)

    # One root is tied to the highest point of each part, so that one walk visits all parts.
    order = np.lexsort((points[:, -1], part))
    roots = order[np.r_[np.flatnonzero(np.diff(part[order])), n - 1]]
    point_up_at = normals[roots]
    normals[roots] = point_up(point_up_at)
    tree = tree.tocoo()
    rows = np.r_[tree.row, np.full(n_parts, n)]
    columns = np.r_[tree.col, roots]
    joined = coo_array((np.ones(len(rows)), (rows, columns)), shape=(n + 1, n + 1)).tocsr()
    _, parent = breadth_first_order(joined, n, directed=False)
    parent = parent[:n]

    sign = np.ones(n + 1)
    below = np.flatnonzero(parent != n)
    product = np.einsum("ij,ij->i", normals[below], normals[parent[below]])
    sign[below] = np.where(product < 0, -1.0, 1.0)
    # Pointer doubling: after i rounds a sign is the product over 2**i steps toward the root.
    ancestor = np.r_[parent, n]
    while (ancestor != n).any():
        sign = sign * sign[ancestor]
        ancestor = ancestor[ancestor]
    normals *= sign[:n, None]
    return normals
