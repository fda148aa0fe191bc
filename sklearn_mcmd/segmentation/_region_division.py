"""Regions that are several surfaces: what growth led across a crease is divided there."""

from dataclasses import dataclass
from functools import lru_cache, partial
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._around import quantile_around, ratio
from sklearn_mcmd.planes._quadrics import work_arrays
from sklearn_mcmd.runtime._chunks import each_slice, run, slices
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.segmentation._cylinder_parts import FitLimits
from sklearn_mcmd.segmentation._graph import HEIGHT_BITS, GrowthLimits, n_linked
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits
from sklearn_mcmd.segmentation._parts import PART, Parts
from sklearn_mcmd.segmentation._region_sums import median_by_region, region_moments

UPPER = [0, 1, 2, 4, 5, 8]  # places of the six numbers of a symmetric matrix in its nine
WHOLE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # and the reverse
CHUNK = 64  # borders whose points are parted at once; it limits the memory
PAIRS = 2**20  # of cells that are named at once; it limits the memory
ROWS = 2**14  # whose neighbors are looked at at once; it limits the memory
NO_KEYS = np.empty(0, np.int64)
TREES = 256  # of patches, which are kept for their next border; it limits the memory
PLACE_BITS = 20  # of a place, as a share of the extent, by which equally flat points are scrambled
SCRAMBLING = 0x9E3779B97F4A7C15  # an odd number without a pattern, as of Fibonacci hashing


class VoteLimits(NamedTuple):
    """When borders vote, and whose cells are joined before."""

    # Share of the largest angle by which a surface turns between neighbors. Planes that differ by
    # less are one surface: a road, and a roof that falls to its drains, stay whole. They may be a
    # step, as at a kerb.
    blunt: float = 0.2
    # How often cells are gathered to blocks, within which they are joined before all are.
    rings: int = 3


class Sums(NamedTuple):
    """What is known of cells, or of patches, in units of noise; scatters are the upper halves."""

    sizes: np.ndarray
    weights: np.ndarray
    means: np.ndarray  # (m, 3)
    scatters: np.ndarray  # (m, 6)


class Patches(NamedTuple):
    """What votes ask of patches."""

    begins: np.ndarray  # points at which their cells begin, patch by patch
    sizes: np.ndarray  # cells of each
    normals: np.ndarray  # (n, 3) of their planes
    wide: np.ndarray  # whether they are

    @classmethod
    def of(cls, begins, patch, sums, wide):
        """By the patch of each cell, and the `Sums` of patches."""
        normals = np.linalg.eigh(sums.scatters[:, WHOLE].reshape(-1, 3, 3))[1][..., 0]
        order, sizes = np.argsort(patch, kind="stable"), np.bincount(patch)
        return cls(begins[order], sizes, normals, wide)


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

        def measure(part):
            rows = slice(own.start + part.start, own.start + part.stop)
            around = self.index.query_own(rows, self.size)
            found = quantile_around(self.planes.scale, around, GrowthLimits().usual)
            usual[part] = np.hypot(found, self.bend * self.planes.radius[rows])

        each_slice(len(usual), self.index.chunk, measure, self.n_jobs)
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

        def find(rows):
            near[rows] = self.near(slice(own.start + rows.start, own.start + rows.stop))

        each_slice(n, self.index.chunk, find, self.n_jobs)
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


def divide_at_creases(labels, index, planes, rules, n_jobs=None, parts=None):
    """Divide regions where two planes that meet in a crease explain them better than one surface.

    Each region is divided into cells of neighbors. Cells are joined to patches, the most alike
    first, while one plane explains two as well as two planes do, by the Bayesian information
    criterion (BIC): first within blocks of cells, then all. Each border of two patches votes
    (`vote`), and patches become groups. A patch or a group is a surface of its own if it is wide
    (`_are_wide`): only borders of wide patches part, and those of others only join. What is narrow
    then goes to the groups beside it (`_settled`). Last, where a border parts two groups, its
    points go to the side on which its crease has them. Points of patches that are of both sides get
    label -1.
    """
    n, own = len(labels), slice(0, len(labels))
    points = Points(index, planes, rules, labels, np.empty(n), np.empty(n, np.int32), n_jobs)
    points.noise[:], points.cell[:] = points.usual_noise(own), -1
    ends = (f(index.points, axis=0) for f in (np.min, np.max))
    bounds = points.noise.min(), points.noise.max(), *ends
    if not (labels >= 0).any() or not points.scale(*bounds):
        return labels
    points.cell[:] = points.gather(own)
    begins = np.flatnonzero(points.cell == np.arange(n)).astype(np.int32)
    beside = points.beside(own)
    block = blocks(points, begins, beside)
    inside = beside[np.equal(*block[np.searchsorted(begins, pairs_of(beside))].T)]
    roots, of, sums = points.joined(begins, points.sums(begins), inside)
    borders = named(beside, lambda cells: roots[of[np.searchsorted(begins, cells)]])
    last, of_root, sums = points.joined(roots, sums, borders)
    if are_whole(labels, last):
        return labels
    borders = pairs_of(named(borders, lambda names: of_root[places(roots, names)]))
    patch, own = of_root[of], np.empty(n, np.int32)
    for rows in slices(n, ROWS):
        cell = points.cell[rows]
        own[rows] = np.where(cell < 0, -1, patch[np.searchsorted(begins, cell)])
    return divided(points, rules, begins, patch, own, last, sums, borders, parts=parts)


def scrambled(places):
    """A number by each row of whole numbers (m, d), which grows in no direction."""
    found = np.zeros(len(places), np.uint64)
    for column in places.T:
        found = (found ^ column.astype(np.uint64)) * np.uint64(SCRAMBLING)
        found ^= found >> np.uint64(29)
    return found


def blocks(points, begins, beside):
    """The block (m,) of each cell, by its name, that of its first.

    Blocks are gathered of cells as cells are of points, in the same order, then of such blocks, and
    so on. `beside` are `keys` of the cells.
    """
    names, block = begins, begins
    known = np.full(len(points.noise), -1, np.int32)
    for _ in range(VoteLimits().rings):
        found = points.gather_blocks(names, beside, known)
        of = partial(_looked_up, names, found)
        block, beside, names = of(block), named(beside, of), np.unique(found)
    return block


def _looked_up(names, values, wanted):
    return values[np.searchsorted(names, wanted)]


def are_whole(labels, last):
    """Whether each region is one patch; these begin at some points."""
    return len(last) == len(np.unique(labels[last]))


def joined(sums, edges):
    """Cells joined to patches, see `join_cells`: the first cell of each patch, the patch (m,) of
    each cell, and the `Sums` of patches."""
    m = len(sums.sizes)
    left, turn, root = np.empty(m), np.zeros(m, np.int64), np.arange(m)
    _compiled("join_cells")(*sums, edges.astype(np.int64), left, turn, root)
    first, patch = np.unique(root, return_inverse=True)
    return first, patch, Sums(*(values[first] for values in sums))


def divided(points, rules, begins, patch, own, last, sums, borders, vote=None, parts=None):
    """The labels of points, changed, once cells are joined to patches; see `divide_at_creases`.

    Cells begin at the points `begins` and have a patch each, as points have, `own` (n,). Patches
    begin at the points `last`, in order. Borders (m, 2) are between them, both ways. `vote` returns
    the votes of borders of `Patches`; by default this process asks for them. `parts` are as of
    `divide_at_creases`.
    """
    labels, n_jobs, shape = points.labels, points.n_jobs, (len(last), points.size)
    regions, borders = labels[last], borders[borders[:, 0] < borders[:, 1]]
    parts = parts or Parts(len(labels), n_jobs)
    wide = _are_wide(points.index.points, own, *shape, parts)
    patches = Patches.of(begins, patch, sums, wide)
    strips = Strips(points, patches, rules.min_cosine)
    votes = strips.votes(borders, n_jobs) if vote is None else vote(patches, borders)
    counts = wide[borders].all(axis=1) | (votes > 0)
    group = _joined(borders[counts], votes[counts], regions)
    grouped = Renamed(own, np.append(group, -1))
    wide = _are_wide(points.index.points, grouped, *shape, parts)[group]
    both = wide[borders].all(axis=1)
    group, mixed = _settled(group, borders, wide, regions)
    grouped = Renamed(own, np.append(np.where(mixed, -1, group), -1))
    for rows in slices(len(labels), PART):
        labels[rows] = grouped[rows]
    parted = both & (votes < 0) & (group[borders[:, 0]] != group[borders[:, 1]])
    parting = np.flatnonzero(parted)
    parting = parting[np.argsort(-votes[parting], kind="stable")]  # the surest has the last word
    strips.part(borders[parting], group, labels, n_jobs)
    return labels


def _are_wide(points, labels, n, size, parts):
    """Which of n surfaces are wide: the plane of a piece as long as wide leaves more degrees of
    freedom than a cell of `size` has points."""
    found = region_moments(points, labels, n, parts=parts)
    values = np.maximum(np.linalg.eigvalsh(found.covariances), 0.0)
    return found.sizes**2 * values[:, 1] > (size + points.shape[1]) ** 2 * values[:, 2]


@dataclass(frozen=True)
class Renamed:
    """Labels of points by new numbers, of which the last is for -1, as some rows are asked for."""

    labels: np.ndarray
    number: np.ndarray

    def __len__(self):
        return len(self.labels)

    def __getitem__(self, rows):
        return self.number[self.labels[rows]]


class Strips:
    """The points of two patches near to their border, what they vote, and on which side they are.

    A strip reaches on both sides as far as the smaller patch, so that both weigh alike.
    """

    def __init__(self, points, patches, min_cosine):
        self.points, self.patches, self.min_cosine = points, patches, min_cosine
        self.blunt = np.cos(VoteLimits().blunt * np.arccos(min(min_cosine, 1.0)))
        self.ends = np.cumsum(patches.sizes)
        self.group = lru_cache(TREES)(self._group)

    def _group(self, name):
        """Where the cells of a patch begin, in order, and the tree of these points."""
        end, size = self.ends[name], self.patches.sizes[name]
        begins = self.patches.begins[end - size : end]
        begins = begins[self.points.in_order(begins)]
        return begins, cKDTree(self.points.index.points[begins])

    def votes(self, borders, n_jobs):
        """The vote of each pair of patches; see `vote`."""
        votes = np.empty(len(borders))

        def task(i):
            votes[i] = self.vote_on(borders[i])[0]

        run([(i,) for i in range(len(borders))], task, n_jobs)
        return votes

    def part(self, borders, group, labels, n_jobs):
        """Give the points of each strip in turn to the group on their side of its crease; strips
        are asked for again, as all together may take more memory than the cloud."""

        def task(i):
            _, names, rows, first = self.vote_on(borders[i])
            parts[i % CHUNK] = rows, group[names], first

        for start in range(0, len(borders), CHUNK):
            parts = [None] * min(CHUNK, len(borders) - start)
            run([(start + i,) for i in range(len(parts))], task, n_jobs)
            for rows, groups, first in parts:
                own = np.isin(labels[rows], groups)
                labels[rows[own]] = np.where(first[own], *groups)

    def vote_on(self, border):
        """The vote of two patches, their names, rows of their strip, and which are the first's."""
        names = sorted(border.tolist(), key=self.patches.sizes.__getitem__)
        (small, tree), (large, others) = map(self.group, names)
        large, points = large[_strip(tree, others)], self.points
        rows, sizes = points.members(np.concatenate([small, large]))
        local = ((points.index.points[rows] - tree.data[0]) / points.unit).T.copy()
        n_first, cell = sizes[: len(small)].sum(), np.repeat(np.arange(len(sizes)), sizes)
        first, fit = np.arange(len(rows)) < n_first, FitLimits()
        sides, weights = np.stack([first] * 3), 1.0 / np.square(points.noise_of(rows))
        normals, most_noise = self.patches.normals[names], JoinLimits().most_noise
        cosine = abs(normals[0] @ normals[1])
        blunt, steep = bool(cosine > self.blunt), bool(cosine < self.min_cosine)
        steep &= not self.patches.wide[names].all()
        room, equations = work_arrays(6, len(rows))
        known = local, weights, cell, normals, fit, most_noise, blunt, steep
        value = _compiled("vote")(*known, room, equations, sides)
        return value, names, rows, sides[2]


def _strip(small, large):
    """Rows of the large of two trees, ascending, that are as near to some point of the small one
    as the one of these that is farthest from the large one is to it."""
    reach = large.query(small.data)[0].max()
    middle = (small.mins + small.maxes) / 2
    around = (np.linalg.norm(small.maxes - middle) + reach) * (1 + 1e-9)
    rows = np.sort(large.query_ball_point(middle, around))
    return rows[small.query(large.data[rows])[0] <= reach]


def _settled(group, borders, wide, regions):
    """The group (n,) of each patch when narrow ones have joined the group with which they have the
    most borders, and which patches are of two groups: narrow ones beside two that are parted."""
    n, both = len(wide), wide[borders].all(axis=1)
    pairs = group[borders]
    parted = both & (pairs[:, 0] != pairs[:, 1])
    ends = np.concatenate([borders[~both], borders[~both, ::-1]])
    ends = ends[~wide[ends[:, 0]] & wide[ends[:, 1]]]
    beside = coo_array((np.ones(len(ends)), (ends[:, 0], group[ends[:, 1]])), (n, n)).tocsr()
    apart = coo_array((np.ones(np.count_nonzero(parted)), pairs[parted].T), (n, n)).tocsr()
    mixed = (beside @ apart).multiply(beside).sum(axis=1) > 0
    asked = ~mixed[borders].any(axis=1) & (pairs[:, 0] != pairs[:, 1])
    final = _joined(pairs[asked], np.where(parted, -np.inf, 1.0)[asked], regions)
    return final[group], mixed


def _joined(borders, votes, regions):
    """The group (n,) of each patch, named by its first.

    Votes are added over all borders of two groups, and groups are joined, the highest sum first.
    So a bent surface stays one, and a few wrong borders make no bridge. The more borders a region
    has, the more often one of them is wrong: what parts it must be surer by their number.
    """
    n = len(regions)
    chances = np.log(np.maximum(np.bincount(regions[borders[:, 0]], minlength=n), 1))[regions]
    around, group = [{} for _ in range(n)], np.arange(n)
    for (a, b), value in zip(borders.tolist(), votes.tolist(), strict=True):
        around[a][b] = around[b][a] = around[a].get(b, 0.0) + value
    heap = [(-value, a, b) for a in range(n) for b, value in around[a].items() if a < b]
    heapify(heap)
    while heap:
        value, a, b = heappop(heap)
        # One of them was joined, or has more borders by now.
        if value >= chances[a] or around[a].get(b) != -value:
            continue
        group[b] = a
        del around[a][b], around[b][a]
        for c, more in around[b].items():
            del around[c][b]
            around[a][c] = around[c][a] = total = around[a].get(c, 0.0) + more
            heappush(heap, (-total, min(a, c), max(a, c)))
        around[b] = {}
    for b in range(n):  # a group's name is smaller than those that joined it
        group[b] = group[group[b]]
    return group


def _compiled(name):
    return compiled_function("segmentation._regions_numba", name)
