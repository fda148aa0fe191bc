"""From points to neighborhoods: rows of an index array, searched in spatial order."""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.planes._self_search import SelfSearch

__all__ = ["NeighborIndex", "distinct_rows", "spatial_order"]

# Below this many points the order of memory does not matter, ...
ORDER_FROM = 10_000
# ... and loading compiled code takes longer than the search.
COMPILE_FROM = 1_000
COARSE_LEAF = 256
LEAF = 32


class NeighborIndex:
    """Neighborhoods of any query among fixed points.

    The points are kept in the order of a k-d tree's leaves. Neighbors in space are then
    neighbors in memory. On clouds whose rows come in random order this makes the search and all
    later work two to three times as fast.

    Parameters
    ----------
    X : ndarray of float64 of shape (n, d)
    n_neighbors : int or None
        Members of a neighborhood, or all distinct points if there are fewer. None means one
        neighborhood of all points.
    radius : float, default=None
        Largest distance of a member from the query. If it holds fewer than d + 1 points, the
        nearest d + 1 are taken.

    Attributes
    ----------
    points : ndarray of shape (m, d)
        Distinct points in spatial order. Copies of a neighbor tell nothing about the plane, and
        the thousands of points that some scanners put at the origin would make the search
        quadratic. One neighborhood of all points keeps its copies.
    n_distinct : int
        Number of distinct points. If they are too few for any plane, `points` repeats some.
    rows : ndarray of int of shape (m,)
        Row of X of each of `points`.
    """

    def __init__(self, X, n_neighbors, radius=None):
        self.n_neighbors = n_neighbors
        self.radius = radius
        if n_neighbors is None:
            # Nearest to the mean first: this order does not depend on the order of the rows.
            distance = np.linalg.norm(X - X.mean(axis=0), axis=1)
            self.rows = np.argsort(distance, kind="stable")
            self.points = np.ascontiguousarray(X[self.rows])
            return
        self.rows = distinct_rows(X)
        self.n_distinct = len(self.rows)
        if len(self.rows) <= X.shape[1]:  # too few locations for any plane: copies fill up
            self.rows = np.resize(self.rows, X.shape[1] + 1)
        self.n_neighbors = min(n_neighbors, len(self.rows))
        self.search = None
        distinct = X if len(self.rows) == len(X) else X[self.rows]
        if X.shape[1] == 3 and self.n_distinct >= COMPILE_FROM and SelfSearch.available():
            self.search = SelfSearch(distinct)
            self.rows, self.points = self.rows[self.search.order], self.search.points
            return
        if len(self.rows) >= ORDER_FROM:
            self.rows = self.rows[spatial_order(distinct)]
        self.points = np.ascontiguousarray(X[self.rows])

    @cached_property
    def tree(self):
        """The tree that answers queries which are none of the points."""
        return cKDTree(self.points, leafsize=LEAF, balanced_tree=False)

    def query_own(self, rows, k=None):
        """The neighborhoods of some of the points, each its own first member.

        Parameters
        ----------
        rows : slice
            Of `points`.
        k : int, default=None
            Members, at most the number of points; `n_neighbors` with None.

        Returns
        -------
        Neighborhoods
            Rows of `points`. Equally distant members come in the order of their coordinates where
            compiled code searches: in 3D, from 1,000 points on.
        """
        k = self.n_neighbors if k is None else k
        queries = self.points[rows]
        if self.search is None or not self.search.available():
            indices = self.tree.query(queries, k=k)[1].reshape(len(queries), k).astype(np.int32)
        else:
            indices = self.search.query(rows, k)
        if self.radius is None:
            return Neighborhoods(indices, np.full(len(queries), k))
        distances = np.linalg.norm(self.points[indices] - queries[:, None], axis=2)
        return self._within_radius(indices, distances)

    def query(self, queries):
        """Find the neighborhoods of queries (m, d), nearest members first.

        Returns
        -------
        Neighborhoods
            Rows of `points`.
        """
        if self.n_neighbors is None:
            n = len(self.points)
            indices = np.broadcast_to(np.arange(n, dtype=np.int32), (len(queries), n))
            return Neighborhoods(indices, np.full(len(queries), n))
        k = self.n_neighbors
        if self.radius is None:
            _, indices = self.tree.query(queries, k=k)
            indices = indices.reshape(len(queries), k).astype(np.int32)
            return Neighborhoods(indices, np.full(len(queries), k))
        distances, indices = self.tree.query(queries, k=k)
        return self._within_radius(indices.reshape(-1, k), distances.reshape(-1, k))

    def _within_radius(self, indices, distances):
        """Neighborhoods of the members not farther than the radius, at least as many as a plane."""
        k = indices.shape[1]
        sizes = np.count_nonzero(distances <= self.radius, axis=1)
        sizes = np.maximum(sizes, min(self.points.shape[1] + 1, k))
        indices = np.where(np.arange(k) < sizes[:, None], indices, indices[:, :1])
        return Neighborhoods(indices.astype(np.int32), sizes)

    def nearest(self, queries, n_workers=1):
        """Row of `points` nearest to each query; 0 with one neighborhood of all points."""
        if self.n_neighbors is None:
            return np.zeros(len(queries), dtype=np.intp)
        return self.tree.query(queries, workers=n_workers)[1]


def spatial_order(X):
    """The row order of a coarse tree's leaves: points near in space are near in memory."""
    return cKDTree(X, leafsize=COARSE_LEAF, balanced_tree=False, compact_nodes=False).indices


def distinct_rows(X):
    """Rows of X without copies: the first row of each location."""
    first = np.sort(X[:, 0])
    if (first[1:] != first[:-1]).all():
        return np.arange(len(X))
    order = np.lexsort(X.T)
    rows = X[order]
    return np.sort(order[np.r_[True, (rows[1:] != rows[:-1]).any(axis=1)]])
