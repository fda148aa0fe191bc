"""Growth in cells: each finds its links, what leads to other cells is joined, each labels its own.

A place has the region of the first seed from which links lead to it. Of a cell's places only those
from which a link out of it can be reached matter to others.
"""

import numpy as np

from sklearn_mcmd.planes._explaining import leaving
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.segmentation._estimator import numbers_by_size, rules_of
from sklearn_mcmd.segmentation._graph import (
    chained,
    first_seeds,
    grow_regions,
    links_of,
    measure_reach,
    n_linked,
    seed_order,
    strong_parts,
)
from sklearn_mcmd.segmentation._region_sums import region_sizes
from sklearn_mcmd.tiling._joined_parts import JoinedParts, write_parts
from sklearn_mcmd.tiling._stored_index import CHUNK, StoredIndex
from sklearn_mcmd.tiling._stored_offers import FACES

STEPS = "reach", "links", "growth"
# What cells write for each other.
OF_CELLS = "links", "seeds", "grown", "growth_pairs", "growth_roots", "growth_seeds"


def grow_in_cells(sweep, job, memory):
    """Fill labels, by size, of the regions that `grow_regions` finds, once planes are known.

    ``sweep(name, work)`` visits all cells; one process joins what these find.
    """
    whole, cells = job.whole(), np.flatnonzero(job.cells.counts)
    whole.make(counts=np.int32, labels=np.int32, growth_root=np.int32)
    whole.make(floor=float, reach=float, limit=float)
    sweep("reach", _find_reach)
    sweep("links", _find_links)
    whole.columns.once(
        "links", lambda: GrownParts(whole, job.cells, "growth", memory).write_seeds()
    )
    sweep("growth", _grow)
    min_size = job.growing.min_region_size
    whole.columns.once("growth", lambda: _number_regions(whole, cells, min_size))
    whole.remove("limit", "variation", "growth_root")
    for cell in cells:
        whole.columns.drop(cell, *OF_CELLS)


def _index_of(job):
    return StoredIndex(job.whole(), job.cells, job.growing.n_neighbors)


def _order_of(whole, rows):
    """The order of some places as seeds."""
    variation, points = whole.rows_of("variation", rows), whole.rows_of("points", rows)
    planes = Planes.empty(0, 3)._replace(**{name: whole.rows_of(name, rows) for name in FACES})
    return seed_order(variation, points, planes)


def _find_reach(cell, job):
    """Find what growth asks of each place of a cell."""
    whole = job.whole()
    own, rules = whole.rows(cell), rules_of(job.growing)
    floor = job.floor(whole.rows_of("points", own))
    known = _index_of(job), whole.planes(), floor, rules, own
    radius, limit = measure_reach(*known, job.n_threads)
    counts = np.bincount(job.columns.read(cell, "place_of"))
    return {"floor": floor, "reach": radius, "limit": limit, "counts": counts}


def _find_links(cell, job):
    """Write the links of a cell, of each place one bit a neighbor, and its parts that lead out."""
    whole = job.whole()
    own, planes = whole.rows(cell), whole.planes()._replace(radius=whole.open("reach"))
    known = _index_of(job), planes, whole.open("limit"), rules_of(job.growing), own
    links = links_of(*known, job.n_threads)
    bits = np.packbits(links >= 0, axis=1)
    pairs = leaving(links, own.start, own)
    part, between = strong_parts(links)
    del links
    n = int(part.max()) + 1
    ends = np.unique(part[pairs[:, 0] - own.start])
    leads_out = grow_regions(chained(n, between[::-1]), ends)[:n] >= 0
    rows, seeds = np.flatnonzero(leads_out[part]), np.zeros(n, np.int64)
    rows = rows[_order_of(whole, own.start + rows)[::-1]]
    seeds[part[rows]] = own.start + rows  # the first comes last, and stays
    pairs = np.concatenate([pairs, seeds[between[:, leads_out[between[1]]].T]])
    write_parts(whole, cell, "growth", part, pairs, known=leads_out, seeds=seeds)
    return {"links": bits}


class GrownParts(JoinedParts):
    """Parts that lead out of their cells, each with the first seed that leads to it; see there."""

    def _join(self, ends):
        seeds = np.zeros(len(self.roots), np.int64)
        seeds[self._written] = self._read("seeds")
        order = self._written[_order_of(self._whole, seeds[self._written])]
        labels = grow_regions(chained(len(seeds), ends), order)
        self._seeds = seeds[first_seeds(labels, order)[labels[: len(seeds)]]]

    def write_seeds(self):
        """Write for each cell rows, one of each part, and the rows of the seeds of these."""
        for cell in self._cells:
            own = self._whole.rows(cell)
            some = slice(*np.searchsorted(self.roots, [own.start, own.stop]))
            self._whole.columns.write(cell, seeds=np.stack([self.roots[some], self._seeds[some]]))


def _grow(cell, job):
    """Write the regions of a cell's places, and of each the row of its seed and its size.

    A region that lies in this cell alone, and is too small, is none.
    """
    whole, columns, index = job.whole(), job.columns, _index_of(job)
    own, k = whole.rows(cell), n_linked(index, rules_of(job.growing))
    m, (others, seeds) = own.stop - own.start, columns.read(cell, "seeds")
    rows = np.concatenate([np.arange(own.start, own.stop), seeds])
    order = _order_of(whole, rows)
    links, bits = np.full((m + len(seeds), k), -1, np.int32), columns.read(cell, "links")
    for part in slices(m, CHUNK):
        some = slice(own.start + part.start, own.start + part.stop)
        near = index.query_own(some, k).indices
        near[np.unpackbits(bits[part], axis=1, count=k) == 0] = -1
        leaving(near, some.start, own)
        links[part] = near
    links[m:, 0] = others - own.start  # seeds of other cells are places of their own
    labels = grow_regions(links, order)
    found, labels = rows[first_seeds(labels, order)], labels[:m]
    sizes = region_sizes(labels, len(found), whole.rows_of("counts", own))
    kept = (sizes >= job.growing.min_region_size) | (np.isin(found, seeds) & (sizes > 0))
    number = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
    regions = np.stack([found[kept], sizes[kept].astype(np.int64)])
    return {"grown": number[labels].astype(np.int32), "regions": regions}


def _number_regions(whole, cells, min_size):
    """Fill labels with the numbers of regions, in order of size, then of seeds."""
    columns = whole.columns
    regions = [columns.read(cell, "regions") for cell in cells]
    seeds, sizes = np.concatenate(regions, axis=1)
    seeds, of = np.unique(seeds, return_inverse=True)
    order, sizes = _order_of(whole, seeds), np.bincount(of, sizes, len(seeds))
    number = np.empty(len(seeds) + 1, np.int32)
    number[order], number[-1] = numbers_by_size(sizes[order], min_size)[:-1], -1
    ends = np.cumsum([len(part[0]) for part in regions])
    for cell, part in zip(cells, np.split(of, ends[:-1]), strict=True):
        whole.put(cell, labels=number[np.append(part, -1)][columns.read(cell, "grown")])
