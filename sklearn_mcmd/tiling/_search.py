"""Exact searches over all cells, of which only what can matter is read.

A search among points of a cell is that of the whole cloud if it does not reach the border of the
cell's box. Else all cells are seen that may have nearer points, one after the other.
"""

from threading import Lock

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.runtime._chunks import ORDER_FROM, spatial_order
from sklearn_mcmd.runtime._compiling import compiled_function

__all__ = [
    "SLACK",
    "Found",
    "as_near_as",
    "to_border",
    "visit_far",
    "visit_nearest",
    "within_reach",
]

# Distances are computed with rounding errors, of about 1e-16 of their size.
SLACK = 1.0 + 1e-12
LEAF = 32
# Distances that are kept at once, what bounds the memory.
AT_ONCE = 1_000_000
ASKED_AT_ONCE = 5_000  # queries whose points are listed


class Found:
    """Points of several cells.

    Parameters
    ----------
    parts : list of (int, ndarray of shape (m, 3), ndarray of int of shape (m,))
        Cells, their points, and the rows of these among the cell's places.

    Attributes
    ----------
    points : ndarray of shape (n, 3)
    parts : list of (int, ndarray of int)
        Cells and rows.
    """

    def __init__(self, parts):
        self.points = np.vstack([np.empty((0, 3)), *(points for _, points, _ in parts)])
        self.parts = [(cell, rows) for cell, _, rows in parts]

    @property
    def places(self):
        """The cell of each point, and its row among the places of the cell."""
        cells = [np.full(len(rows), cell) for cell, rows in self.parts]
        rows = [np.empty(0, np.intp), *(rows for _, rows in self.parts)]
        return np.concatenate([rows[0], *cells]), np.concatenate(rows)


def within_reach(cells, load, queries, reach):
    """All points within reach of any query, and maybe some more.

    Parameters
    ----------
    cells : Cells
    load : callable
        Returns the points (n, 3) of a cell that are meant, and their rows among its places.
    queries : ndarray of shape (m, 3)
    reach : ndarray of shape (m,)

    Returns
    -------
    Found
    """
    parts = []
    if len(queries):
        reach = SLACK * reach
        low, high = (queries - reach[:, None]).min(axis=0), (queries + reach[:, None]).max(axis=0)
        for cell in _overlapping(cells, low, high):
            asking = _asking(cells, cell, queries, reach)
            if len(asking):
                part = cell, *load(cell)
                part = _near_box(part, queries[asking], reach[asking])
                parts.append(_in_balls(part, queries[asking], reach[asking]))
    return Found(parts)


def as_near_as(cells, load, queries, k, bounds):
    """All points not farther from a query than the k-th nearest of it, and maybe some more.

    Parameters
    ----------
    cells, load, queries
        As of `within_reach`.
    k : int
    bounds : ndarray of shape (m,)
        Distances within which each query has k points; inf is always right.
    """
    reach = SLACK * bounds
    for rows in np.array_split(np.arange(len(queries)), max(1, -(-len(queries) * k // AT_ONCE))):
        reach[rows] = _tightened(cells, load, queries[rows], k, reach[rows])
    return within_reach(cells, load, queries, reach)


def visit_nearest(cells, load, cell, queries, k, work, n_jobs=None):
    """Call ``work(rows, distances, near, found)`` with the k nearest points of each query.

    Parameters
    ----------
    cells, load
        As of `within_reach`.
    cell : int
        Where most of the queries lie.
    queries : ndarray of shape (m, 3)
    k : int
    work : callable
        `near` are rows of the points `found`, which differ from call to call.
    n_jobs : int, default=None
    """
    own = Found([(cell, *load(cell))])
    inside = to_border(queries, cells.low[cell], cells.high[cell])
    far, known, bounds = [np.empty(0, np.intp)], [np.empty((0, k), np.int32)], [np.empty(0)]

    def answer(rows, distances, near):
        rows = np.arange(len(queries))[rows]
        is_near = SLACK * distances[:, -1] < inside[rows]
        work(rows[is_near], distances[is_near], near[is_near], own)
        with lock:
            far.append(rows[~is_near])
            known.append(near[~is_near].astype(np.int32))
            bounds.append(distances[~is_near, -1])

    lock = Lock()
    if len(own.points):
        NearestPoints(own.points).visit(queries, k, answer, n_jobs)
        far, known, bounds = map(np.concatenate, (far, known, bounds))
    else:
        far, known = np.arange(len(queries)), np.zeros((len(queries), k), np.int32)
        bounds = np.full(len(queries), np.inf)

    def answer_far(rows, *found):
        work(far[rows], *found)

    visit_far(cells, load, cell, queries[far], bounds, known, answer_far)


def visit_far(cells, load, cell, queries, bounds, known, work):
    """As `visit_nearest` of those queries whose nearest points may not all be in the cell.

    The nearest points of the cell are its `known` ones (m, k), and `bounds` (m,) the distances of
    the last of these, inf where there are fewer. Returns the rows of these queries.
    """
    inside = to_border(queries, cells.low[cell], cells.high[cell])
    far = np.flatnonzero(~(SLACK * bounds < inside))
    if len(far) >= ORDER_FROM:
        far = far[spatial_order(queries[far])]
    n_parts = -(-len(far) * known.shape[1] // AT_ONCE)
    for some in np.array_split(far, n_parts) if len(far) else []:
        nearest = _Nearest(queries[some], known.shape[1])
        nearest.begin((cell, *load(cell)), known[some], bounds[some])
        nearest.seek(cells, load, cell)
        work(some, np.sqrt(nearest.squares), nearest.numbers(), nearest)
    return far


class _Nearest:
    """The k nearest points of queries, as far as cells were seen.

    Equally distant ones come in the order of their coordinates.

    Attributes
    ----------
    squares : ndarray of shape (m, k)
        Of distances, ascending; inf where there are no more points.
    """

    def __init__(self, queries, k):
        self.queries, self.reach = queries, np.full(len(queries), np.inf)
        self.squares = np.full((len(queries), k), np.inf)
        self.nearest = np.empty((*self.squares.shape, 3))
        self.cells, self.rows = np.zeros((2, *self.squares.shape), np.int32)

    def begin(self, part, known, bounds):
        """Take the points of a cell that are known to be its nearest, where bounds are finite."""
        some = np.flatnonzero(np.isfinite(bounds))
        self._take(part, some, known[some])
        few = np.setdiff1d(np.arange(len(bounds)), some)
        if len(few) and len(part[1]):
            self._see(part, few)

    def seek(self, cells, load, seen):
        """See all other cells than one that may have some, the nearest first."""
        queries = self.queries
        for cell in _by_distance(cells, queries, self.reach):
            asking = _asking(cells, cell, queries, self.reach)
            if len(asking) and cell != seen:
                part = _near_box((cell, *load(cell)), queries[asking], self.reach[asking])
                if len(part[1]):
                    self._see(part, asking)

    def _see(self, part, asking):
        """Search a cell for some queries."""
        k = min(self.squares.shape[1], len(part[1]))
        self._take(part, asking, NearestPoints(part[1]).query(self.queries[asking], k, 1)[1])

    def _take(self, part, asking, near):
        """Take points of a cell, the nearest first, that are nearer than what is known."""
        cell, points, rows = part
        merge = compiled_function("tiling._search_numba", "merge_nearest")
        known = self.squares, self.nearest, self.cells, self.rows
        merge(known, self.queries, asking, near.astype(np.int32), points, rows, cell)
        last = SLACK * np.sqrt(self.squares[asking, -1])
        self.reach[asking] = np.minimum(self.reach[asking], last)

    def numbers(self):
        """Numbers of the nearest points among `places`; as many as these are where none is."""
        numbers = np.arange(self.squares.size).reshape(self.squares.shape)
        return np.where(np.isfinite(self.squares), numbers, self.squares.size)

    @property
    def points(self):
        """As of `Found`."""
        return self.nearest.reshape(-1, 3)

    @property
    def places(self):
        """As of `Found`."""
        return self.cells.ravel(), self.rows.ravel()


def to_border(points, low, high):
    """Distances (m,) of points (m, d) in a box from its border; inf where it has none."""
    return np.minimum(points - low, high - points).min(axis=1)


def _tightened(cells, load, queries, k, reach):
    """Distances of the k-th nearest points of the cloud, from bounds of them."""
    nearest, reach = np.full((len(queries), k), np.inf), reach.copy()
    if not len(queries):
        return reach
    for cell in _by_distance(cells, queries, reach):
        asking = _asking(cells, cell, queries, reach)
        if not len(asking):
            continue
        part = _near_box((cell, *load(cell)), queries[asking], reach[asking])
        if not len(part[1]):
            continue
        distances, _ = NearestPoints(part[1]).query(queries[asking], k, 1)
        both = np.sort(np.hstack([nearest[asking], distances]), axis=1)[:, :k]
        nearest[asking] = both
        reach[asking] = np.minimum(reach[asking], SLACK * both[:, -1])
    return reach


def _by_distance(cells, queries, reach):
    """Cells that may have points for some of the queries, the nearest first."""
    low, high = (queries - reach[:, None]).min(axis=0), (queries + reach[:, None]).max(axis=0)
    near = _overlapping(cells, low, high)
    least, most = cells.extent(near)
    between = np.maximum(least - queries.max(axis=0), queries.min(axis=0) - most)
    return near[np.argsort(np.square(np.maximum(between, 0)).sum(axis=1), kind="stable")]


def _overlapping(cells, low, high):
    """Cells with points between two corners, their numbers."""
    least, most = cells.extent(slice(None))
    return np.flatnonzero(((least <= high) & (most >= low)).all(axis=1))


def _asking(cells, cell, queries, reach):
    """Queries that a cell may have points for."""
    least, most = cells.extent(cell)
    gaps = np.maximum(np.maximum(least - queries, queries - most), 0.0)
    return np.flatnonzero(np.sqrt(np.square(gaps).sum(axis=1)) <= reach)


def _near_box(part, queries, reach):
    cell, points, rows = part
    low, high = (queries - reach[:, None]).min(axis=0), (queries + reach[:, None]).max(axis=0)
    near = ((points >= low) & (points <= high)).all(axis=1)
    return (cell, points, rows) if near.all() else (cell, points[near], rows[near])


def _in_balls(part, queries, reach):
    cell, points, rows = part
    if not len(points) or np.isinf(reach).any():
        return part
    near, tree = np.zeros(len(points), bool), _tree(points)
    for first in range(0, len(queries), ASKED_AT_ONCE):
        some = slice(first, first + ASKED_AT_ONCE)
        found = tree.query_ball_point(queries[some], reach[some], return_sorted=False)
        near[np.concatenate(found).astype(np.intp)] = True
    return cell, points[near], rows[near]


def _tree(points):
    return cKDTree(points, leafsize=LEAF, balanced_tree=False, compact_nodes=False)
