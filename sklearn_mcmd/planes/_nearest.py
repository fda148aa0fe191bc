"""The points nearest to any others, found in chunks and threads."""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._chunks import each_slice
from sklearn_mcmd.planes._self_search import SelfSearch

__all__ = ["NearestPoints"]

# Queries at once: what bounds the memory.
CHUNK = 1024
# Fewer points are searched by SciPy: loading compiled code would take longer.
COMPILE_FROM = 1_000
# Queries from far off take two thirds of the time with large leaves.
LEAF = 128


class NearestPoints:
    """Fixed points that answer which of them are nearest to others.

    Parameters
    ----------
    points : ndarray of float64 of shape (n, d)
    """

    def __init__(self, points):
        self.points = points

    @cached_property
    def tree(self):
        return cKDTree(self.points, leafsize=LEAF, balanced_tree=False)

    @cached_property
    def search(self):
        return SelfSearch(self.points)

    def query(self, queries, k, n_jobs=None):
        """The k nearest points to each query.

        Parameters
        ----------
        queries : ndarray of float64 of shape (m, d)
        k : int
        n_jobs : int, default=None

        Returns
        -------
        distances : ndarray of shape (m, k)
            Ascending; inf where there are no more points.
        indices : ndarray of int of shape (m, k)
            Rows of `points`; their number where there are no more.
        """
        distances, indices = np.empty((len(queries), k)), np.empty((len(queries), k), np.intp)

        def keep(rows, found, near):
            distances[rows], indices[rows] = found, near

        self.visit(queries, k, keep, n_jobs)
        return distances, indices

    def visit(self, queries, k, work, n_jobs=None):
        """Call ``work(rows, distances, indices)`` with what `query` would return, chunk by chunk.

        `rows` are those of the queries, a slice or an array.
        """
        shared = self.points.shape[1] == 3 and len(queries) >= COMPILE_FROM
        if not (shared and len(self.points) >= max(k, COMPILE_FROM) and SelfSearch.available()):

            def ask(rows):
                found = self.tree.query(queries[rows], k=k)
                work(rows, *(part.reshape(-1, k) for part in found))

            return each_slice(len(queries), CHUNK, ask, n_jobs)
        asking, points = SelfSearch(queries), self.search.points

        def ask_together(rows):
            near = asking.query(rows, k, among=self.search)
            squares = np.square(points[near] - asking.points[rows][:, None])
            distances = np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2])
            work(asking.order[rows], distances, self.search.order[near])

        return each_slice(len(queries), CHUNK, ask_together, n_jobs)
