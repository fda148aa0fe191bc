"""Nearest neighbors of points among themselves, in three dimensions: compiled, exact."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._compiling import compiled_function

__all__ = ["SelfSearch"]

# Points a leaf: from 8 to 32, times at 50 neighbors are within 7 %.
LEAF = 16
# Candidates that all points of a leaf share. More are searched for point by point.
CAPACITY = 4096


class Tree(NamedTuple):
    """Boxes of points, as compiled code takes them."""

    points: np.ndarray  # float64 (n, 3), in the order of the leaves
    first: np.ndarray  # int64 (n_nodes,), the first row of `points` in each node
    last: np.ndarray  # int64 (n_nodes,), the one behind the last
    left: np.ndarray  # int64 (n_nodes,), the first of two children, the other follows; -1: leaf
    boxes: np.ndarray  # (n_nodes, 6), low and high corner of the box of the node's points
    leaves: np.ndarray  # int64 (n_leaves,), in the order of their rows


class SelfSearch:
    """The k nearest of fixed points to each of these points.

    A tree that answers any query starts from its root each time. Here all queries are the
    points themselves, so the 16 points of a leaf share one list of candidates. How far the list
    must reach is guessed from the leaf before, and the k-th distance of a query from the query
    before. A list that reaches as far as the k-th of its nearest is proven to be complete. Points
    for which it is not, such as outliers, search the tree one by one, and the k-th distances of
    others bound theirs: it is at most longer by the distance between the two.

    Equally distant neighbors come in the order of their coordinates, so the answer does not
    depend on the order of the points.

    X, float64 (n, 3), has distinct points. With `overwrite` it may become `points`, which are
    ``X[order]``; its rows must then be contiguous. `order` (n,) is that of the leaves: near points
    are near in memory.
    """

    def __init__(self, X, overwrite=False):
        build = compiled_function("planes._self_search_numba", "build_tree")
        self.order, *nodes = build(X if overwrite else X.copy(), LEAF)
        self.tree = Tree(*nodes)
        self.points = self.tree.points
        self.ends = self.tree.last[self.tree.leaves]

    def query(self, rows, k, among=None):
        """Neighbors of a slice of the points, the nearest first: int32 (m, k).

        They are rows of `points`, each its own first neighbor, or of those of `among`, another
        search. There must be k points to be found.
        """
        begin, end, _ = rows.indices(len(self.points))
        search = compiled_function("planes._self_search_numba", "search_rows")
        indices = np.empty((max(end - begin, 0), k), dtype=np.int32)
        first_leaf = np.searchsorted(self.ends, begin, side="right")
        tree = self.tree if among is None else among.tree
        search(self.tree, tree, begin, end, first_leaf, (LEAF, CAPACITY), indices)
        return indices
