"""What cells that overlap say of each other: the sides of normals, and regions that are one."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from sklearn_mcmd.normals._features import flip_columns
from sklearn_mcmd.normals._sides import TreeLimits
from sklearn_mcmd.planes._orientation import signs_along, spanning_forest
from sklearn_mcmd.runtime._chunks import slices

LEAST_SHARED = 10  # points that regions of two cells share at least, if they are one,
LEAST_SHARE = 0.5  # and this share of the smaller one's points in the overlap
SMOOTH = 0.9  # cosine between normals of neighbors that are of one smooth part, at least

AT_ONCE = 100_000  # points whose neighbors are asked for at once


def sides_in_overlap(part, fitted, cloud):
    """What `sides_of_cells` asks of a cell whose normals agree along a tree of all points: the
    smooth parts of the tree of own points and their neighbors, and where these are joined.

    Signs of the own points, by which normals agree in each part, and arrays: the parts of own
    points and of those of others, heights of parts, and pairs of them with a cosine of normals.
    """
    n, k = len(cloud.points), min(TreeLimits().n_neighbors, len(cloud.points))
    own, normals = np.unique(cloud.places[part.own]), fitted.normals_[cloud.rows]
    near = np.concatenate([cloud.neighbors(rows, k, 0) for rows in slices(n, AT_ONCE)])[own]
    ends = spanning_forest(normals, cloud.points, np.repeat(own, k), near.ravel())
    bent = np.abs(np.einsum("ij,ij->i", *(normals[end] for end in ends))) < SMOOTH
    first, second = (end[~bent] for end in ends)
    signs = signs_along(normals, cloud.points, first, second)
    smooth = coo_array((np.ones(len(first)), (first, second)), shape=(n, n))
    n_parts, tree = connected_components(smooth, directed=False)
    normals = normals * signs[:, None]
    first, second = (end[bent] for end in ends)
    cosine = np.einsum("ij,ij->i", normals[first], normals[second])
    joints = np.column_stack([tree[first], tree[second], cosine])
    near = np.isin(np.arange(n), near)[cloud.places]
    tree, signs = tree[cloud.places], signs[cloud.places]
    top = np.full(n_parts, -np.inf)
    np.maximum.at(top, tree[part.own], part.xyz[part.own, 2])
    return signs[part.own], {
        "trees": tree[part.own],
        "tops": top,
        "joints": joints,
        **in_halo(part.taken(near), tree[near], fitted.normals_[near] * signs[near, None]),
    }


def sides_of_cells(run, names):
    """Flip the normals of cells so that they agree with those of others, as final results."""
    cells, results = range(len(run.cells)), run.results
    starts = np.cumsum([0, *(len(results.mapped(cell, "tops")) for cell in cells)])
    pairs, votes = [np.empty((2, 0), np.int64)], [np.empty(0)]
    for cell, home, at, tree, normals in _overlaps(results, cells):
        theirs = starts[home] + results.mapped(home, "trees")[at].astype(np.int64)
        other = results.mapped(home, "results")[at, :3]
        pairs.append(np.stack([starts[cell] + tree, theirs]))
        votes.append(np.sign(np.einsum("ij,ij->i", normals, other)))
    for cell in cells:  # they count less than any vote: a tree of the whole has them last, too
        joints = results.read(cell, "joints")
        pairs.append(starts[cell] + joints[:, :2].astype(np.int64).T)
        agree = np.clip(np.abs(joints[:, 2]), 1e-9, SMOOTH)
        votes.append(np.where(joints[:, 2] < 0, -agree, agree))
    tops = np.concatenate([results.read(cell, "tops") for cell in cells])
    signs = _signs(np.concatenate(pairs, axis=1), np.concatenate(votes), tops)
    for cell in cells:
        columns, trees = results.read(cell, "results"), results.read(cell, "trees")
        down = signs[starts[cell] + trees] < 0
        columns[down] = flip_columns(columns[down], names)
        results.keep(cell, "final", {"final": columns})


def _signs(pairs, votes, tops):
    """The signs by which parts agree along the tree of the most votes; that of the highest is 1."""
    n = len(tops)
    total = coo_array((votes, np.sort(pairs, axis=0)), shape=(n, n)).tocsr()
    total.sum_duplicates()
    edges = total.tocoo()
    kept = (edges.row != edges.col) & (edges.data != 0)
    row, col, sums = edges.row[kept], edges.col[kept], edges.data[kept]
    # The most votes first: SciPy's tree takes the least costs, and a zero as no edge.
    order = np.argsort(-np.abs(sums), kind="stable")
    cost = np.empty(len(sums))
    cost[order] = np.arange(1.0, len(sums) + 1)
    tree = minimum_spanning_tree(coo_array((cost, (row, col)), shape=(n, n)).tocsr())
    n_parts, part = connected_components(tree, directed=False)
    order = np.lexsort((tops, part))
    roots = order[np.flatnonzero(np.diff(part[order], append=n_parts))]
    # One more node is tied to the roots, so that one walk visits all.
    tree = tree.tocoo()
    agree = np.sign(sums)[_order_of(tree.row, tree.col, row, col, n)]
    ends = np.r_[tree.row, np.full(n_parts, n)], np.r_[tree.col, roots]
    known = coo_array((np.r_[agree, np.ones(n_parts)], ends), shape=(n + 1, n + 1)).tocsr()
    known = known + known.T
    nodes, parents = breadth_first_order(known, n, directed=False)
    signs = np.ones(n + 1)
    steps = np.asarray(known[nodes[1:], parents[nodes[1:]]]).ravel()
    for node, step in zip(nodes[1:].tolist(), steps.tolist(), strict=True):
        signs[node] = signs[parents[node]] * step
    return signs[:n]


def _order_of(tree_row, tree_col, row, col, n):
    """Where the edges of a tree are among all edges."""
    codes, wanted = row.astype(np.int64) * n + col, tree_row.astype(np.int64) * n + tree_col
    order = np.argsort(codes)
    return order[np.searchsorted(codes[order], wanted)]


def join_regions(results, cells, starts, sizes):
    """The joined region of each region of each cell, from 0 on: those that are one share points.

    ``starts[cell]`` is the number of its first region; `sizes` (n,) are the own points of all, and
    a region without any joins none.
    """
    overlaps: dict[tuple, list] = {}
    for cell, home, at, labels, _ in _overlaps(results, cells):
        theirs = results.mapped(home, "results")[at, 0].astype(np.int64)
        both = np.stack([labels, theirs])[:, (labels >= 0) & (theirs >= 0)]
        both = both if cell < home else both[::-1]
        overlaps.setdefault((min(cell, home), max(cell, home)), []).append(both)
    found = [np.empty((2, 0), np.int64)]
    for (one, other), both in overlaps.items():
        both = np.concatenate(both, axis=1)
        pairs, shared = np.unique(both, axis=1, return_counts=True)
        least = np.minimum(*(np.bincount(side)[of] for side, of in zip(both, pairs, strict=True)))
        kept = (shared >= LEAST_SHARED) & (shared > LEAST_SHARE * least)
        found.append(pairs[:, kept] + [[starts[one]], [starts[other]]])
    pairs, n = np.concatenate(found, axis=1), len(sizes)
    pairs = pairs[:, (sizes[pairs] > 0).all(axis=0)]
    graph = coo_array((np.ones(pairs.shape[1], bool), pairs), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def in_halo(part, values, vectors=None):
    """What a cell says of the points of others: their cells, numbers there, and a value of each."""
    others = ~part.own
    found = {"halo": np.column_stack([part.homes[others], part.at[others], values[others]])}
    return found if vectors is None else {**found, "halo_vectors": vectors[others]}


def _overlaps(results, cells):
    """Of each pair of cells, what the first says of points of the second: numbers of both cells,
    numbers in the second, values, and vectors, if there are any."""
    for cell in cells:
        halo = results.read(cell, "halo").astype(np.int64)
        vectors = (
            results.mapped(cell, "halo_vectors") if results.has(cell, "halo_vectors") else None
        )
        for home in np.unique(halo[:, 0]).tolist():
            some = np.flatnonzero(halo[:, 0] == home)
            yield (
                cell,
                home,
                halo[some, 1],
                halo[some, 2],
                None if vectors is None else vectors[some],
            )
