"""Regions that are several surfaces: what growth led across a crease is divided there."""

from functools import cache
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._quadrics import work_arrays
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.segmentation._cylinder_parts import FitLimits
from sklearn_mcmd.segmentation._graph import answers_of, n_linked
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits, rms_from_planes
from sklearn_mcmd.segmentation._region_cells import (
    ROWS,
    Cells,
    flattest_first,
    joined,
    once,
    usual_noise,
)
from sklearn_mcmd.segmentation._region_sums import median_by_region, region_moments

CHUNK = 64  # borders whose points are parted at once; it limits the memory
WHOLE = [0, 1, 2, 1, 3, 4, 2, 4, 5]  # places of a symmetric matrix's nine numbers in its six


class VoteLimits(NamedTuple):
    """When borders vote."""

    # Share of the largest angle by which a surface turns between neighbors. Planes that differ by
    # less are one surface: a road, and a roof that falls to its drains, stay whole. They may be a
    # step, as at a kerb.
    blunt: float = 0.2


def divide_at_creases(labels, index, planes, rules, n_jobs=None):
    """Divide regions where two planes that meet in a crease explain them better than one surface.

    Each region is divided into cells of neighbors. Cells are joined to patches, the most alike
    first, while one plane explains two as well as two planes do, by the Bayesian information
    criterion (BIC). Each border of two patches that are wide (`_are_wide`) votes (`vote`), and
    patches become groups. What is narrow then goes to the groups beside it (`_settled`). Where a
    border parts two groups, its points go to the side on which its crease has them. Points of
    patches that are of both sides get label -1. Last, groups that are no planes are joined again,
    unless their crease is steep (`join_blunt`).
    """
    points, size = index.points, n_linked(index, rules)
    usual = usual_noise(index, planes, rules, n_jobs)
    # A power of two, by which division rounds nothing; and no square leaves the numbers.
    unit = float(np.exp2(np.frexp(usual.max())[1]))
    rows = np.flatnonzero(labels >= 0)
    if len(rows) == 0 or not usual.min() * unit > 0:
        return labels
    # Step 1: cells, joined to patches.
    noise = np.maximum(usual / unit, FitLimits().ridge)
    order = flattest_first(rows, points, planes.scale / unit, noise)
    cells = Cells.gathered(labels, order, index, size, n_jobs)
    patch, sums = joined(cells.sums(points, noise, unit), cells.beside)
    n_patches, firsts = len(sums.sizes), np.unique(patch, return_index=True)[1]
    regions = labels[cells.begins[firsts]]
    if n_patches == len(np.unique(regions)):
        return labels
    # Step 2: borders of wide patches vote, and patches become groups.
    of_points, borders = np.append(patch, -1)[cells.of], once(patch[cells.beside])
    borders = borders[borders[:, 0] < borders[:, 1]]
    wide = _are_wide(points, of_points, n_patches, size)
    normals = np.linalg.eigh(sums.scatters[:, WHOLE].reshape(-1, 3, 3))[1][..., 0]
    blunt = np.cos(VoteLimits().blunt * np.arccos(min(rules.min_cosine, 1.0)))
    strips = Strips(points, noise, unit, cells, patch, normals, blunt)
    voting = borders[wide[borders].all(axis=1)]
    votes = strips.votes(voting, n_jobs)
    group = _joined(voting, votes, regions)
    group, mixed = _settled(group, borders, wide, regions)
    labels = np.append(np.where(mixed, -1, group), -1)[of_points].astype(np.int32)
    # Step 3: points beside a border that parts go to their side of its crease.
    parting = np.flatnonzero((votes < 0) & (group[voting[:, 0]] != group[voting[:, 1]]))
    parting = parting[np.argsort(-votes[parting], kind="stable")]  # the surest has the last word
    strips.part(voting[parting], group, labels, n_jobs)
    # Step 4: what is no plane, and whose crease is blunt, was divided by luck.
    return join_blunt(labels, regions, index, planes.normals, usual, rules.min_cosine)


def join_blunt(labels, regions, index, normals, noise, min_cosine):
    """Join the parts of each region again, unless they are planes or meet in a steep crease.

    Regions (n,) are those of n parts; labels name the parts. Planes have normals, and `noise` is
    usual around points. What is no plane is no two planes either, and where it is divided is luck.
    """
    n = len(regions)
    sizes, _, covariances = region_moments(index.points, labels, n)
    most = JoinLimits().most_noise * median_by_region(noise, labels, n)
    flat = rms_from_planes(covariances) <= most
    flat &= sizes > index.points.shape[1]
    angles = [
        _angles_across(rows, labels, regions, flat, index, normals)
        for rows in slices(len(labels), ROWS)
    ]
    pairs, cosines = map(np.concatenate, zip(*angles, strict=True))
    pairs, border = np.unique(pairs, axis=0, return_inverse=True)
    blunt = median_by_region(cosines, border.ravel(), len(pairs)) >= min_cosine
    graph = coo_array((np.ones(np.count_nonzero(blunt)), pairs[blunt].T), shape=(n, n))
    return np.append(connected_components(graph, directed=False)[1], -1).astype(np.int32)[labels]


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


def _are_wide(points, labels, n, size):
    """Which of n surfaces are wide: the plane of a piece as long as wide leaves more degrees of
    freedom than a cell of `size` has points."""
    sizes, _, covariances = region_moments(points, labels, n)
    values = np.maximum(np.linalg.eigvalsh(covariances), 0.0)
    # Of `sizes` points along a length sqrt(12 v2), sizes * sqrt(v1 / v2) are in a piece as long as
    # the width sqrt(12 v1). Both sides are squared, and multiplied by v2.
    return sizes**2 * values[:, 1] > (size + points.shape[1]) ** 2 * values[:, 2]


class Strips:
    """The points of two patches near to their border, what they vote, and on which side they are.

    A strip reaches on both sides as far as the smaller patch, so that both weigh alike. Normals
    (n_patches, 3) are those of patches' planes, and `noise` is in units. A crease whose cosine is
    above `blunt` is none.
    """

    def __init__(self, points, noise, unit, cells, patch, normals, blunt):
        self.points, self.noise, self.unit = points, noise, unit
        self.cells, self.normals, self.blunt = cells, normals, blunt
        centers, order = points[cells.begins], np.argsort(patch, kind="stable")
        self.groups = groups = np.split(order, np.cumsum(np.bincount(patch))[:-1])
        self.tree = cache(lambda name: cKDTree(centers[groups[name]]))

    def votes(self, borders, n_jobs):
        """The vote of each pair of patches; see `vote`."""
        votes = answers_of(lambda border: self.vote_on(border)[0], borders, n_jobs)
        return np.array(votes, dtype=np.float64)

    def part(self, borders, group, labels, n_jobs):
        """Give the points of each strip in turn to the group on their side of its crease; strips
        are asked for again, as all together may take more memory than the cloud."""
        for chunk in slices(len(borders), CHUNK):
            parts = answers_of(self.vote_on, borders[chunk], n_jobs)
            for _, names, rows, first in parts:
                first_group, second_group = group[names]
                of_both = np.isin(labels[rows], (first_group, second_group))
                labels[rows[of_both]] = np.where(first[of_both], first_group, second_group)

    def vote_on(self, border):
        """The vote of two patches, their names, rows of their strip, and which are the first's."""
        names = sorted(border.tolist(), key=lambda name: len(self.groups[name]))
        small, large = (self.groups[name] for name in names)
        tree, large_tree = map(self.tree, names)
        rows, sizes = self.cells.members(np.concatenate([small, large[_strip(tree, large_tree)]]))
        local = ((self.points[rows] - tree.data[0]) / self.unit).T.copy()
        n_first, cell = sizes[: len(small)].sum(), np.repeat(np.arange(len(sizes)), sizes)
        first, fit = np.arange(len(rows)) < n_first, FitLimits()
        sides, weights = np.stack([first] * 3), 1.0 / np.square(self.noise[rows])
        normals, most_noise = self.normals[names], JoinLimits().most_noise
        blunt = bool(abs(normals[0] @ normals[1]) > self.blunt)
        room, equations = work_arrays(6, len(rows))
        value = _compiled("vote")(
            local, weights, cell, normals, fit, most_noise, blunt, room, equations, sides
        )
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
    around: list[dict] = [{} for _ in range(n)]
    group = np.arange(n)
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
