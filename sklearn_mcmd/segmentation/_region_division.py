"""Regions that are several surfaces: what growth led across a crease is divided there."""

from functools import lru_cache, partial
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._quadrics import work_arrays
from sklearn_mcmd.runtime._chunks import run, slices
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.segmentation._cylinder_parts import FitLimits
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits
from sklearn_mcmd.segmentation._parts import PART, Parts
from sklearn_mcmd.segmentation._region_cells import ROWS, WHOLE, Points, named, pairs_of, places
from sklearn_mcmd.segmentation._region_sums import median_by_region, region_moments, relabeled

CHUNK = 64  # borders whose points are parted at once; it limits the memory
TREES = 256  # of patches, which are kept for their next border; it limits the memory


class VoteLimits(NamedTuple):
    """When borders vote, and whose cells are joined before."""

    # Share of the largest angle by which a surface turns between neighbors. Planes that differ by
    # less are one surface: a road, and a roof that falls to its drains, stay whole. They may be a
    # step, as at a kerb.
    blunt: float = 0.2
    # How often cells are gathered to blocks, within which they are joined before all are.
    rings: int = 3


class Patches(NamedTuple):
    """What votes ask of patches."""

    begins: np.ndarray  # points at which their cells begin, patch by patch, in order
    sizes: np.ndarray  # cells of each
    normals: np.ndarray  # (n, 3) of their planes

    @classmethod
    def of(cls, points, begins, patch, sums):
        """By the patch of each cell, and the `Sums` of patches."""
        normals = np.linalg.eigh(sums.scatters[:, WHOLE].reshape(-1, 3, 3))[1][..., 0]
        order = points.in_order(begins)
        order = order[np.argsort(patch[order], kind="stable")]
        return cls(begins[order], np.bincount(patch), normals)


def divide_at_creases(labels, index, planes, rules, n_jobs=None, parts=None):
    """Divide regions where two planes that meet in a crease explain them better than one surface.

    Each region is divided into cells of neighbors. Cells are joined to patches, the most alike
    first, while one plane explains two as well as two planes do, by the Bayesian information
    criterion (BIC): first within blocks of cells, then all. Each border of two patches that are
    wide (`_are_wide`) votes (`vote`), and patches become groups. What is narrow then goes to the
    groups beside it (`_settled`). Where a border parts two groups, its points go to the side on
    which its crease has them. Points of patches that are of both sides get label -1.
    Last, groups that are no planes are joined again, unless their crease is steep (`join_blunt`).
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


def divided(points, rules, begins, patch, own, last, sums, borders, vote=None, parts=None):
    """The labels of points, changed, once cells are joined to patches; see `divide_at_creases`.

    Cells begin at the points `begins` and have a patch each, as points have, `own` (n,). Patches
    begin at the points `last`, in order. Borders (m, 2) are between them, both ways. `vote` returns
    the votes of borders of `Patches`, ordered by the places of the first; by default this process
    asks for them. `parts` are as of `divide_at_creases`.
    """
    labels, n_jobs, shape = points.labels, points.n_jobs, (len(last), points.size)
    regions, borders = labels[last], borders[borders[:, 0] < borders[:, 1]]
    parts = parts or Parts(len(labels), n_jobs)
    wide = _are_wide(points.index.points, own, *shape, parts)
    patches = Patches.of(points, begins, patch, sums)
    strips = Strips(points, patches, rules.min_cosine)
    # One place after the other, so that the trees of a patch serve all of its borders.
    voting = borders[wide[borders].all(axis=1)]
    voting = voting[np.argsort(last[voting[:, 0]], kind="stable")]
    votes = strips.votes(voting, n_jobs) if vote is None else vote(patches, voting)
    group = _joined(voting, votes, regions)
    group, mixed = _settled(group, borders, wide, regions)
    names = np.append(np.where(mixed, -1, group), -1)  # the last is for points of no patch
    for rows in slices(len(labels), PART):
        labels[rows] = names[own[rows]]
    parting = np.flatnonzero((votes < 0) & (group[voting[:, 0]] != group[voting[:, 1]]))
    parting = parting[np.argsort(-votes[parting], kind="stable")]  # the surest has the last word
    strips.part(voting[parting], group, labels, n_jobs)
    return join_blunt(labels, regions, points, rules.min_cosine, parts)


def join_blunt(labels, regions, points, min_cosine, parts):
    """Join the parts of each region again, unless they are planes or meet in a steep crease.

    Regions (n,) are those of n parts; labels name the parts, and are changed. What is no plane is
    no two planes either, and where it is divided is luck.
    """
    n, index, normals = len(regions), points.index, points.planes.normals
    moments = region_moments(index.points, labels, n, parts=parts)
    rms = np.sqrt(np.maximum(np.linalg.eigvalsh(moments.covariances)[:, 0], 0.0))
    flat = rms <= JoinLimits().most_noise * median_by_region(points.noise, labels, n, parts)
    flat &= moments.sizes > index.points.shape[1]
    angles = parts.each(_angles_across, labels, regions, flat, index, normals, size=ROWS)
    pairs, cosines = map(np.concatenate, zip(*angles, strict=True))
    pairs, border = np.unique(pairs, axis=0, return_inverse=True)
    blunt = median_by_region(cosines, border.ravel(), len(pairs)) >= min_cosine
    graph = coo_array((np.ones(np.count_nonzero(blunt)), pairs[blunt].T), shape=(n, n))
    return relabeled(labels, np.append(connected_components(graph, directed=False)[1], -1))


def _angles_across(rows, labels, regions, flat, index, normals):
    """For each of some points beside a border of two parts of one region that are not both flat:
    the parts (m, 2), and the cosine (m,) between the planes at both ends of its neighborhood.

    One end is its farthest neighbor across the border, the other the farthest from that on its own
    side: nearer to a crease, planes are of both sides.
    """
    near = index.query_own(rows).indices
    part, near_part = labels[rows][:, None], labels[near]
    across = (near_part != part) & (regions[near_part] == regions[part])
    across &= (near_part >= 0) & (part >= 0) & ~(flat[near_part] & flat[part])
    at_border = np.flatnonzero(across.any(axis=1))
    near, across = near[at_border], across[at_border]
    on_own_side = (near_part == part)[at_border]
    last = near.shape[1] - 1 - across[:, ::-1].argmax(axis=1)  # neighbors ascend by distance
    end = np.take_along_axis(near, last[:, None], axis=1)
    lengths = np.linalg.norm(index.points[near] - index.points[end], axis=2)
    farthest = np.where(on_own_side, lengths, -1.0).argmax(axis=1)
    ends = np.append(end, np.take_along_axis(near, farthest[:, None], axis=1), axis=1)
    cosines = np.abs(np.einsum("md,md->m", normals[ends[:, 0]], normals[ends[:, 1]]))
    return np.sort(labels[ends], axis=1), cosines


def _are_wide(points, labels, n, size, parts):
    """Which of n surfaces are wide: the plane of a piece as long as wide leaves more degrees of
    freedom than a cell of `size` has points."""
    found = region_moments(points, labels, n, parts=parts)
    values = np.maximum(np.linalg.eigvalsh(found.covariances), 0.0)
    return found.sizes**2 * values[:, 1] > (size + points.shape[1]) ** 2 * values[:, 2]


class Strips:
    """The points of two patches near to their border, what they vote, and on which side they are.

    A strip reaches on both sides as far as the smaller patch, so that both weigh alike.
    """

    def __init__(self, points, patches, min_cosine):
        self.points, self.patches = points, patches
        self.blunt = np.cos(VoteLimits().blunt * np.arccos(min(min_cosine, 1.0)))
        self.ends = np.cumsum(patches.sizes)
        self.group = lru_cache(TREES)(self._group)

    def _group(self, name):
        """Where the cells of a patch begin, and the tree of these points."""
        end, size = self.ends[name], self.patches.sizes[name]
        begins = self.patches.begins[end - size : end]
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
        blunt = bool(abs(normals[0] @ normals[1]) > self.blunt)
        room, equations = work_arrays(6, len(rows))
        known = local, weights, cell, normals, fit, most_noise, blunt
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
