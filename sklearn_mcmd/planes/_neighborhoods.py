"""From points to neighborhoods: rows of an index array, searched in spatial order."""

import numpy as np

from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.planes._neighbor_table import NeighborTable, part_size
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.planes._whole import whole_cloud
from sklearn_mcmd.runtime._chunks import each_slice


class NeighborIndex:
    """Neighborhoods of any query among fixed points X (n, d), float64.

    Indexes of the same points share what the first of them finds; see `IndexedCloud`.

    A neighborhood has `n_neighbors` members, or all distinct points if there are fewer. With None
    there is one neighborhood of all points, which keeps its copies, and there is no `cloud`. A
    member is not farther from the query than `radius`, if that is given; where it holds fewer than
    d + 1 points, the nearest d + 1 are taken. `sizes` (m,), at most `n_neighbors`, are members of
    each of `points`, if not all have as many. A query has as many as the point nearest to it.

    `points` (m, d) are the distinct points in spatial order, and `rows` (m,) the row of X of each.
    """

    def __init__(self, X, n_neighbors, radius=None, sizes=None):
        self.n_neighbors = n_neighbors
        self.radius = radius
        self.sizes = sizes
        if n_neighbors is None:
            # Nearest to the mean first: this order does not depend on the order of the rows.
            distance = np.linalg.norm(X - X.mean(axis=0), axis=1)
            self.rows = np.argsort(distance, kind="stable")
            self.points = np.ascontiguousarray(X[self.rows])
            return
        self.cloud = IndexedCloud.of(X)
        self.rows, self.points = self.cloud.rows, self.cloud.points
        self.n_neighbors = min(int(n_neighbors), len(self.rows))  # NumPy's overflow
        self._table = self._own_table()

    def __getstate__(self):
        """Without the table, as `IndexedCloud`."""
        return {**self.__dict__, "_table": None}

    @property
    def places(self):
        """Row of `points` of each row of X: ndarray of int of shape (n,)."""
        return self.cloud.places

    @property
    def n_distinct(self):
        """Number of distinct points. If they are too few for any plane, `points` repeats some."""
        return self.cloud.n_distinct

    @property
    def chunk(self):
        """Rows that are best searched at once, in parts that begin at multiples of it."""
        return part_size(self.n_neighbors)

    def each_asked(self, hops, size, work, n_jobs):
        """Call ``work(rows)`` with rows of the `points`, near each other, so many at most: those
        not farther `away` from those whose results are asked, as of `Whole`."""
        whole = whole_cloud()
        away = None if whole is None or whole.away is None else whole.away[self.rows]

        def task(rows):
            if away is not None:
                asked = np.flatnonzero(away[rows] <= hops)
                if len(asked) < rows.stop - rows.start:
                    rows = rows.start + asked
            if not isinstance(rows, np.ndarray) or len(rows):
                work(rows)

        each_slice(len(self.points), size, task, n_jobs)

    def query_own(self, rows, k=None, keep=True):
        """The neighborhoods of some of the `points`, each its own first member.

        They have k members, at most the number of points, or `n_neighbors`. Neighbors are kept for
        the next time with `keep`. Ties are as of `IndexedCloud.neighbors`.
        """
        if k is None and self.sizes is not None:
            indices, sizes = self._query_sized(rows, keep)
        else:
            k = self.n_neighbors if k is None else k
            indices = self.cloud.neighbors(rows, k, self.n_neighbors if keep else 0)
            sizes = np.full(len(indices), k)
        if self.radius is None:
            return Neighborhoods(indices, sizes)
        distances = np.linalg.norm(self.points[indices] - self.points[rows][:, None], axis=2)
        return within_radius(indices, distances, sizes, self.radius, self.points.shape[1])

    def _query_sized(self, rows, keep):
        sizes = self.sizes[rows]
        k = int(sizes.max(initial=1))
        shared = self.cloud.table
        if shared is not None and k <= shared.k:
            indices = shared.query(rows, k, keep)
        else:
            if self._table is None:  # after a pickle
                self._table = self._own_table()
            indices = self._table.query(rows, k, keep)
        return padded(indices, sizes), sizes

    def _own_table(self):
        """Neighbors where more are needed than are shared, which no other index could use."""
        if self.sizes is None:
            return None
        return NeighborTable(self.cloud.search_own, len(self.points), self.n_neighbors, self.sizes)

    def query(self, queries):
        """Find the neighborhoods of queries (m, d), as rows of `points`, nearest members first.

        Equally distant members come in the order of `query_own`.
        """
        if self.n_neighbors is None:
            n = len(self.points)
            indices = np.broadcast_to(np.arange(n, dtype=np.int32), (len(queries), n))
            return Neighborhoods(indices, np.full(len(queries), n))
        k = self.n_neighbors
        sizes = np.full(len(queries), k)
        if self.sizes is not None:
            sizes = self.sizes[self.nearest(queries)]
            k = int(sizes.max(initial=1))
        distances, indices = self.cloud.nearest(queries, k)
        if self.radius is None:
            return Neighborhoods(padded(indices, sizes), sizes)
        return within_radius(indices, distances, sizes, self.radius, self.points.shape[1])

    def nearest(self, queries, n_workers=1):
        """Row of `points` nearest to each query; 0 with one neighborhood of all points."""
        if self.n_neighbors is None:
            return np.zeros(len(queries), dtype=np.intp)
        return self.cloud.tree.query(queries, workers=n_workers)[1]


def within_radius(indices, distances, sizes, radius, d):
    """Neighborhoods of the members not farther than the radius, at least as many as a plane."""
    k = indices.shape[1]
    near = (distances <= radius) & (np.arange(k) < sizes[:, None])
    sizes = np.maximum(np.count_nonzero(near, axis=1), min(d + 1, k))
    return Neighborhoods(padded(indices, sizes), sizes)


def padded(indices, sizes):
    """Indices whose columns beyond the sizes repeat the first."""
    k = indices.shape[1]
    if (sizes == k).all():
        return indices
    return np.where(np.arange(k) < sizes[:, None], indices, indices[:, :1])
