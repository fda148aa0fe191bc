"""Exact searches over all cells, of which only what can matter is read."""

from itertools import pairwise

import numpy as np

from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.runtime._chunks import ORDER_FROM, slices, spatial_order
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.runtime._progress import progress_part

# Distances are computed with rounding errors, of about 1e-16 of their size.
SLACK = 1.0 + 1e-12
AT_ONCE = 1_000_000  # distances that are kept at once, what bounds the memory
FAR_AT_ONCE = 8_000_000  # neighbors that are known before other cells are seen


class StoredNearest(NearestPoints):
    """Some of all places, which answer as `NearestPoints` do; cells are read where they matter.

    A search among places of a cell is that of all if it does not reach the border of the cell's
    box. Else all cells are seen that may have nearer places, one after the other. `chosen` is a
    mask of all places.
    """

    def __init__(self, whole, cells, chosen=None):
        self._whole, self._cells, self._chosen = whole, cells, chosen
        self._points, self._starts = whole.open("points"), whole.starts
        if chosen is not None:
            sizes = [np.count_nonzero(chosen[whole.rows(cell)]) for cell in range(len(cells))]
            self._starts = np.concatenate([[0], np.cumsum(sizes)])
        self.n = int(self._starts[-1])

    def visit(self, queries, k, work, n_jobs=None):
        """As of `NearestPoints`; it is fastest if near queries come one after another."""
        tasks = self._by_cell(queries)
        for i, (cell, rows) in enumerate(tasks):  # one after the other, for less memory

            def answer(some, *found, first=rows.start):
                work(first + some, *found)

            with progress_part(i / len(tasks), (i + 1) / len(tasks)):
                self.visit_in(cell, queries[rows], k, answer, n_jobs)

    def visit_in(self, cell, queries, k, work, n_jobs=None):
        """As `visit`, of queries most of which lie in one cell."""
        (points, numbers), inside = self._load(cell), self._to_border(cell, queries)
        search = NearestPoints(points)
        for some in slices(len(queries), max(1, FAR_AT_ONCE // k)):
            all_rows = np.arange(some.start, some.stop)
            left = [(np.empty(0, np.intp), np.empty((0, k), np.int32), np.empty(0))]

            def answer(rows, distances, near, all_rows=all_rows, left=left):
                rows = all_rows[rows]
                is_near = SLACK * distances[:, -1] < inside[rows]
                work(rows[is_near], distances[is_near], numbers[near[is_near]])
                known, bounds = near[~is_near].astype(np.int32), distances[~is_near, -1]
                left.append((rows[~is_near], known, bounds))  # of any thread, in any order

            search.visit(queries[some], k, answer, n_jobs)
            far, known, bounds = map(np.concatenate, zip(*left, strict=True))

            def answer_far(rows, *found, far=far):
                work(far[rows], *found)

            self.visit_far(cell, queries[far], bounds, known, answer_far)

    def visit_far(self, cell, queries, bounds, known, work):
        """As `visit_in` of those queries whose nearest places may not all be in the cell.

        The nearest of the cell are its `known` ones (m, k), and `bounds` (m,) the distances of
        the last of these, inf where there are fewer. Returns the rows of these queries.
        """
        far = np.flatnonzero(~(SLACK * bounds < self._to_border(cell, queries)))
        if len(far) >= ORDER_FROM:
            far = far[spatial_order(queries[far])]
        n_parts = -(-len(far) * known.shape[1] // AT_ONCE)
        for some in np.array_split(far, n_parts) if len(far) else []:
            nearest = _Nearest(queries[some], known.shape[1], self.n)
            is_whole = np.isfinite(bounds[some])
            own = self._load(cell)
            nearest.take(*own, np.flatnonzero(is_whole), known[some[is_whole]])
            nearest.see(*own, np.flatnonzero(~is_whole))
            for other in by_distance(self._cells, nearest.queries, nearest.reach):
                asked = within_reach(self._cells, other, nearest.queries, nearest.reach)
                if len(asked) and other != cell:
                    points, numbers = self._load(other)
                    near = near_box(points, nearest.queries[asked], nearest.reach[asked])
                    nearest.see(points[near], numbers[near], asked)
            work(some, np.sqrt(nearest.squares), nearest.numbers)
        return far

    def _load(self, cell):
        """The places of a cell, and their numbers among all that are chosen."""
        rows = self._whole.rows(cell)
        points = self._points[rows]
        points = np.array(points) if self._chosen is None else points[self._chosen[rows]]
        return points, np.arange(self._starts[cell], self._starts[cell + 1])

    def _to_border(self, cell, queries):
        """Distances of points in a cell's box from its border; inf where it has none."""
        low, high = self._cells.low[cell], self._cells.high[cell]
        return np.minimum(queries - low, high - queries).min(axis=1)

    def _by_cell(self, queries):
        """Cells and slices of the queries that lie in them."""
        of = self._cells.of(queries)
        ends = np.concatenate([[0], np.flatnonzero(np.diff(of)) + 1, [len(of)]])
        return [(int(of[a]), slice(a, b)) for a, b in pairwise(ends) if b > a]


class _Nearest:
    """The k nearest points of queries, as far as cells were seen.

    Equally distant ones come in the order of their coordinates. Where there are no more points,
    squares are inf, and numbers `nothing`.
    """

    def __init__(self, queries, k, nothing):
        self.queries, self.reach = queries, np.full(len(queries), np.inf)
        self.squares = np.full((len(queries), k), np.inf)
        self.points = np.empty((*self.squares.shape, 3))
        self.numbers = np.full(self.squares.shape, nothing)

    def see(self, points, numbers, asked):
        """Search points for some queries."""
        if len(points) and len(asked):
            k = min(self.squares.shape[1], len(points))
            near = NearestPoints(points).query(self.queries[asked], k, 1)[1]
            self.take(points, numbers, asked, near)

    def take(self, points, numbers, asked, near):
        """Take points, the nearest first, that are nearer than what is known."""
        merge = compiled_function("tiling._search_numba", "merge_nearest")
        known = self.squares, self.points, self.numbers
        merge(known, self.queries, asked, near.astype(np.int32), points, numbers)
        last = SLACK * np.sqrt(self.squares[asked, -1])
        self.reach[asked] = np.minimum(self.reach[asked], last)


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
    return ((points >= low) & (points <= high)).all(axis=1)
