"""The points nearest to others, or to themselves: exact, in chunks and threads."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.runtime._chunks import each_slice, slices
from sklearn_mcmd.runtime._compiling import compiled_function

# Below this many points SciPy searches: loading compiled code would take longer.
COMPILE_FROM = 1_000
LEAF = 16  # points a leaf: from 8 to 32, times at 50 neighbors are within 7 %
CAPACITY = 4096  # candidates that all points of a leaf share; more are searched point by point
CHUNK = 1024  # queries at once of `NearestPoints`, at most
AT_ONCE = 32_768  # and their neighbors at once, at most, which bounds the memory
# Points a leaf of SciPy's tree: queries from far off take two thirds of the time with large leaves.
# Of more than three coordinates, as of beams, small ones take 0.6 to 1.1 of it.
TREE_LEAF = 128
# Squares of distances by SciPy may differ from ours by rounding.
ALIKE = 1.0 + 1e-14


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

    The 16 points of a leaf share one list of candidates. How far it must reach is guessed from the
    leaf before. A list that reaches as far as the k-th of its nearest is complete. Points for which
    it is not, such as outliers, search the tree one by one, bounded by the distances of others.

    Equally distant neighbors come in the order of their coordinates, whatever that of the points.

    X, float64 (n, 3), has distinct points, and `points` are ``X[order]``, leaf by leaf: near points
    are near in memory. With `overwrite` they take the place of X.
    """

    def __init__(self, X, overwrite=False):
        build = compiled_function("planes._nearest_numba", "build_tree")
        self.order, *tree = build(X if overwrite else X.copy(), LEAF)
        self.tree = Tree._make(tree)
        self.points, self.ends = self.tree.points, self.tree.last[self.tree.leaves]

    def query(self, rows, k, among=None):
        """Neighbors of a slice of the points, the nearest first: int32 (m, k).

        They are rows of `points`, each its own first neighbor, or of those of `among`, another
        search, of k points or more.
        """
        begin, end, _ = rows.indices(len(self.points))
        search = compiled_function("planes._nearest_numba", "search_rows")
        indices = np.empty((max(end - begin, 0), k), dtype=np.int32)
        first_leaf = np.searchsorted(self.ends, begin, side="right")
        tree = self.tree if among is None else among.tree
        search(self.tree, tree, begin, end, first_leaf, (LEAF, CAPACITY), indices)
        return indices

    def distances(self, rows, near, among):
        """Distances (m, k) of a slice of the points from what `query` found for them."""
        squares = np.zeros(near.shape)
        for axis in range(3):  # one at a time, for less memory
            squares += np.square(among.points[near, axis] - self.points[rows, axis][:, None])
        return np.sqrt(squares, out=squares)


class NearestPoints:
    """Fixed points (m, d) that answer which of them are nearest to others.

    Equally distant ones come in the order of their coordinates. If `among`, bool (m,), is given,
    only these are meant. A search has its own copy of the points, and no other is kept.
    """

    def __init__(self, points, among=None):
        self._all, self._among = points, among
        self.n = len(points) if among is None else np.count_nonzero(among)

    @property
    def points(self):
        """Those that are meant: ndarray of shape (n, d)."""
        return self._all if self._among is None else self._all[self._among]

    @cached_property
    def tree(self):
        points = self.points
        leaf = TREE_LEAF if points.shape[1] <= 3 else LEAF
        return cKDTree(points, leafsize=leaf, balanced_tree=False)

    @cached_property
    def search(self):
        return SelfSearch(self.points, overwrite=self._among is not None)

    def without(self, rows):
        """The search of all but some rows of these points."""
        among = np.ones(len(self._all), bool) if self._among is None else self._among.copy()
        among[rows if self._among is None else np.flatnonzero(among)[rows]] = False
        return NearestPoints(self._all, among)

    def release(self):
        """Free what searches; the next query makes it again."""
        self.__dict__.pop("search", None)
        self.__dict__.pop("tree", None)

    def query(self, queries, k, n_jobs=None):
        """The k nearest points to each query (m, d), float64.

        Returns distances (m, k), ascending, inf where there are no more points; and rows of
        `points`, int32 (m, k), their number where there are no more.
        """
        distances, indices = np.empty((len(queries), k)), np.empty((len(queries), k), np.int32)

        def keep(rows, gaps, near):
            distances[rows], indices[rows] = gaps, near

        self.visit(queries, k, keep, n_jobs)
        return distances, indices

    def visit(self, queries, k, work, n_jobs=None):
        """Call ``work(rows, distances, indices)`` with what `query` would return, chunk by chunk.

        `rows` are those of the queries, a slice or an array.
        """
        chunk = max(1, min(CHUNK, AT_ONCE // k))
        if queries.shape[1] != 3 or len(queries) < COMPILE_FROM or self.n < k:
            tree = self.tree  # made once, before threads ask

            def search_tree(rows):
                work(rows, *query_tree(tree, queries[rows], k))

            return each_slice(len(queries), chunk, search_tree, n_jobs)
        asking, search = SelfSearch(queries), self.search

        def search_together(rows):
            near = asking.query(rows, k, among=search)
            work(asking.order[rows], asking.distances(rows, near, search), search.order[near])

        return each_slice(len(queries), chunk, search_together, n_jobs)


def query_tree(tree, queries, k, width=0):
    """The k nearest of a tree's points in the order of the compiled search: distances (m, k), inf
    where there are no more points; and rows of the points (m, k), their number there.

    At first one more is asked for, to see whether it is as near as the last; then twice as many.
    """
    width = max(min(max(width, k + 1), tree.n), 1)
    distances, near = tree.query(queries, k=np.arange(1, width + 1))
    alike = distances[:, 1:] <= ALIKE * distances[:, :-1]
    cut = alike[:, k - 1 :].all(axis=1) & (k < width < tree.n)
    rows = np.flatnonzero(alike[:, :k].any(axis=1) & ~cut)
    for part in slices(len(rows), max(1, AT_ONCE // width)):
        tied = rows[part]
        neighbors, squares = tree.data[near[tied]], np.zeros(())
        for axis in range(queries.shape[1]):
            squares = squares + np.square(neighbors[..., axis] - queries[tied, axis, None])
        order = np.lexsort((*np.moveaxis(neighbors, -1, 0)[::-1], squares))
        near[tied] = np.take_along_axis(near[tied], order, axis=1)
        distances[tied] = np.sqrt(np.take_along_axis(squares, order, axis=1))
    missing = (0, 0), (0, max(k - width, 0))
    distances = np.pad(distances[:, :k], missing, constant_values=np.inf)
    near = np.pad(near[:, :k], missing, constant_values=tree.n)
    cut = np.flatnonzero(cut)
    for part in slices(len(cut), max(1, AT_ONCE // width)):
        tied = cut[part]
        distances[tied], near[tied] = query_tree(tree, queries[tied], k, 2 * width)
    return distances, near
