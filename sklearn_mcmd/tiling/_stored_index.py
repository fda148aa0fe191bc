"""Neighbors of all places of a cloud, on disk: an index, and exact searches over all cells."""

from functools import reduce
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._indexed_cloud import distinct_rows
from sklearn_mcmd.planes._nearest import COMPILE_FROM, NearestPoints, SelfSearch
from sklearn_mcmd.planes._neighborhoods import NeighborIndex, padded
from sklearn_mcmd.runtime._chunks import ORDER_FROM, each_slice, slices, spatial_order
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._stored_columns import StoredColumns
from sklearn_mcmd.tiling._stored_neighbors import StoredNeighbors

STEP = 1.25  # ratio of numbers of neighbors that are searched at once
CHUNK = 4096  # rows that are asked for at once
# Distances are computed with rounding errors, of about 1e-16 of their size.
SLACK = 1.0 + 1e-12
AT_ONCE = 1_000_000  # distances that are kept at once, what bounds the memory
FAR_AT_ONCE = 8_000_000  # neighbors that are known before other cells are seen
AROUND = 0.95  # share of queries that are searched for once; only the time depends on it


class StoredIndex(NeighborIndex):
    """A `NeighborIndex` of all places, whose neighbors were searched for and stored.

    It has as many neighbors as are stored, by default. If it is sized, their number is the
    largest, and the columns have sizes and what `find_larger` fills. Only searches other than of
    own neighbors need the cells. With ``StoredColumns.column`` it may go to other processes.
    """

    chunk = CHUNK

    def __init__(
        self,
        whole,
        cells=None,
        n_neighbors=None,
        radius=None,
        sized=False,
        n_jobs=None,
        column=StoredColumns.open,
    ):
        self._whole, self._cells = whole, cells
        self.cloud = StoredCloud(whole, cells, n_jobs, column)
        self._near = self.cloud.near
        self._stored = self._near.k
        self.n_neighbors = n_neighbors or self._stored
        self.radius, self.sizes = radius, whole.open("sizes") if sized else None
        self.points = self.cloud.points

    def _query_sized(self, rows, keep):
        sizes = np.array(self.sizes[rows])
        near = np.empty((len(sizes), int(sizes.max(initial=1))), np.int32)
        width = min(near.shape[1], self._stored)
        near[:, :width] = self._near.take(rows, width)
        large = np.flatnonzero(sizes > self._stored)
        starts = self._whole.rows_of("starts", rows)[large, None]
        last = np.minimum(np.arange(near.shape[1]), sizes[large, None] - 1)
        near[large] = self._whole.rows_of("larger", starts + last)
        return padded(near, sizes), sizes

    def in_parts(self):
        """As of `NeighborIndex`."""
        for cell in range(self._whole.n_cells):
            own = self._whole.rows(cell)
            yield np.arange(own.start, own.stop), self._whole.rows_of("points", own)

    def nearest(self, queries, n_jobs=None):
        """As of `NeighborIndex`."""
        return StoredNearest(self._whole, self._cells).query(queries, 1, n_jobs)[1][:, 0]


class StoredCloud:
    """What a `NeighborIndex` asks an `IndexedCloud` for."""

    def __init__(self, whole, cells, n_jobs, column=StoredColumns.open):
        self._whole, self._cells, self._n_jobs = whole, cells, n_jobs
        self.points, self.near = column(whole, "points"), StoredNeighbors(whole)
        self._nearest = None

    def neighbors(self, rows, k, _):
        return self.near.take(rows, k)

    def nearest(self, queries, k):
        if self._nearest is None:
            self._nearest = StoredNearest(self._whole, self._cells)
        return self._nearest.query(queries, k, self._n_jobs)


def find_index(sweep, job, k, least, first=0):
    """Find the places of a job's points, and k neighbors of each; returns their `StoredColumns`, or
    None if there are fewer than `least` places, whose neighbors are not sought. `first` is as of
    `StoredNeighbors.begin`."""
    sweep("places", find_places)
    whole = job.whole()
    if len(whole) < least:
        return None
    join_points(sweep, job)
    StoredNeighbors(whole).begin(k, first)
    sweep("neighbors", find_neighbors)
    return whole


def find_places(cell, job):
    """Find the distinct points of a cell, near ones together, and the place_of each point."""
    points = job.cells.points(cell)
    rows, place_of = distinct_rows(points)
    place_of = np.arange(len(points)) if place_of is None else place_of
    if len(rows) >= COMPILE_FROM:
        found = points[rows]
        in_space = points.shape[1] == 3
        order = SelfSearch(found, overwrite=True).order if in_space else spatial_order(found)
        rows, new = rows[order], np.empty_like(order)
        new[order] = np.arange(len(order))
        place_of = new[place_of]
    return {"points": points[rows], "place_of": place_of.astype(np.int32), "n_places": len(rows)}


def join_points(sweep, job):
    """Put the points of all places into one column; those of the cells are removed."""
    job.whole().make(points=(float, job.cells.low.shape[1:]))
    sweep("joined", _join_points, cells=Cells(job.points))


def _join_points(cell, job):
    columns = job.columns
    if columns.path(cell, "points").exists():  # else an earlier run has put it there
        job.whole().put(cell, points=columns.read(cell, "points"))
    job.cells.free(cell)
    columns.drop(cell, "points")


def find_neighbors(cell, job):
    """Store the nearest of all places, each its own first, as many as are to be stored."""
    cells, whole = job.cells, job.whole()
    points, own, stored = whole.open("points"), whole.rows(cell), StoredNeighbors(whole)
    k = stored.k
    queries, near = np.array(points[own]), np.empty((own.stop - own.start, k), np.int32)
    search = StoredNearest(whole, cells)

    def keep(rows, _, found):
        near[rows] = found - own.start

    if len(queries) >= max(k, COMPILE_FROM) and queries.shape[1] == 3:
        bounds = _search_own(queries, near, job.n_threads)
        search.visit_far(cell, queries, bounds, near, keep)
    else:
        search.visit_in(cell, queries, k, keep)
    near += own.start
    stored.write(cell, near)


def find_larger(cell, job):
    """Fill larger, from `starts` on: the neighbors of places that have more than are stored."""
    whole, cells = job.whole(), job.cells
    own, k = whole.rows(cell), StoredNeighbors(whole).k
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


def _search_own(points, near, n_threads):
    """Fill the neighbors of points among themselves; returns the distances of the last ones."""
    search, k = SelfSearch(points), near.shape[1]
    bounds = np.empty(len(points))

    def task(rows):
        found, own = search.query(rows, k), search.order[rows]
        bounds[own] = search.distances(rows, found[:, -1:], search)[:, 0]
        near[own] = search.order[found]

    each_slice(len(points), CHUNK, task, n_threads)
    return bounds


class StoredNearest(NearestPoints):
    """Some of all places, which answer as `NearestPoints` do; cells are read where they matter.

    A search among places of a cell is that of all if it does not reach the border of the cell's
    box. Else all cells are seen that may have nearer places, one after the other. If only
    some places are meant, ``chosen(cell)`` is a mask of those of a cell.
    """

    def __init__(self, whole, cells, chosen=None):
        self._whole, self._cells, self._chosen = whole, cells, chosen
        self._starts = whole.starts
        if chosen is not None:
            sizes = [np.count_nonzero(chosen(cell)) for cell in range(len(cells))]
            self._starts = np.concatenate([[0], np.cumsum(sizes)])
        self.n, self._last = int(self._starts[-1]), (None, None)  # the cell searched last

    def release(self):
        """As of `NearestPoints`."""
        self._last = None, None

    def without(self, rows):
        """As of `NearestPoints`."""
        rows, whole = np.sort(rows), self._whole

        def chosen(cell):
            own, first = whole.rows(cell), self._starts[cell]
            kept = np.ones(own.stop - own.start, bool)
            kept = kept if self._chosen is None else np.array(self._chosen(cell))
            left, right = np.searchsorted(rows, self._starts[cell : cell + 2])
            kept[np.flatnonzero(kept)[rows[left:right] - first]] = False
            return kept

        return StoredNearest(whole, self._cells, chosen)

    def visit(self, queries, k, work, n_jobs=None):
        """As of `NearestPoints`; it is fastest if near queries come one after another."""
        of = self._cells.of(queries)
        ends = np.concatenate([[0], np.flatnonzero(np.diff(of)) + 1, [len(of)]])
        tasks = [(int(of[a]), slice(a, b)) for a, b in pairwise(ends) if b > a]
        for i, (cell, rows) in enumerate(tasks):  # one after the other, for less memory

            def answer(some, *found, first=rows.start):
                work(first + some, *found)

            with progress_part(i / len(tasks), (i + 1) / len(tasks)):
                self.visit_in(cell, queries[rows], k, answer, n_jobs)

    def visit_in(self, cell, queries, k, work, n_jobs=None):
        """As `visit`, of queries most of which lie in one cell."""
        around = self._around(cell, queries, k, n_jobs)
        inside = self._to_border(cell, queries) + around.width
        for some in slices(len(queries), max(1, FAR_AT_ONCE // k)):
            all_rows = np.arange(some.start, some.stop)
            left = [(np.empty(0, np.intp), np.empty((0, k), np.int32), np.empty(0))]

            def answer(rows, distances, near, all_rows=all_rows, left=left):
                rows = all_rows[rows]
                is_near = SLACK * distances[:, -1] < inside[rows]
                if not is_near.all():
                    known, bounds = near[~is_near].astype(np.int32), distances[~is_near, -1]
                    left.append((rows[~is_near], known, bounds))  # of any thread, in any order
                    rows, distances, near = rows[is_near], distances[is_near], near[is_near]
                work(rows, distances, around.numbers[near])

            around.search.visit(queries[some], k, answer, n_jobs)
            far, known, bounds = map(np.concatenate, zip(*left, strict=True))

            def answer_far(rows, *found, far=far):
                work(far[rows], *found)

            self.visit_far(cell, queries[far], bounds, known, answer_far, around)

    def visit_far(self, cell, queries, bounds, known, work, around=None):
        """As `visit_in` of those queries whose nearest places may not all be `around` the cell, or
        in it by default.

        The nearest of these are the `known` ones (m, k), and `bounds` (m,) the distances of the
        last of them, inf where there are fewer.
        """
        around = self._around(cell) if around is None else around
        inside = self._to_border(cell, queries) + around.width
        far = np.flatnonzero(~(SLACK * bounds < inside))
        if len(far) >= ORDER_FROM:
            far = far[spatial_order(queries[far])]
        n_parts = -(-len(far) * known.shape[1] // AT_ONCE)
        for some in np.array_split(far, n_parts) if len(far) else []:
            work(some, *self._search_all(cell, around, queries[some], bounds[some], known[some]))

    def _search_all(self, cell, around, queries, reach, known):
        """Distances and numbers of the nearest places, of queries as of `visit_far`.

        The nearest of each cell that may have some are put together, and searched once more.
        """
        k, reach = known.shape[1], SLACK * reach
        inner = around.points, around.numbers
        parts = [_chosen(*inner, known) if np.isfinite(reach).all() else inner]
        for other in by_distance(self._cells, queries, reach):
            asked = within_reach(self._cells, other, queries, reach)
            if len(asked) == 0 or other == cell:
                continue
            points, numbers = self._load(other)
            near = near_box(points, queries[asked], reach[asked])
            points, numbers = points[near], numbers[near]
            if around.width:
                beyond = self._to_border(cell, points) <= -around.width
                points, numbers = points[beyond], numbers[beyond]
            if len(points) > k * len(asked):  # else no more than these would be chosen
                distances, near = NearestPoints(points).query(queries[asked], k, 1)
                reach[asked] = np.minimum(reach[asked], SLACK * distances[:, -1])
                points, numbers = _chosen(points, numbers, near)
            parts.append((points, numbers))
        points, numbers = map(np.concatenate, zip(*parts, strict=True))
        distances, near = NearestPoints(points).query(queries, k, 1)
        return distances, np.append(numbers, self.n)[near]

    def _around(self, cell, queries=(), k=0, n_jobs=None):
        """What lies `Around` a cell, as far as most of the queries in it need for their k nearest,
        but no more places of other cells than queries."""
        own, width = self._own(cell), 0.0
        if len(queries) >= ORDER_FROM and len(self._cells) > 1:
            some = queries[:: len(queries) // COMPILE_FROM]
            needs = own.search.query(some, k, n_jobs)[0][:, -1] - self._to_border(cell, some)
            width = max(0.0, np.quantile(needs, AROUND, method="lower"))
        if width == 0.0:
            return own
        outer = own.points[:0], own.numbers[:0]
        least, most = self._cells.extent(slice(None))
        away = np.maximum(least - self._cells.high[cell], self._cells.low[cell] - most).max(axis=1)
        for other in np.argsort(away):
            if other != cell and away[other] < width:
                outer = tuple(map(np.concatenate, zip(outer, self._load(other), strict=True)))
                gaps = -self._to_border(cell, outer[0])
                if len(gaps) > len(queries):
                    width = min(width, np.partition(gaps, len(queries))[len(queries)])
                outer = tuple(part[gaps < width] for part in outer)
        points, numbers = map(np.concatenate, zip(own[:2], outer, strict=True))
        return Around(points, numbers, width, NearestPoints(points))

    def _own(self, cell):
        """The places of a cell, `Around` which nothing is known; those asked last are kept."""
        last, own = self._last
        if last != cell:
            points, numbers = self._load(cell)
            own = Around(points, numbers, 0.0, NearestPoints(points))
            self._last = cell, own
        return own

    def _load(self, cell):
        """The places of a cell, and their numbers among all that are chosen."""
        points = self._whole.rows_of("points", self._whole.rows(cell))
        points = points if self._chosen is None else points[self._chosen(cell)]
        return points, np.arange(self._starts[cell], self._starts[cell + 1])

    def _to_border(self, cell, queries):
        """Distances of points in a cell's box from its border; inf where it has none."""
        low, high = self._cells.low[cell], self._cells.high[cell]
        # Axis by axis takes a third of the time.
        gaps = (np.minimum(x - a, b - x) for x, a, b in zip(queries.T, low, high, strict=True))
        return reduce(np.minimum, gaps)


class Around(NamedTuple):
    """The places of a cell, and all others that are less than some width from its box."""

    points: np.ndarray  # (m, d)
    numbers: np.ndarray  # (m,), among all
    width: float  # along any axis
    search: NearestPoints  # of these


def _chosen(points, numbers, rows):
    """Points and numbers of which some rows are named, each once."""
    chosen = np.zeros(len(points), bool)
    chosen[rows] = True
    return points[chosen], numbers[chosen]


def by_distance(cells, queries, reach):
    """Cells that may have points for some of the queries, the nearest first."""
    low, high = (queries - reach[:, None]).min(axis=0), (queries + reach[:, None]).max(axis=0)
    least, most = cells.extent(slice(None))
    near = np.flatnonzero(((least <= high) & (most >= low)).all(axis=1))
    between = np.maximum(least[near] - queries.max(axis=0), queries.min(axis=0) - most[near])
    return near[np.argsort(np.square(np.maximum(between, 0)).sum(axis=1), kind="stable")]


def within_reach(cells, cell, queries, reach):
    """Queries that a cell may have points for."""
    least, most = cells.extent(cell)
    gaps = np.maximum(np.maximum(least - queries, queries - most), 0.0)
    return np.flatnonzero(np.sqrt(np.square(gaps).sum(axis=1)) <= reach)


def near_box(points, queries, reach):
    """Which points lie in the box of all that is within reach of queries."""
    low, high = (queries - reach[:, None]).min(axis=0), (queries + reach[:, None]).max(axis=0)
    inside = ((x >= a) & (x <= b) for x, a, b in zip(points.T, low, high, strict=True))
    return reduce(np.logical_and, inside)
