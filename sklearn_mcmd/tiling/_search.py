"""Exact searches over all cells, of which only what can matter is read.

A search among points of a cell is that of the whole cloud if it does not reach the border of the
cell's box. Else all points within its reach are collected from all cells, and it is done anew.
"""

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._certificate import SLACK, to_border
from sklearn_mcmd.planes._indexed_cloud import ORDER_FROM, spatial_order
from sklearn_mcmd.planes._nearest import NearestPoints

__all__ = [
    "Found",
    "all_places",
    "around_box",
    "as_near_as",
    "visit_far",
    "visit_nearest",
    "within_reach",
]

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
        self._values = {}

    def values(self, columns, name):
        """The values of a column, which are read once."""
        if name not in self._values:
            self._values[name] = self.after([], columns, name)
        return self._values[name]

    def after(self, before, columns, name):
        """The values of a column behind a list of others."""
        found = (columns.read(cell, name, mmap=True)[rows] for cell, rows in self.parts)
        return np.concatenate([*before, *found])

    @property
    def places(self):
        """The cell of each point, and its row among the places of the cell."""
        cells = [np.full(len(rows), cell) for cell, rows in self.parts]
        rows = [np.empty(0, np.intp), *(rows for _, rows in self.parts)]
        return np.concatenate([rows[0], *cells]), np.concatenate(rows)


def all_places(columns):
    """What loads the points of a cell, and their rows."""

    def load(cell):
        points = columns.read(cell, "points")
        return points, np.arange(len(points))

    return load


def around_box(cells, load, cell, width, most):
    """All points outside a cell and near its box, as by `Cells.around`.

    Parameters
    ----------
    cells : Cells
    load : callable
        Returns the points (n, 3) of a cell that are meant, and their rows among its places.
    cell, width, most
        As of `Cells.around`.

    Returns
    -------
    found : Found
    low, high : ndarray of shape (3,)
    """
    low, high = cells.low[cell] - width, cells.high[cell] + width
    parts = []
    for other in _overlapping(cells, low, high):
        if other == cell:
            continue
        parts.append((other, *load(other)))
        parts = [_inside(part, low, high) for part in parts]
        while sum(len(points) for _, points, _ in parts) > most:
            width /= 2
            low, high = cells.low[cell] - width, cells.high[cell] + width
            parts = [_inside(part, low, high) for part in parts]
    return Found(parts), low, high


def within_reach(cells, load, queries, reach, skip=None):
    """All points within reach of any query, and maybe some more.

    Parameters
    ----------
    cells, load
        As of `around_box`.
    queries : ndarray of shape (m, 3)
    reach : ndarray of shape (m,)
    skip : int, default=None
        A cell whose points are not wanted.

    Returns
    -------
    Found
    """
    parts = []
    if len(queries):
        reach = SLACK * reach
        low, high = (queries - reach[:, None]).min(axis=0), (queries + reach[:, None]).max(axis=0)
        for cell in _overlapping(cells, low, high):
            asking = np.empty(0) if cell == skip else _asking(cells, cell, queries, reach)
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


def visit_nearest(cells, load, cell, queries, k, work):
    """Call ``work(rows, distances, near, found)`` with the k nearest points of each query.

    Parameters
    ----------
    cells, load
        As of `around_box`.
    cell : int
        Where most of the queries lie.
    queries : ndarray of shape (m, 3)
    k : int
    work : callable
        `near` are rows of the points `found`, which differ from call to call.

    Returns
    -------
    n_far : int
        Queries whose nearest points are not all in the cell.
    """
    own = Found([(cell, *load(cell))])
    inside = to_border(queries, cells.low[cell], cells.high[cell])
    bounds = np.full(len(queries), np.inf)

    def answer(rows, distances, near):
        bounds[rows] = distances[:, -1]
        near_ones = np.flatnonzero(SLACK * distances[:, -1] < inside[rows])
        rows = np.arange(len(queries))[rows]
        work(rows[near_ones], distances[near_ones], near[near_ones], own)

    if len(own.points):
        NearestPoints(own.points).visit(queries, k, answer)
    return visit_far(cells, load, cell, queries, k, bounds, work)


def visit_far(cells, load, cell, queries, k, bounds, work):
    """As `visit_nearest` of those queries whose nearest points may not all be in the cell.

    The distances of the k nearest points of the cell are `bounds` (m,), inf where there are fewer.
    """
    inside = to_border(queries, cells.low[cell], cells.high[cell])
    far = np.flatnonzero(~(SLACK * bounds < inside))
    if len(far) >= ORDER_FROM:
        far = far[spatial_order(queries[far])]
    n_parts = -(-len(far) * k // (4 * AT_ONCE))
    for some in np.array_split(far, n_parts) if len(far) else []:
        found = as_near_as(cells, load, queries[some], k, bounds[some])

        def answer_far(rows, distances, near, some=some, found=found):
            work(some[rows], distances, near, found)

        NearestPoints(found.points).visit(queries[some], k, answer_far)
    return len(far)


def _tightened(cells, load, queries, k, reach):
    """Distances of the k-th nearest points of the cloud, from bounds of them."""
    nearest, reach = np.full((len(queries), k), np.inf), reach.copy()
    if not len(queries):
        return reach
    low, high = (queries - reach[:, None]).min(axis=0), (queries + reach[:, None]).max(axis=0)
    near = _overlapping(cells, low, high)
    least, most = cells.extent(near)
    between = np.maximum(least - queries.max(axis=0), queries.min(axis=0) - most)
    for cell in near[np.argsort(np.square(np.maximum(between, 0)).sum(axis=1), kind="stable")]:
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


def _inside(part, low, high):
    cell, points, rows = part
    near = ((points >= low) & (points < high)).all(axis=1)
    return cell, points[near], rows[near]


def _tree(points):
    return cKDTree(points, leafsize=LEAF, balanced_tree=False, compact_nodes=False)
