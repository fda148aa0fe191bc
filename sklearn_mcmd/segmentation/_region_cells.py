"""Small cells of regions, gathered of neighbors, and how they are joined to patches.

Whatever is gathered or joined is known by names: the points at which it begins.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import quantile_around, ratio
from sklearn_mcmd.runtime._chunks import each_part, slices
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.segmentation._cylinder_parts import FitLimits
from sklearn_mcmd.segmentation._graph import HEIGHT_BITS, GrowthLimits, n_linked
from sklearn_mcmd.segmentation._region_sums import median_by_region, region_moments

UPPER = [0, 1, 2, 4, 5, 8]  # places of the six numbers of a symmetric matrix in its nine
WHOLE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # and the reverse
PAIRS = 2**20  # of cells that are named at once; it limits the memory
ROWS = 2**14  # whose neighbors are looked at at once; it limits the memory
NO_KEYS = np.empty(0, np.int64)
PLACE_BITS = 20  # of a place, as a share of the extent, by which equally flat points are scrambled
SCRAMBLING = 0x9E3779B97F4A7C15  # an odd number without a pattern, as of Fibonacci hashing


class Sums(NamedTuple):
    """What is known of cells, or of patches, in units of noise; scatters are the upper halves."""

    sizes: np.ndarray
    weights: np.ndarray
    means: np.ndarray  # (m, 3)
    scatters: np.ndarray  # (m, 6)


class Points:
    """The points whose regions are divided, in memory or on disk; a step takes some of their rows.

    `noise` (n,) is what `usual_noise` finds, and `cell` (n,), int32, names the cell of each point
    by the point at which it begins; -1 for none.
    """

    def __init__(self, index, planes, rules, labels, noise, cell, n_jobs=None):
        self.index, self.planes, self.labels, self.n_jobs = index, planes, labels, n_jobs
        self.noise, self.cell, self.size = noise, cell, n_linked(index, rules)
        self.bend = GrowthLimits().bent * np.arccos(min(rules.min_cosine, 1.0))
        self.unit, self.low, self.extent = 1.0, np.zeros(3), 1.0

    def usual_noise(self, own):
        """Standard deviation that is usual around the points of a slice."""
        usual = np.empty(own.stop - own.start)

        def measure(rows, part):
            around = self.index.query_own(rows, self.size)
            found = quantile_around(self.planes.scale, around, GrowthLimits().usual)
            usual[part] = np.hypot(found, self.bend * self.planes.radius[rows])

        each_part(own, self.index.chunk, measure, self.n_jobs)
        return usual

    def scale(self, least, most, low, high):
        """Choose units, by the least and most noise and two corners; whether there are any."""
        self.unit = float(np.exp2(np.frexp(most)[1]))  # no square leaves the numbers
        self.low, self.extent = low, np.max(high - low) or 1.0
        return least * self.unit > 0

    def noise_of(self, rows):
        """The noise of some points in the unit."""
        return np.maximum(self.noise[rows] / self.unit, FitLimits().ridge)

    def in_order(self, rows):
        """The flattest come first. Their order depends on no rounding error, and on no rows.

        Those that are as flat come scrambled: in the order of coordinates, each cell of an exact
        plane would depend on the one before, from end to end, however many tiles these cross.
        """
        flatness = ratio(self.planes.scale[rows] / self.unit, self.noise_of(rows))
        flatness, points = np.rint(np.ldexp(flatness, HEIGHT_BITS)), self.index.points[rows]
        chance = scrambled(np.rint(np.ldexp((points - self.low) / self.extent, PLACE_BITS)))
        order = np.lexsort((chance, flatness))
        same = (np.diff(flatness[order]) == 0) & (np.diff(chance[order]) == 0)
        tied = np.flatnonzero(np.append(same, False) | np.append(False, same))
        equal = order[tied]
        order[tied] = equal[np.lexsort((*points[equal].T, chance[equal], flatness[equal]))]
        return order

    def gather(self, own, beside=NO_KEYS):
        """The points (m,) at which the cells of those of a slice begin, as of `gather`; -1 or less
        for none, or as long as nobody knows.

        `beside` are `keys` of points of the slice, each with one from elsewhere in whose cell it
        would be.
        """
        n, k = own.stop - own.start, self.size
        lists = np.empty(n * k + len(beside), np.int32)
        near = lists[: n * k].reshape(n, k)

        def find(rows, part):
            near[part] = self.near(rows)

        each_part(own, self.index.chunk, find, self.n_jobs)
        near -= own.start
        names = np.arange(own.start, own.stop, dtype=np.int32)
        return self._gathered(names, k * np.arange(n + 1), lists, pairs_of(beside), self.cell)

    def gather_blocks(self, names, beside, known):
        """The blocks (m,) of some cells, or of smaller blocks, by their names, which ascend; as of
        `gather`.

        `beside` are `keys` of these and of those beside them. What an earlier call has found is
        `known` (n,) at the points that name them; -1 of what none has.
        """
        pairs = pairs_of(beside)
        at = np.searchsorted(names, pairs[:, 1])
        inside = np.append(names, -1)[at] == pairs[:, 1]
        lists = np.concatenate([at[inside], np.zeros(np.count_nonzero(~inside))]).astype(np.int32)
        starts = np.append(np.searchsorted(pairs[inside, 0], names), np.count_nonzero(inside))
        return self._gathered(names, starts, lists, pairs[~inside], known)

    def _gathered(self, names, starts, lists, links, known):
        """The groups (m,) of nodes, by their names, which ascend and are rows of points.

        The list of node i is lists[starts[i] : starts[i + 1]]; behind all there is room for links.
        A link is a node and one from elsewhere that has it in its list. What an earlier call has
        found is `known`, by name.
        """
        links = links[np.argsort(links[:, 1], kind="stable")]
        group = known[links[:, 1]]  # once: other processes fill it meanwhile
        may_begin = (group == links[:, 1]) | (group == -1)
        links, group = links[may_begin], group[may_begin]
        rivals, begins = np.unique(links[:, 1], return_index=True)
        unsure = np.append(np.zeros(len(names)), group[begins] == -1).astype(np.int8)
        end = int(starts[-1])
        lists[end : end + len(links)] = np.searchsorted(names, links[:, 0])
        starts = np.concatenate([starts[:-1], end + np.append(begins, len(links))])
        names, first = np.concatenate([names, rivals]), np.array(known[names])
        labels = np.array(self.labels[names])
        order = np.flatnonzero(labels >= 0)
        order = order[self.in_order(names[order])]
        _compiled("gather")(order, starts, lists, labels, names, first, unsure)
        return first

    def near(self, rows):
        """The neighbors of some points that may be in their cells."""
        return self.index.query_own(rows, self.size).indices

    def members(self, begins):
        """Rows of the points of the cells that begin at some points, and how many each has."""
        near = self.near(begins)
        own = self.cell[near] == begins[:, None]
        return near[own], own.sum(axis=1)

    def sums(self, begins):
        """The `Sums` of the cells that begin at some points."""
        n, parts = len(begins), [self.members(begins[some]) for some in slices(len(begins), ROWS)]
        rows, sizes = map(np.concatenate, zip(*parts, strict=True))
        of = np.repeat(np.arange(n, dtype=np.int32), sizes)
        found = region_moments(self.index.points[rows], of, n, n_jobs=self.n_jobs)
        weights = found.sizes / np.square(median_by_region(self.noise_of(rows), of, n))
        return Sums(
            sizes=found.sizes,
            weights=weights,
            means=(found.centroids - self.low) / self.unit,
            scatters=found.covariances.reshape(-1, 9)[:, UPPER] * (weights / self.unit**2)[:, None],
        )

    def beside(self, own):
        """`keys` of cells of one region: a point of a slice has a neighbor in the other."""
        found = []
        for rows in slices(own.stop, ROWS, own.start):
            near = self.near(rows)
            cell, other = self.cell[rows, None], self.cell[near]
            beside = (self.labels[near] == self.labels[rows, None]) & (other != cell) & (cell >= 0)
            cell = np.broadcast_to(cell, near.shape)
            found.append(keys(np.column_stack([cell[beside], other[beside]])))
        return once(found)

    def joined(self, begins, sums, beside):
        """Cells, or patches, joined to patches, as of `joined`: where these begin, in order, the
        patch (m,) of each, and the `Sums`; `beside` are `keys` of them."""
        order = self.in_order(begins)
        number = np.empty_like(order)
        number[order] = np.arange(len(order))
        pairs = number[places(begins, pairs_of(beside))]
        edges = pairs[pairs[:, 0] < pairs[:, 1]]
        first, patch, sums = joined(Sums(*(values[order] for values in sums)), edges)
        return begins[order[first]], patch[number], sums


def keys(pairs):
    """Numbers of 64 bits, ascending, that stand for pairs (m, 2) of different names, both ways."""
    pairs = pairs[pairs[:, 0] != pairs[:, 1]].astype(np.int64)
    return np.unique(pairs << 32 | pairs[:, ::-1])


def once(parts):
    """The numbers of all parts, each once; they ascend."""
    return np.unique(np.concatenate([*parts, NO_KEYS]))


def pairs_of(keys):
    """The pairs, int32 (m, 2), for which keys stand."""
    return np.column_stack([(keys >> 32).astype(np.int32), keys.astype(np.int32)])


def named(keys_before, name):
    """`keys` by other names, which a function has for an array of those before."""
    rows = slices(len(keys_before), PAIRS)
    return once([keys(name(pairs_of(keys_before[part]))) for part in rows])


def places(names, wanted):
    """Where the wanted ones are among all names."""
    order = np.argsort(names)
    return order[np.searchsorted(names, wanted, sorter=order)]


def scrambled(places):
    """A number by each row of whole numbers (m, d), which grows in no direction."""
    found = np.zeros(len(places), np.uint64)
    for column in places.T:
        found = (found ^ column.astype(np.uint64)) * np.uint64(SCRAMBLING)
        found ^= found >> np.uint64(29)
    return found


def joined(sums, edges):
    """Cells joined to patches, see `join_cells`: the first cell of each patch, the patch (m,) of
    each cell, and the `Sums` of patches."""
    m = len(sums.sizes)
    left, turn, root = np.empty(m), np.zeros(m, np.int64), np.arange(m)
    _compiled("join_cells")(*sums, edges.astype(np.int64), left, turn, root)
    first, patch = np.unique(root, return_inverse=True)
    return first, patch, Sums(*(values[first] for values in sums))


def _compiled(name):
    return compiled_function("segmentation._regions_numba", name)
