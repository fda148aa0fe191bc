"""Sizes of the neighborhoods of all places, by their noise, in sweeps over cells."""

from functools import partial

import numpy as np

from sklearn_mcmd.normals._adaptive_k import ScaleFinder, SizeLimits, tried_sizes
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.runtime._chunks import each_slice, slices
from sklearn_mcmd.tiling._stored_columns import ALL
from sklearn_mcmd.tiling._stored_index import CHUNK, StoredIndex, StoredNearest
from sklearn_mcmd.tiling._stored_neighbors import StoredNeighbors


def size_steps():
    """The steps of `find_sizes` in their order, as of `Sweeps`, each with a column of its name."""
    return [*(f"scale{k}" for k in tried_sizes(SizeLimits().most)), "settled", "sizes"]


def find_sizes(sweep, job):
    """Fill sizes, the number of neighbors of each place, and starts, where larger has them."""
    whole, before = job.whole(), None
    if whole.columns.is_done(ALL, "numbers"):
        return
    whole.make(across=float, sizes=np.int64, starts=np.int64)
    for step in size_steps():
        whole.make(**{step: float})
        sweep(step, partial(_find, step=step, before=before))
        whole.remove(*filter(None, [before]))
        before = step
    whole.remove("across")
    k, n, largest = StoredNeighbors(whole).k, 0, 0
    for cell in range(whole.n_cells):
        sizes = whole.rows_of("sizes", whole.rows(cell))
        many = np.where(sizes > k, sizes, 0)
        whole.put(cell, starts=n + np.cumsum(many) - many)
        n, largest = n + int(many.sum()), max(largest, int(sizes.max(initial=0)))
    whole.make(max(1, n), larger=np.int32)
    whole.columns.finish(ALL, "numbers", largest=largest)


class CellFinder(ScaleFinder):
    """Finds the sizes of the places of a cell; the `rows` of others around follow its own."""

    def __init__(self, cell, job):
        self._whole, self._cells, self._cell = job.whole(), job.cells, cell
        super().__init__(StoredIndex(self._whole), job.n_threads)
        own, others = self._whole.rows(cell), [np.empty(0, np.int32)]
        for part in slices(own.stop, CHUNK, own.start):
            near = self.index.query_own(part, self.limits.around).indices
            others.append(np.unique(near[(near < own.start) | (near >= own.stop)]))
        own = np.arange(own.start, own.stop)
        self.rows = np.concatenate([own, np.unique(np.concatenate(others))])
        self.n_own, self.n = len(own), len(self.rows)

    def known(self, name):
        """What a column has of the n places."""
        return self._whole.rows_of(name, self.rows)

    def _numbers(self, around):
        near = around.indices - self.rows[:1].astype(np.int32)
        other = (near < 0) | (near >= self.n_own)
        if other.any():
            near[other] = np.searchsorted(self.rows[self.n_own :], around.indices[other])
            near[other] += self.n_own
        return around._replace(indices=near)

    def _each(self, wanted, k, work):
        some = np.flatnonzero(wanted)
        rows = self.rows[some]

        def ask(part):
            work(some[part], self.index.query_own(rows[part], k))

        def keep(part, _, near):
            work(some[part], Neighborhoods(near.astype(np.int32), np.full(len(near), k)))

        if k <= self.index.n_neighbors:
            return each_slice(len(rows), CHUNK, ask, self.n_jobs)
        search, points = StoredNearest(self._whole, self._cells), self.index.points[rows]
        search.visit_in(self._cell, points, k, keep, self.n_jobs)


def _find(cell, job, step, before):
    """Find the columns of a step for the places of a cell."""
    finder, columns = CellFinder(cell, job), job.columns
    wanted = finder.known(before) if before else np.full(finder.n, np.inf)
    found, used = {}, ()
    if step == "sizes":
        found[step] = finder.joined(wanted, finder.known("across"))
    elif step == "settled":
        found[step], found["across"] = finder.settled(wanted), finder.across_rows()
    else:
        k = int(step.removeprefix("scale"))
        used, new = ((f"errors{of}", f"normals{of}") for of in (k, 2 * k))
        known = columns.path(cell, used[-1]).exists()
        fits = tuple(columns.read(cell, name) for name in used) if known else None
        found[step], larger = finder.step(k, wanted, fits)
        if larger and f"scale{2 * k}" in size_steps():
            found |= dict(zip(new, larger, strict=True))
    columns.drop(cell, *used)  # which are found again if need be
    return found
