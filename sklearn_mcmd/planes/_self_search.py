"""Nearest neighbors of points among themselves, in three dimensions: compiled, exact."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._compiling import compiled_function

__all__ = ["SelfSearch"]

# Points a leaf: of 8, 12, 16 and 24 this is the fastest at 50 neighbors.
LEAF = 16
# Candidates that all points of a leaf share. More are searched for point by point.
CAPACITY = 4096


class Tree(NamedTuple):
    """Boxes of points, as compiled code takes them.

    points : ndarray of float64 of shape (n, 3)
        In the order of the leaves.
    first, last : ndarray of int64 of shape (n_nodes,)
        Rows of `points` in each node, from the first up to before the last.
    left : ndarray of int64 of shape (n_nodes,)
        The first of two children, which the other follows; -1 of a leaf.
    boxes : ndarray of shape (n_nodes, 6)
        The low and the high corner of the box of the node's points.
    leaves : ndarray of int64 of shape (n_leaves,)
        In the order of their rows.
    """

    points: np.ndarray
    first: np.ndarray
    last: np.ndarray
    left: np.ndarray
    boxes: np.ndarray
    leaves: np.ndarray


class SelfSearch:
    """The k nearest of fixed points to each of these points.

    A tree that answers any query starts from its root each time. Here all queries are the
    points themselves, so the 16 points of a leaf share one list of candidates. The k-th distance
    of one query bounds that of the next: it is at most longer by the distance between the two.

    Equally distant neighbors come in the order of their coordinates, so the answer does not
    depend on the order of the points.

    Parameters
    ----------
    X : ndarray of float64 of shape (n, 3)
        Distinct points.

    Attributes
    ----------
    order : ndarray of int of shape (n,)
        Rows of X in the order of the leaves: near points are near in memory.
    points : ndarray of shape (n, 3)
        ``X[order]``.
    """

    def __init__(self, X):
        build = compiled_function("planes._self_search_numba", "build_tree")
        self.order, *nodes = build(X, LEAF)
        self.points = np.ascontiguousarray(X[self.order])
        first, _, left, *_ = nodes
        leaves = np.flatnonzero(left < 0)
        self.tree = Tree(self.points, *nodes, leaves[np.argsort(first[leaves])])

    @staticmethod
    def available():
        """Whether compiled code can do the work, here and now: a pickle may come elsewhere."""
        return compiled_function("planes._self_search_numba", "build_tree") is not None

    def query(self, rows, k):
        """Neighbors of some of the points, each its own first.

        Parameters
        ----------
        rows : slice
            Of `points`.
        k : int
            At most as many as there are points.

        Returns
        -------
        indices : ndarray of int32 of shape (m, k)
            Rows of `points`, the nearest first.
        """
        begin, end, _ = rows.indices(len(self.points))
        search = compiled_function("planes._self_search_numba", "search_rows")
        indices = np.empty((max(end - begin, 0), k), dtype=np.int32)
        search(self.tree, begin, end, max(CAPACITY, 2 * k + 32 + 2 * LEAF), indices)
        return indices
