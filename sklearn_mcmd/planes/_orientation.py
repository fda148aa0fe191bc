"""The sign of a normal, decided in one place."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

EDGES_AT_ONCE = 1_000_000  # whose costs are computed; it limits the memory
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


def spanning_forest(normals, points, first, second):
    """The edges of the minimum spanning forest among those between rows `first` and `second`.

    An edge costs less the more parallel its normals are. Of equal costs the coordinates decide, so
    that the forest of all edges is that of the forests of parts of them, in any order of points.
    """
    n = len(points)
    by_place = np.lexsort(points.T).astype(np.int32)
    place = np.empty(n, np.int64)
    place[by_place] = np.arange(n)
    place_1, place_2 = place[first], place[second]
    # One number for each pair, the same in both directions; each pair once.
    pairs = np.minimum(place_1, place_2) * n + np.maximum(place_1, place_2)
    del place_1, place_2
    pairs.sort()
    pairs = pairs[np.r_[True, pairs[1:] != pairs[:-1]]]
    first, second = (by_place[rows] for rows in np.divmod(pairs, n))
    del pairs
    cost = np.empty(len(first))
    for start in range(0, len(first), EDGES_AT_ONCE):
        part = slice(start, start + EDGES_AT_ONCE)
        cost[part] = -np.abs(np.einsum("ij,ij->i", normals[first[part]], normals[second[part]]))
    rank = np.empty(len(cost))
    # Stable: of equal costs coordinates decide. SciPy takes a zero as no edge at all.
    rank[np.argsort(cost, kind="stable")] = np.arange(1.0, len(cost) + 1)
    # Before SciPy 1.17.1 the spanning tree takes indices of 32 bits only, and these are.
    graph = coo_array((rank, (first, second)), shape=(n, n)).tocsr()
    tree = minimum_spanning_tree(graph, overwrite=True).tocoo()
    return tree.row, tree.col


def signs_along(normals, points, first, second):
    """The sign of each normal, so that those at the ends of the edges of a forest agree.

    That of the highest point of each connected part is 1.
    """
    n = len(points)
    tree = coo_array((np.ones(len(first)), (first, second)), shape=(n, n))
    n_parts, part = connected_components(tree, directed=False)
    # One root is tied to the highest point of each part, so that one walk visits all parts.
    order = np.lexsort((*points.T, part))
    roots = order[np.r_[np.flatnonzero(np.diff(part[order])), n - 1]]
    rows = np.r_[first, np.full(n_parts, n)]
    columns = np.r_[second, roots]
    joined = coo_array((np.ones(len(rows)), (rows, columns)), shape=(n + 1, n + 1)).tocsr()
    _, parent = breadth_first_order(joined, n, directed=False)
    parent = parent[:n]

    # A step toward the root flips the sign where the normals at its ends are opposed.
    sign = np.ones(n + 1)
    below = np.flatnonzero(parent != n)
    product = np.einsum("ij,ij->i", normals[below], normals[parent[below]])
    sign[below] = np.where(product < 0, -1.0, 1.0)
    # Pointer doubling: after i rounds a sign is the product over 2**i steps toward the root.
    ancestor = np.r_[parent, n]
    while (ancestor != n).any():
        sign = sign * sign[ancestor]
        ancestor = ancestor[ancestor]
    return sign[:n]
