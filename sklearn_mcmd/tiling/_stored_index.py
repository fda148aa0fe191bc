"""Neighbors of all places of a cloud, on disk: an index and searches of what lies in cells."""

import numpy as np

from sklearn_mcmd.planes._around import extents
from sklearn_mcmd.planes._indexed_cloud import distinct_rows
from sklearn_mcmd.planes._nearest import COMPILE_FROM, SelfSearch
from sklearn_mcmd.planes._neighborhoods import NeighborIndex, padded, within_radius
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.runtime._chunks import ORDER_FROM, each_slice, slices, spatial_order
from sklearn_mcmd.tiling._search import StoredNearest

STEP = 1.25  # ratio of numbers of neighbors that are searched at once
CHUNK = 4096  # rows that are asked for at once


class StoredIndex:
    """A `NeighborIndex` of all places, whose neighbors were searched for and stored.

    It has as many neighbors as the column near, by default. If it is sized, their number is the
    largest, and the columns have sizes and what `find_larger` fills. Only searches other than of
    own neighbors need the cells.
    """

    chunk = CHUNK

    def __init__(self, whole, cells=None, n_neighbors=None, radius=None, sized=False):
        self._whole, self._cells, self.points = whole, cells, whole.open("points")
        self._stored = whole.open("near").shape[1]
        self.n_neighbors = n_neighbors or self._stored
        self.radius, self.sizes = radius, whole.open("sizes") if sized else None

    def query_own(self, rows, k=None, keep=True):
        """As of `NeighborIndex`, of a slice or an array of rows."""
        if k is None and self.sizes is not None:
            sizes = np.array(self.sizes[rows])
            near = padded(self._sized(rows, sizes), sizes)
        else:
            k = self.n_neighbors if k is None else k
            if k > self._stored:
                raise ValueError(f"k={k} is more than the {self._stored} neighbors that are stored")
            near = np.ascontiguousarray(self._whole.rows_of("near", rows)[:, :k])
            sizes = np.full(len(near), k)
        if self.radius is None:
            return Neighborhoods(near, sizes)
        distances = np.linalg.norm(self.points[near] - self.points[rows][:, None], axis=2)
        return within_radius(near, distances, sizes, self.radius, 3)

    def all_own(self):
        """The neighborhoods of all places, on disk."""
        near = self._whole.open("near")
        if near.shape[1] > self.n_neighbors:
            near = self.empty((len(near), self.n_neighbors), np.int32)
            for rows in slices(len(near), CHUNK):
                near[rows] = self._whole.rows_of("near", rows)[:, : self.n_neighbors]
        return Neighborhoods(near, np.full(len(near), self.n_neighbors))

    def _sized(self, rows, sizes):
        """Neighbors as many as the largest of the sizes."""
        stored = self._whole.rows_of("near", rows)
        near = np.empty((len(sizes), int(sizes.max(initial=1))), np.int32)
        width = min(near.shape[1], stored.shape[1])
        near[:, :width] = stored[:, :width]
        large = np.flatnonzero(sizes > stored.shape[1])
        starts = self._whole.rows_of("starts", rows)[large, None]
        last = np.minimum(np.arange(near.shape[1]), sizes[large, None] - 1)
        near[large] = self._whole.rows_of("larger", starts + last)
        return near

    def visit_own(self, wanted, k, work, n_jobs=None):
        """As of `NeighborIndex`."""
        if k <= self._stored:
            return NeighborIndex.visit_own(self, wanted, k, work, n_jobs)
        rows = np.flatnonzero(wanted)

        def found(some, _, near):
            work(rows[some], Neighborhoods(near.astype(np.int32), np.full(len(near), k)))

        self.among(None).visit(self.points[rows], k, found, n_jobs)

    def among(self, chosen):
        """As of `NeighborIndex`; of all places with None."""
        return StoredNearest(self._whole, self._cells, chosen)

    def query(self, queries, n_jobs=None):
        """As of `NeighborIndex`; it is fastest of all queries at once."""
        sizes = np.full(len(queries), self.n_neighbors)
        if self.sizes is not None:
            sizes = self.sizes[self.nearest(queries, n_jobs)]
        distances, near = self.among(None).query(queries, int(sizes.max(initial=1)), n_jobs)
        if self.radius is None:
            return Neighborhoods(padded(near, sizes), sizes)
        return within_radius(near, distances, sizes, self.radius, 3)

    def nearest(self, queries, n_jobs=None):
        """As of `NeighborIndex`."""
        return self.among(None).query(queries, 1, n_jobs)[1][:, 0]

    def empty(self, shape, dtype=np.float64):
        """As of `NeighborIndex`, on disk."""
        return self._whole.scratch(shape, dtype)


def find_places(cell, job):
    """Write the distinct points of a cell, near ones together, and what belongs to each.

    Columns: points; counts, of copies of each; place_of, the place of each point of the cell.
    """
    columns, points = job.columns, job.cells.read(cell)["xyz"]
    rows, place_of = distinct_rows(points)
    place_of = np.arange(len(points)) if place_of is None else place_of
    if len(rows) >= ORDER_FROM:
        order = spatial_order(points[rows])
        rows, new = rows[order], np.empty_like(order)
        new[order] = np.arange(len(order))
        place_of = new[place_of]
    counts = np.bincount(place_of, minlength=len(rows)).astype(np.int32)
    columns.write(cell, points=points[rows], counts=counts, place_of=place_of.astype(np.int32))
    columns.finish(cell, "places", n_places=len(rows))


def find_neighbors(cell, job):
    """Fill near, the nearest of all places, each its own first, as many as the column holds."""
    cells, columns, whole = job.cells, job.columns, job.whole()
    points, own, k = whole.open("points"), whole.rows(cell), whole.open("near").shape[1]
    queries, near = np.array(points[own]), np.empty((own.stop - own.start, k), np.int32)
    search = StoredNearest(whole, cells)

    def keep(rows, _, found):
        near[rows] = found

    if len(queries) >= max(k, COMPILE_FROM):
        bounds = _search_own(queries, near, job.n_threads)
        inside = np.ones(len(near), bool)
        inside[search.visit_far(cell, queries, bounds, near, keep)] = False
        near[inside] += own.start
    else:
        search.visit_in(cell, queries, k, keep)
    whole.put(cell, near=near)
    columns.finish(cell, "neighbors")


def find_larger(cell, job):
    """Fill larger, from `starts` on: the neighbors of places that have more than near holds."""
    cells, columns, whole = job.cells, job.columns, job.whole()
    own, k = whole.rows(cell), whole.open("near").shape[1]
    sizes, points = whole.rows_of("sizes", own), whole.open("points")
    starts = whole.rows_of("starts", own)
    first, larger = int(starts[0]), np.empty(int(sizes[sizes > k].sum()), np.int32)
    while k < sizes.max():
        before, k = k, min(int(STEP * k), int(sizes.max()))
        some = np.flatnonzero((sizes > before) & (sizes <= k))

        def keep(part, _, near, some=some, k=k):
            rows = some[part]
            inside = np.arange(k) < sizes[rows, None]
            larger[(starts[rows, None] - first + np.arange(k))[inside]] = near[inside]

        StoredNearest(whole, cells).visit_in(cell, points[own.start + some], k, keep)
    whole.write("larger", first, larger)
    columns.finish(cell, "larger")


def _search_own(points, near, n_threads):
    """Fill the neighbors of points among themselves; returns the distances of the last ones.

    It takes half of the time of a search among any points.
    """
    search, k = SelfSearch(points), near.shape[1]
    bounds = np.empty(len(points))

    def task(rows):
        found = Neighborhoods(search.query(rows, k), np.full(rows.stop - rows.start, k))
        own = search.order[rows]
        bounds[own] = extents(search.points, search.points[rows], found)[1]
        near[own] = search.order[found.indices]

    each_slice(len(points), CHUNK, task, n_threads)
    return bounds
