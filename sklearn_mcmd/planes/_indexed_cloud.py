"""A cloud in spatial order with the neighbors of its points, which all stages share."""

from functools import partial
from hashlib import blake2b
from threading import Lock
from weakref import WeakValueDictionary

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._nearest import COMPILE_FROM, SelfSearch, query_tree
from sklearn_mcmd.planes._neighbor_table import NeighborTable
from sklearn_mcmd.runtime._chunks import ORDER_FROM, spatial_order

ODD = np.uint64(0x9E3779B97F4A7C15)  # of 64 bits, which multiplication spreads
LEAF = 32  # points a leaf of the tree that answers other queries


class IndexedCloud:
    """The distinct points of a cloud X (n, d) in the order of a k-d tree's leaves.

    Neighbors in space are then neighbors in memory, which makes all work up to three times as fast.

    Copies of a neighbor tell nothing about the plane, and the thousands of points that some
    scanners put at the origin would make the search quadratic. So `points` (m, d) are the
    `n_distinct` points without copies; if they are too few for any plane, some are repeated. `rows`
    (m,) has the row of X of each.
    """

    def __init__(self, X):
        self.rows, self._locations = distinct_rows(X)
        self.n_distinct = len(self.rows)
        self.search = self.table = self._tree = order = None
        if len(self.rows) <= X.shape[1]:  # too few locations for any plane: copies fill up
            if self._locations is None:
                self._locations = np.arange(len(X))
            self.rows = np.resize(self.rows, X.shape[1] + 1)
        distinct = X if len(self.rows) == len(X) else X[self.rows]
        if X.shape[1] == 3 and self.n_distinct >= COMPILE_FROM:
            self.search = SelfSearch(distinct)
            order, self.points = self.search.order, self.search.points
        elif len(self.rows) >= ORDER_FROM:
            order = spatial_order(distinct)
        if order is not None:
            self.rows = self.rows[order]
            if self._locations is not None:
                self._locations = _inverse(order)[self._locations]
        if self.search is None:
            self.points = np.ascontiguousarray(X[self.rows])

    @classmethod
    def of(cls, X):
        """The index of a cloud, shared by all stages that see it while one of them keeps it."""
        X = np.ascontiguousarray(X)
        key = _key(X)
        with _lock:
            cloud = _known.get(key)
        if cloud is None:
            made = cls(X)
            with _lock:
                cloud = _known.setdefault(key, made)
        return cloud

    @classmethod
    def release(cls, X):
        """Free the neighbors of a cloud that the stages to come do not see."""
        cloud = _known.get(_key(np.ascontiguousarray(X)))
        if cloud is not None:
            cloud.table = None

    def __getstate__(self):
        """Without the table: a pickle is read where the search is as near as the file."""
        return {**self.__dict__, "table": None}

    @property
    def places(self):
        """Row of `points` of each row of X: ndarray of int of shape (n,)."""
        return _inverse(self.rows) if self._locations is None else self._locations

    @property
    def tree(self):
        """The tree that answers queries which are none of the points."""
        with _tree_lock:  # of threads that ask together the first makes it
            if self._tree is None:
                self._tree = cKDTree(self.points, leafsize=LEAF, balanced_tree=False)
        return self._tree

    def neighbors(self, rows, k, n_kept):
        """The k nearest points of some of the points, itself first: int32 (m, k).

        Equally distant ones come in the order of their coordinates. `n_kept` neighbors of each are
        searched and kept for the next time. With 0, only what was kept before is taken from there,
        and `rows` must be a slice.
        """
        search = self.search_own if n_kept else None  # before others wait: it may make a tree
        with _lock:  # threads that begin together begin one table
            if n_kept and (self.table is None or self.table.k < k):
                self.table = NeighborTable(search, len(self.points), max(k, n_kept))
            table = self.table
        if table is None or table.k < k:
            return self.search_own(rows, k)
        return table.query(rows, k, keep=n_kept > 0)

    def nearest(self, queries, k):
        """Distances (m, k) of the k nearest points of any queries, and their rows: int32 (m, k).

        Equally distant ones come in the order of `neighbors`.
        """
        if self.search is None or not len(queries):
            distances, near = query_tree(self.tree, queries, k)
            return distances, near.astype(np.int32)
        asking = SelfSearch(queries)  # together they are searched faster
        in_order = asking.query(slice(None), k, among=self.search)
        near, distances = np.empty_like(in_order), np.empty(in_order.shape)
        near[asking.order] = in_order
        distances[asking.order] = asking.distances(slice(None), in_order, self.search)
        return distances, near

    @property
    def search_own(self):
        """``search_own(rows, k)``, the k nearest of some of the points, whatever was kept.

        It does not hold the cloud, whose table holds it: both are freed at once, without a cycle.
        """
        return partial(_search_tree, self.tree) if self.search is None else self.search.query


_known: WeakValueDictionary = WeakValueDictionary()
_lock, _tree_lock = Lock(), Lock()


def _key(X):
    return X.shape, blake2b(X, digest_size=16).digest()


def _search_tree(tree, rows, k):
    return query_tree(tree, tree.data[rows], k)[1].astype(np.int32)


def distinct_rows(X):
    """Rows of X without copies, the first row of each location; and which of these each row has.

    The second is None where there are no copies. Only rows whose hash occurs twice are sorted.
    """
    suspects = _rows_of_equal_hash(X)
    order = suspects[np.lexsort(X[suspects].T)]  # stable: of equal rows the first of X comes first
    sorted_rows = X[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (sorted_rows[1:] != sorted_rows[:-1]).any(axis=1)
    if new.all():
        return np.arange(len(X)), None
    first = np.arange(len(X))
    first[order] = order[new][np.cumsum(new) - 1]
    rows = np.flatnonzero(first == np.arange(len(X)))
    return rows, np.searchsorted(rows, first)


def distinct_numbers(numbers):
    """Some integers, each once, ascending; up to twenty times as fast as NumPy's hashes."""
    ordered = np.sort(numbers, axis=None)
    new = np.ones(len(ordered), bool)
    new[1:] = ordered[1:] != ordered[:-1]
    return ordered[new]


def _rows_of_equal_hash(X):
    """Rows whose hash others have too: all copies, and hardly any other row."""
    mixed = location_hashes(X)
    ordered = np.sort(mixed)
    several = distinct_numbers(ordered[1:][ordered[1:] == ordered[:-1]])
    if not len(several):
        return np.empty(0, np.intp)
    places = np.minimum(np.searchsorted(several, mixed), len(several) - 1)
    return np.flatnonzero(several[places] == mixed)


def location_hashes(X):
    """A number of each row that only its location decides: uint64 (n,)."""
    mixed = np.zeros(len(X), np.uint64)
    for column in X.T:
        mixed ^= (column + 0.0).view(np.uint64)  # -0.0 and 0.0 are equal
        mixed *= ODD
        mixed ^= mixed >> np.uint64(32)
    return mixed


def _inverse(order):
    """Where each row went."""
    places = np.empty(len(order), dtype=np.intp)
    places[order] = np.arange(len(order))
    return places
