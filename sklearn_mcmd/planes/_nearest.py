"""The points nearest to any others, found in chunks and threads."""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._self_search import SelfSearch
from sklearn_mcmd.runtime._chunks import each_slice

__all__ = ["NearestPoints"]

# Queries at once and neighbors at once, at most: what bounds the memory.
CHUNK, AT_ONCE = 1024, 32_768
# Fewer points are searched by SciPy: loading compiled code would take longer.
COMPILE_FROM = 1_000
# Queries from far off take two thirds of the time with large leaves.
LEAF = 128
# Squares of distances by SciPy may differ from ours by rounding.
ALIKE = 1.0 + 1e-14


class NearestPoints:
    """Fixed points (m, d) that answer which of them are nearest to others.

    Equally distant ones come in the order of their coordinates, so answers do not depend on the
    order of the points. If `among`, bool (m,), is given, only these are meant. A search has its own
    copy of the points, and no other is kept.
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
        return cKDTree(self.points, leafsize=LEAF, balanced_tree=False)

    @cached_property
    def search(self):
        return SelfSearch(self.points, overwrite=self._among is not None)

    def release(self):
        """Free what searches; it is made again when someone asks."""
        self.__dict__.pop("search", None)
        self.__dict__.pop("tree", None)

    def query(self, queries, k, n_jobs=None):
        """The k nearest points to each query (m, d), float64.

        Returns distances (m, k), ascending, inf where there are no more points; and rows of
        `points` (m, k), their number where there are no more. Rows are int32, or int from 2 ** 31
        points on.
        """
        row = np.int32 if self.n < 2**31 else np.intp
        distances, indices = np.empty((len(queries), k)), np.empty((len(queries), k), row)

        def keep(rows, found, near):
            distances[rows], indices[rows] = found, near

        self.visit(queries, k, keep, n_jobs)
        return distances, indices

    def visit(self, queries, k, work, n_jobs=None):
        """Call ``work(rows, distances, indices)`` with what `query` would return, chunk by chunk.

        `rows` are those of the queries, a slice or an array.
        """
        chunk = max(1, min(CHUNK, AT_ONCE // k))
        shared = queries.shape[1] == 3 and len(queries) >= COMPILE_FROM
        if not (shared and self.n >= max(k, COMPILE_FROM)):

            def ask(rows):
                work(rows, *_ask_tree(self.tree, queries[rows], k))

            return each_slice(len(queries), chunk, ask, n_jobs)
        asking, points = SelfSearch(queries), self.search.points

        def ask_together(rows):
            near = asking.query(rows, k, among=self.search)
            squares = np.zeros(near.shape)
            for axis in range(3):  # one at a time, for less memory
                squares += np.square(points[near, axis] - asking.points[rows, axis][:, None])
            work(asking.order[rows], np.sqrt(squares, out=squares), self.search.order[near])

        return each_slice(len(queries), chunk, ask_together, n_jobs)


def _ask_tree(tree, queries, k):
    """The k nearest of a tree's points in the order of the compiled search."""
    width = max(min(k + 1, tree.n), k)  # with one more, to see whether it is as near as the last
    distances, near = tree.query(queries, k=np.arange(1, width + 1))
    alike = (distances[:, 1:] <= ALIKE * distances[:, :-1]) & np.isfinite(distances[:, 1:])
    ties = np.flatnonzero(alike.any(axis=1))
    distances, near = distances[:, :k].copy(), near[:, :k].copy()
    for row in ties:
        last = distances[row, np.isfinite(distances[row])].max(initial=0.0)
        some = np.array(tree.query_ball_point(queries[row], ALIKE * last), dtype=near.dtype)
        squares = np.zeros(len(some))
        for axis in range(queries.shape[1]):
            squares += np.square(tree.data[some, axis] - queries[row, axis])
        order = np.lexsort((*tree.data[some].T[::-1], squares))[:k]
        near[row, : len(order)] = some[order]
        distances[row, : len(order)] = np.sqrt(squares[order])
    return distances, near
