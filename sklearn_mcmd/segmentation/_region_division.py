"""Regions that are several surfaces: what growth led across a crease is divided there."""

from functools import cache
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._around import quantile_around, ratio
from sklearn_mcmd.planes._quadrics import work_arrays
from sklearn_mcmd.runtime._chunks import each_slice, run
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.segmentation._cylinder_parts import FitLimits
from sklearn_mcmd.segmentation._graph import HEIGHT_BITS, GrowthLimits, n_linked
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits
from sklearn_mcmd.segmentation._region_sums import median_by_region, region_moments

UPPER = [0, 1, 2, 4, 5, 8]  # places of the six numbers of a symmetric matrix in its nine
WHOLE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # and the reverse
CHUNK = 64  # borders whose points are parted at once; it limits the memory
ROWS = 2**14  # whose neighbors are looked at at once; it limits the memory


class VoteLimits(NamedTuple):
    """When borders vote."""

    # Share of the largest angle by which a surface turns between neighbors. Planes that differ by
    # less are one surface: a road, and a roof that falls to its drains, stay whole. They may be a
    # step, as at a kerb.
    blunt: float = 0.2


class _Cells(NamedTuple):
    """Small neighborhoods that divide the regions, in the order in which they were begun."""

    members: np.ndarray  # int32, rows of the points, cell after cell
    starts: np.ndarray  # int (n_cells + 1,), where each begins
    of: np.ndarray  # int32 (n,), cell of each point, -1 for none

    @classmethod
    def gather(cls, order, near, labels):
        """The cells that begin at points in an order; see `gather_cells`."""
        members, starts = np.empty(len(order), np.int32), np.empty(len(order) + 1, np.int64)
        of = np.full(len(labels), -1, np.int32)
        n_cells = _compiled("gather_cells")(order, near, labels, members, starts, of)
        return cls(members, starts[: n_cells + 1].copy(), of)

    def rows(self, cells):
        """Rows of the points of some cells, and the cell of each."""
        sizes = self.starts[cells + 1] - self.starts[cells]
        before = np.cumsum(sizes) - sizes
        places = np.arange(sizes.sum()) + np.repeat(self.starts[cells] - before, sizes)
        return self.members[places], np.repeat(cells, sizes)


def divide_at_creases(labels, index, planes, rules, n_jobs=None):
    """Divide regions where two planes that meet in a crease explain them better than one surface.

    Each region is divided into cells of neighbors. Cells are joined to patches, the most alike
    first, while one plane explains two as well as two planes do, by the Bayesian information
    criterion (BIC). Each border of two patches votes (`vote`), and patches become groups. A patch
    or a group is a surface of its own if it is wide (`_are_wide`): only borders of wide patches
    part, and those of others only join. What is narrow then goes to the groups beside it
    (`_settled`). Last, where a border parts two groups, its points go to the side on which its
    crease has them. Points of patches that are of both sides get label -1.
    """
    noise, near = _noise_and_neighbors(index, planes, rules, n_jobs)
    unit = float(np.exp2(np.frexp(noise.max(initial=0.0))[1]))  # no square leaves the numbers
    if not (labels >= 0).any() or not noise.min() * unit > 0:
        return labels
    noise[:] = np.maximum(noise / unit, FitLimits().ridge)
    # The flattest begin. Their order depends on no rounding error, and on no order of rows.
    flatness = np.rint(np.ldexp(ratio(planes.scale / unit, noise), HEIGHT_BITS))
    order = np.lexsort((*index.points.T, flatness))
    cells = _Cells.gather(order[labels[order] >= 0], near, labels)
    del order, flatness
    edges = _edges(cells, near, labels)
    size = near.shape[1]
    del near
    found = region_moments(index.points, cells.of, len(cells.starts) - 1, n_jobs=n_jobs)
    weights = found.sizes / np.square(median_by_region(noise, cells.of, len(found.sizes)))
    means = (found.centroids - found.centroids[0]) / unit
    scatters = found.covariances.reshape(-1, 9)[:, UPPER] * (weights / unit**2)[:, None]
    patch = _joined_cells(found.sizes, weights, means, scatters, edges)
    first, patch = np.unique(patch, return_inverse=True)
    if len(first) == len(np.unique(labels[labels >= 0])):
        return labels
    normals = np.linalg.eigh(scatters[first][:, WHOLE].reshape(-1, 3, 3))[1][..., 0]
    own = np.append(patch, -1)[cells.of]
    wide = _are_wide(index.points, own, len(first), size, n_jobs)
    borders = patch[edges]
    borders = np.unique(np.sort(borders[borders[:, 0] != borders[:, 1]], axis=1), axis=0)
    strips = _Strips(index.points, noise, unit, cells, patch, normals, wide, rules.min_cosine)
    votes = strips.votes(borders, n_jobs)
    regions = labels[cells.members[cells.starts[first]]]
    counts = wide[borders].all(axis=1) | (votes > 0)
    group = _joined(borders[counts], votes[counts], regions)
    wide = _are_wide(index.points, np.append(group, -1)[own], len(first), size, n_jobs)[group]
    both = wide[borders].all(axis=1)
    group, mixed = _settled(group, borders, wide, regions)
    divided = np.append(np.where(mixed, -1, group), -1)[own].astype(labels.dtype)
    parted = both & (votes < 0) & (group[borders[:, 0]] != group[borders[:, 1]])
    parting = np.flatnonzero(parted)
    parting = parting[np.argsort(-votes[parting], kind="stable")]  # the surest has the last word
    strips.part(borders[parting], group, divided, n_jobs)
    return divided


def _noise_and_neighbors(index, planes, rules, n_jobs):
    """Standard deviation (n,) that is usual around each point, and its neighbors (n, k)."""
    n, k = len(index.points), n_linked(index, rules)
    noise, near = index.empty(n), index.empty((n, k), np.int32)
    limits = GrowthLimits()
    bend = limits.bent * np.arccos(min(rules.min_cosine, 1.0))

    def measure(rows):
        around = index.query_own(rows, k)
        near[rows] = around.indices
        usual = quantile_around(planes.scale, around, limits.usual)
        noise[rows] = np.hypot(usual, bend * planes.radius[rows])

    each_slice(n, index.chunk, measure, n_jobs)
    return noise, near


def _joined_cells(sizes, weights, means, scatters, edges):
    """The first cell of the patch of each cell; see `join_cells`."""
    m = len(sizes)
    left, turn, root = np.empty(m), np.zeros(m, np.int64), np.arange(m)
    _compiled("join_cells")(sizes, weights, means, scatters, edges, left, turn, root)
    return root


def _edges(cells, near, labels):
    """Pairs (m, 2) of cells of one region of which a point of one has a neighbor in the other."""
    pairs, n = [np.empty(0, np.int64)], len(cells.starts) - 1
    for start in range(0, len(near), ROWS):
        part = slice(start, start + ROWS)
        own, other = cells.of[part, None].astype(np.int64), cells.of[near[part]]
        beside = (labels[near[part]] == labels[part, None]) & (other != own) & (own >= 0)
        keys = np.minimum(own, other) * n + np.maximum(own, other)
        pairs.append(np.unique(keys[beside]))
    keys = np.unique(np.concatenate(pairs))
    return np.column_stack([keys // n, keys % n])


def _are_wide(points, labels, n, size, n_jobs):
    """Which of n surfaces are wide: the plane of a piece as long as wide leaves more degrees of
    freedom than a cell of `size` has points."""
    found = region_moments(points, labels, n, n_jobs=n_jobs)
    values = np.maximum(np.linalg.eigvalsh(found.covariances), 0.0)
    return found.sizes**2 * values[:, 1] > (size + points.shape[1]) ** 2 * values[:, 2]


class _Strips:
    """The points of two patches near to their border, what they vote, and on which side they are.

    A strip reaches on both sides as far as the smaller patch, so that both weigh alike. Normals
    (n_patches, 3) are those of patches' planes.
    """

    def __init__(self, points, noise, unit, cells, patch, normals, wide, min_cosine):
        self.points, self.noise, self.unit = points, noise, unit
        self.cells, self.normals, self.wide, self.min_cosine = cells, normals, wide, min_cosine
        self.blunt = np.cos(VoteLimits().blunt * np.arccos(min(min_cosine, 1.0)))
        self.centers = centers = points[cells.members[cells.starts[:-1]]]
        order = np.argsort(patch, kind="stable")
        self.groups = groups = np.split(order, np.flatnonzero(np.diff(patch[order])) + 1)
        self.tree = cache(lambda name: cKDTree(centers[groups[name]]))

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
        names = sorted(border.tolist(), key=lambda name: len(self.groups[name]))
        small, large = (self.groups[name] for name in names)
        large = large[_strip(*map(self.tree, names))]
        rows, cell = self.cells.rows(np.concatenate([small, large]))
        local = ((self.points[rows] - self.centers[small[0]]) / self.unit).T.copy()
        n_first = (self.cells.starts[small + 1] - self.cells.starts[small]).sum()
        first, fit = np.arange(len(rows)) < n_first, FitLimits()
        sides, weights = np.stack([first] * 3), 1.0 / np.square(self.noise[rows])
        normals, most_noise = self.normals[names], JoinLimits().most_noise
        cosine = abs(normals[0] @ normals[1])
        blunt, steep = bool(cosine > self.blunt), bool(cosine < self.min_cosine)
        steep &= not self.wide[names].all()
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
