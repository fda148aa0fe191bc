"""What cells that overlap say of each other: the sides of normals, and regions that are one."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from sklearn_mcmd.normals._features import flip_columns
from sklearn_mcmd.normals._sides import TreeLimits
from sklearn_mcmd.planes._indexed_cloud import distinct_numbers
from sklearn_mcmd.planes._orientation import signs_along, spanning_forest
from sklearn_mcmd.runtime._chunks import slices

LEAST_SHARED = 10  # points that regions of two cells share at least, if they are one,
LEAST_SHARE = 0.7  # and this share of the smaller one's points in the overlap
LEAST_SEEN = 0.25  # share of a region that another cell sees, if it is to join what touches there
SMOOTH = 0.9  # cosine between normals of neighbors that are of one smooth part, at least

AT_ONCE = 100_000  # points whose neighbors are asked for at once


def sides_in_overlap(part, fitted, cloud):
    """What `sides_of_cells` asks of a cell whose normals agree along a tree of all points: the
    smooth parts of the tree of own points and their neighbors, and where these are joined.

    Signs of the own points, by which normals agree in each part, and arrays: the parts of own
    points and of those of others, heights of parts, and pairs of them with a cosine of normals.
    """
    n, k = len(cloud.points), min(TreeLimits().n_neighbors, len(cloud.points))
    own, normals = distinct_numbers(cloud.places[part.own]), fitted.normals_[cloud.rows]
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
        "halo": in_halo(part.taken(near), tree[near]),
        "halo_normals": (fitted.normals_ * signs[:, None])[near & ~part.own],
    }


def sides_of_cells(run, names):
    """Flip the normals of cells so that they agree with those of others, as final results."""
    results, tops = run.results, list(run.found("tops"))
    starts = np.cumsum([0, *map(len, tops)])
    pairs, votes = [np.empty((2, 0), np.int64)], [np.empty(0)]
    for cell, home, rows, at, tree in _overlaps(run):
        theirs = starts[home] + results.mapped(home, "trees")[at].astype(np.int64)
        both = results.mapped(cell, "halo_normals")[rows], results.mapped(home, "results")[at, :3]
        pairs.append(np.stack([starts[cell] + tree, theirs]))
        votes.append(np.sign(np.einsum("ij,ij->i", *both)))
    # They count less than any vote: a tree of the whole has them last, too.
    for start, joints in zip(starts, run.found("joints"), strict=False):
        pairs.append(start + joints[:, :2].astype(np.int64).T)
        agree = np.clip(np.abs(joints[:, 2]), 1e-9, SMOOTH)
        votes.append(np.where(joints[:, 2] < 0, -agree, agree))
    signs = _signs(np.concatenate(pairs, axis=1), np.concatenate(votes), np.concatenate(tops))
    for cell in range(len(run.cells)):
        columns, trees = results.read(cell, "results"), results.read(cell, "trees")
        down = signs[starts[cell] + trees] < 0
        columns[down] = flip_columns(columns[down], names)
        results.keep(cell, "final", {"final": columns})


def _signs(pairs, votes, tops):
    """The signs by which parts agree along the tree of the most votes; that of the highest is 1."""
    n = len(tops)
    sums = coo_array((votes, np.sort(pairs, axis=0)), shape=(n, n)).tocsr()
    sums.eliminate_zeros()
    # The most votes first: SciPy's tree takes the least costs, which tell of which sums they are.
    order = np.argsort(-np.abs(sums.data), kind="stable")
    costs = sums.copy()
    costs.data[order] = np.arange(1.0, len(order) + 1)
    tree = minimum_spanning_tree(costs).tocoo()
    turned = sums.data[order[tree.data.astype(int) - 1]] < 0
    _, part = connected_components(tree, directed=False)
    by_height = np.lexsort((tops, part))
    highest = by_height[np.flatnonzero(np.diff(part[by_height], append=n))]
    # Each part is two nodes, one of each sign, that are apart: one hangs together with the highest.
    rows, columns = np.r_[tree.row, tree.row + n], np.r_[tree.col, tree.col]
    columns = columns + n * np.r_[turned, ~turned]
    both = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n, 2 * n))
    _, side = connected_components(both, directed=False)
    return np.where(side[:n] == side[highest[part]], 1.0, -1.0)


def join_regions(run, starts, sizes):
    """The joined region of each region of each cell, from 0 on: those that are one share points.

    ``starts[cell]`` is the number of its first region; `sizes` (n,) are the own points of all, and
    a region without any joins none.
    """
    n, pairs_of, counts_of = len(sizes), [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for cell, home, _, at, labels in _overlaps(run):
        theirs = run.results.mapped(home, "results")[at, 0].astype(np.int64)
        both = np.stack([starts[cell] + labels, starts[home] + theirs])
        one, other = np.sort(both[:, (labels >= 0) & (theirs >= 0)], axis=0)
        new, counts = np.unique(one * n + other, return_counts=True)
        pairs_of.append(new)
        counts_of.append(counts)
    codes, of = np.unique(np.concatenate(pairs_of), return_inverse=True)
    shared = np.bincount(of, np.concatenate(counts_of), len(codes))
    pairs = np.stack(np.divmod(codes, max(n, 1)))
    # In the overlap of the cells of a pair, the points of the smaller one.
    cells = np.searchsorted(starts, pairs, side="right")
    asked = (np.unique(key, return_inverse=True)[1] for key in pairs * len(starts) + cells[::-1])
    least = np.minimum(*(np.bincount(of, shared)[of] for of in asked))
    kept = (shared >= LEAST_SHARED) & (shared > LEAST_SHARE * least)
    kept &= (sizes[pairs] > 0).all(axis=0)
    pairs = pairs[:, kept & ~_are_hardly_seen(run, starts, pairs, cells, shared * kept)]
    graph = coo_array((np.ones(pairs.shape[1], bool), pairs), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def _are_hardly_seen(run, starts, pairs, cells, shared):
    """Which pairs of regions, which share so many points, are not one. The cell of the one has
    another that touches it and shares more with the other, whose cell sees little of the one."""
    n, are = int(starts[-1]), np.zeros(len(shared), bool)
    seen, beside = np.concatenate(list(run.found("seen"))), [np.empty((0, 2), np.int64)]
    beside += [start + both for start, both in zip(starts, run.found("touching"), strict=False)]
    touching = np.concatenate(beside) @ [n, 1]
    for one, other in (0, 1), (1, 0):
        order = np.lexsort((-shared, cells[one], pairs[other]))
        name, group = pairs[one, order], pairs[other, order] * len(starts) + cells[one, order]
        little = shared[order] < LEAST_SEEN * seen[name]
        for lag in range(1, len(order)):
            alike = group[lag:] == group[:-lag]  # the stronger ones before it
            if not alike.any():
                break
            codes = np.sort(np.stack([name[lag:], name[:-lag]]), axis=0).T @ [n, 1]
            are[order[lag:][little[lag:] & alike & np.isin(codes, touching)]] = True
    return are


def touching_regions(cloud, labels):
    """Pairs (m, 2) of labels of neighbors, the smaller first; -1 is no label."""
    of, codes = np.full(len(cloud.points), -1, np.int64), [np.empty(0, np.int64)]
    of[cloud.places] = labels
    k, n = min(TreeLimits().n_neighbors, len(of)), int(labels.max(initial=-1)) + 1
    for rows in slices(len(of), AT_ONCE):
        near = of[cloud.neighbors(rows, k, 0)]
        less, more = np.minimum(near[:, :1], near), np.maximum(near[:, :1], near)
        codes.append(distinct_numbers((less * n + more)[(less >= 0) & (less < more)]))
    return np.stack(np.divmod(distinct_numbers(np.concatenate(codes)), max(n, 1)), axis=1)


def in_halo(part, values):
    """What a cell says of the points of others: their cells, numbers there, and a value of each."""
    others = ~part.own
    return np.column_stack([part.homes[others], part.at[others], values[others]])


def _overlaps(run):
    """Of each pair of cells, what the first says of points of the second: numbers of both cells,
    rows in its halo, and of these numbers in the second and values."""
    for cell, halo in enumerate(run.found("halo")):
        halo = halo.astype(np.int64)
        for home in np.unique(halo[:, 0]).tolist():
            rows = np.flatnonzero(halo[:, 0] == home)
            yield cell, home, rows, *halo[rows, 1:].T
