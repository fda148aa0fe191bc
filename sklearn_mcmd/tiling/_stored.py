"""Neighbors of all places of a cloud, on disk: an index and searches of what lies in cells."""

from itertools import pairwise

import numpy as np

from sklearn_mcmd.planes._chunks import run
from sklearn_mcmd.planes._indexed_cloud import (
    COMPILE_FROM,
    ORDER_FROM,
    distinct_rows,
    spatial_order,
)
from sklearn_mcmd.planes._linking import farthest_neighbors
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.planes._self_search import SelfSearch
from sklearn_mcmd.tiling._search import visit_far, visit_nearest

__all__ = [
    "OwnNeighbors",
    "StoredIndex",
    "StoredNearest",
    "chunks_of",
    "find_places",
    "nearest_rows",
    "places_of_cell",
]

CHUNK = 4096  # rows that are asked for at once
TOLD_APART = 2**16  # queries whose cells are found at once


class StoredIndex:
    """A `NeighborIndex` of all places, whose neighbors were searched for and stored.

    Parameters
    ----------
    whole : WholeColumns
        With the columns points and near.
    cells : Cells, default=None
        Those of the columns, which `among` searches.
    """

    chunk = CHUNK

    def __init__(self, whole, cells=None):
        self._whole, self._cells, self.points = whole, cells, whole.open("points")
        self.n_neighbors = whole.open("near").shape[1]

    def query_own(self, rows, k=None, keep=True):
        """As of `NeighborIndex`."""
        k = self.n_neighbors if k is None else k
        near = np.ascontiguousarray(self._near(rows, k))
        return Neighborhoods(near, np.full(len(near), k))

    def among(self, chosen):
        """As of `NeighborIndex`."""
        return StoredNearest(self._whole, self._cells, chosen)

    def search(self, queries, n_jobs=None):
        """The `Neighborhoods` of other points."""
        near = self.among(np.ones(len(self.points), bool)).query(queries, self.n_neighbors, n_jobs)
        return Neighborhoods(near[1], np.full(len(queries), self.n_neighbors))

    def empty(self, shape, dtype=np.float64):
        """As of `NeighborIndex`, on disk."""
        return self._whole.scratch(shape, dtype)

    def _near(self, rows, k):
        return self._whole.rows_of("near", rows)[:, :k]


class OwnNeighbors(StoredIndex):
    """The index of a cell's places before the neighbors of all are known."""

    def __init__(self, points, near, start):
        self.points, self._own, self._start = points, near, start
        self.n_neighbors = near.shape[1]

    def _near(self, rows, k):
        return self._own[rows.start - self._start : rows.stop - self._start, :k]


class StoredNearest(NearestPoints):
    """Some of all places, which answer as `NearestPoints` do; cells are read where they matter.

    Parameters
    ----------
    whole : WholeColumns
    cells : Cells
    chosen : ndarray of bool of shape (n,)
    """

    def __init__(self, whole, cells, chosen):
        self._whole, self._cells, self._chosen = whole, cells, chosen
        self._points = whole.open("points")
        sizes = [np.count_nonzero(chosen[whole.rows(cell)]) for cell in range(len(cells))]
        self._starts = np.concatenate([[0], np.cumsum(sizes)])
        self.n = int(self._starts[-1])

    def visit(self, queries, k, work, n_jobs=None):
        """As of `NearestPoints`; it is fastest if near queries come one after another."""

        def ask(cell, rows):
            known = None, None

            def answer(some, distances, near, found):
                nonlocal known
                if known[0] is not found:
                    cells, places = found.places
                    known = found, np.append(self._starts[cells.astype(np.intp)] + places, self.n)
                work(rows.start + some, distances, known[1][near])

            visit_nearest(self._cells, self._load, cell, queries[rows], k, answer)

        run(self._by_cell(queries), ask, n_jobs, told=True)

    def _load(self, cell):
        rows = self._whole.rows(cell)
        points = self._points[rows][self._chosen[rows]]
        return points, np.arange(len(points))

    def _by_cell(self, queries):
        """Cells and slices of the queries that lie in them."""
        cells, of = self._cells, np.zeros(len(queries), np.int32)
        for first in range(0, len(queries), TOLD_APART):
            part = queries[first : first + TOLD_APART]
            low, high = part.min(axis=0), part.max(axis=0)
            for cell in np.flatnonzero(((cells.low <= high) & (cells.high > low)).all(axis=1)):
                inside = ((part >= cells.low[cell]) & (part < cells.high[cell])).all(axis=1)
                of[first : first + TOLD_APART][inside] = cell
        ends = np.concatenate([[0], np.flatnonzero(np.diff(of)) + 1, [len(of)]])
        return [(int(of[a]), slice(a, b)) for a, b in pairwise(ends) if b > a]


def find_places(cell, job):
    """Write the distinct points of a cell, near ones together, and what belongs to each.

    Columns: points; first_rows, the first row of each; counts, of its copies; place_of, the place
    of each point of the cell.
    """
    cells, columns = job.open()
    points = cells.read(cell)["xyz"]
    rows, place_of = places_of_cell(points)
    counts = np.bincount(place_of, minlength=len(rows)).astype(np.int32)
    columns.write(
        cell, points=points[rows], first_rows=rows.astype(np.int32), counts=counts,
        place_of=place_of.astype(np.int32),
    )  # fmt: skip
    columns.finish(cell, "places", n_places=len(rows))


def places_of_cell(points):
    """Rows of the distinct points of a cell, near ones together, and the place of each point."""
    rows, place_of = distinct_rows(points)
    place_of = np.arange(len(points)) if place_of is None else place_of
    if len(rows) >= ORDER_FROM:
        order = spatial_order(points[rows])
        rows, new = rows[order], np.empty_like(order)
        new[order] = np.arange(len(order))
        place_of = new[place_of]
    return rows, place_of


def nearest_rows(cells, whole, cell, k):
    """Rows of the k nearest of all places (n, k) of each place of a cell.

    Also how many have some of them in other cells.
    """
    points, own = whole.open("points"), whole.rows(cell)
    near = np.empty((own.stop - own.start, k), np.int32)

    def load(other):
        some = np.array(points[whole.rows(other)])
        return some, np.arange(len(some))

    rows_of = {}

    def keep(rows, _, found_near, found):
        if rows_of.get("of") is not found:  # they come one after the other
            there, places = found.places
            rows_of.update(of=found, rows=whole.starts[there.astype(np.intp)] + places)
        near[rows] = rows_of["rows"][found_near]

    queries = np.array(points[own])
    if len(queries) >= max(k, COMPILE_FROM):
        bounds = _search_own(queries, near, own.start)
        n_far = visit_far(cells, load, cell, queries, k, bounds, keep)
    else:
        n_far = visit_nearest(cells, load, cell, queries, k, keep)
    return near, n_far


def _search_own(points, near, start):
    """Fill the neighbors of points among themselves; returns the distances of the last ones.

    It takes half of the time of a search among any points.
    """
    search, k = SelfSearch(points), near.shape[1]
    bounds = np.empty(len(points))
    for rows in chunks_of(slice(0, len(points))):
        found = Neighborhoods(search.query(rows, k), np.full(rows.stop - rows.start, k))
        own = search.order[rows]
        bounds[own] = farthest_neighbors(search.points, found, rows.start)
        near[own] = start + search.order[found.indices]
    return bounds


def chunks_of(rows):
    """Slices of a slice."""
    starts = range(rows.start, rows.stop, CHUNK)
    return [slice(start, min(start + CHUNK, rows.stop)) for start in starts]
