"""Groups of too few points for a thing: rows among them, pieces of one, and how far they are."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.outliers._groups import (
    Shapes,
    are_straight,
    gaps_of_groups,
    separation_of_groups,
)
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._nearest import NearestPoints


class Groups(NamedTuple):
    """Sums over g groups of points off the surfaces: arrays (g,)."""

    one: np.ndarray  # the row of a point of each
    sizes: np.ndarray  # points
    counts: np.ndarray  # measurements
    usual: np.ndarray  # sum of the usual spacings around the points

    @classmethod
    def of(cls, groups, counts, usual):
        """Of points whose `groups` count from 0 on; rows are theirs."""
        one = np.empty(groups.max(initial=-1) + 1, np.intp)
        one[groups[::-1]] = np.arange(len(groups))[::-1]
        sums = (np.bincount(groups, weights) for weights in (None, counts, usual))
        return cls(one, *sums)

    def take(self, chosen):
        """Some of them, or in another order."""
        return Groups(*(part[chosen] for part in self))


class SmallGroups:
    """The points of all groups off the surfaces that have fewer than `least` measurements.

    `rest` is the `Rest`, of whose m points `usual` (m,) are the usual spacings, and `gaps` (m,) the
    distances from surfaces. `known` are all groups, and ``members(chosen)`` finds the points of
    some of these, bool (g,): their rows, ascending, and the group of each.
    """

    def __init__(self, rest, usual, gaps, known: Groups, members: Callable, least: float, n_jobs):
        self.rest, self.least, self.n_jobs = rest, least, n_jobs
        self.are_few = known.counts < least
        rows, groups = members(self.are_few)
        self.rows = rows.astype(np.int32)
        self.points, self.counts = np.array(rest.points[rows]), np.array(rest.counts[rows])
        self.usual, self.gaps, self.groups = usual, gaps, _numbered(groups)
        self.large, self._members = known.take(~self.are_few), members
        # What `judge` finds of these points, and the separation of some large groups' points.
        self.in_row, self.separation, self.straight = np.zeros(len(rows), bool), None, None
        self.apart, self.groups_apart = np.empty((2, 0), np.intp)
        self.separation_apart = np.empty(0)

    def judge(self):
        """Find which groups are rows, pieces of one thing, or a thing; how far others stand off."""
        if len(self.rows):
            self._part_rows()
            self._join_pieces()
        self.rest.others.release()
        small = self._are_small()
        real, some = self._real(small), np.flatnonzero(small)
        gaps = self._gaps(some, real)
        found = self._separation(self.rows[some], self.groups[some], gaps)
        self.separation, self.straight = np.zeros(len(small)), np.zeros(len(small), bool)
        self.separation[some], self.straight[some] = found
        if self.rest.has_surface:
            self._separate_large(small)
        real = [self.rest.reference] * self.rest.has_surface + real
        for search in real:
            search.release()
        return real

    def verdict(self, isolation):
        """The rows of points whose isolation or separation `judge` tells, ascending, both, and
        their groups.

        What is in a row keeps company with it, however far apart its points are.
        """
        rows = np.union1d(self.rows, self.apart)
        isolation, separation = np.array(isolation[rows]), np.zeros(len(rows))
        own, in_row = np.searchsorted(rows, self.rows), self.in_row | self.straight
        separation[own] = self.separation
        isolation[own[in_row]] = np.minimum(isolation[own], self.separation)[in_row]
        apart, groups = np.searchsorted(rows, self.apart), np.empty(len(rows), np.int32)
        separation[apart] = self.separation_apart
        groups[own], groups[apart] = self.groups, self.groups_apart
        return rows, isolation, separation, groups

    def _are_small(self):
        """Which points are in groups too small for a thing, bool."""
        sizes = np.bincount(self.groups, self.counts)
        small = sizes < self.least
        if not self.rest.has_surface:
            small &= sizes < max(sizes.max(initial=0), self.large.counts.max(initial=0))
        return small[self.groups]

    def _real(self, small):
        """Searches of what is real beside surfaces: the points of groups that are not small."""
        things = self.rest.others.without(self.rows[small])
        return [things] * bool(things.n)

    def _gaps(self, some, real):
        """Distances of some of the points from what is real."""
        gaps = gaps_to(self.points[some], real, self.n_jobs)
        return np.minimum(gaps, self.gaps[self.rows[some]]) if self.rest.has_surface else gaps

    def _places(self, near):
        """Places of rows of the rest among these points; their number of all others."""
        places = np.searchsorted(self.rows, near).astype(np.int32)
        np.minimum(places, len(self.rows) - 1, out=places)
        places[self.rows[places] != near] = len(self.rows)
        return places

    def _part_rows(self):
        """Let points of small groups that lie in a row be a group of their own: straight with their
        nearest others, and among the nearest of each other."""
        m, n_near = len(self.rows), self.rest.limits.n_near
        asked, links = np.flatnonzero(self._are_small()), []
        if self.rest.others.n <= n_near or len(asked) == 0:
            return

        def link(some, distances, near):
            around = self.rest.points[near]
            away = around - around.mean(axis=1, keepdims=True)
            covariance = np.einsum("mki,mkj->mij", away, away) / (n_near + 1)
            deviations = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0.0))
            straight = are_straight(deviations, np.full(len(near), n_near + 1))
            own = np.repeat(asked[some][straight], n_near)
            other = self._places(near[straight, 1:].ravel())
            links.append(np.stack([own, other])[:, other < m])

        self.rest.others.visit(self.points[asked], n_near + 1, link, self.n_jobs)
        one, other = np.hstack(links)
        graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=(m, m)).tocsr()
        part = connected_components(graph * graph.T, directed=False)[1]
        rows = np.flatnonzero(np.bincount(part)[part] > 1)
        rows = rows[np.lexsort(self.points[rows].T[::-1])]
        part = _numbered(part[rows])
        straight = Shapes.of(self.points[rows], part).straight[part]
        self.in_row[rows] = straight
        self.groups[rows[straight]] = m + part[straight]
        self.groups = _numbered(self.groups)

    def _join_pieces(self):
        """Let groups that are pieces of one thing be one."""
        small = self._are_small()
        real, rows = self._real(small), np.flatnonzero(small)
        group = _numbered(self.groups[rows])
        gaps = gaps_of_groups(group, self._gaps(rows, real))
        for search in real:
            search.release()
        order = np.lexsort(self.points[rows].T[::-1])
        shapes = Shapes.of(self.points[rows[order]], group[order])
        rows, group = rows[shapes.flat[group]], group[shapes.flat[group]]
        if len(rows) == 0:
            return
        # Pieces of a thing are no farther apart than a few of their lengths.
        m, pairs = len(self.rows), []
        reach, piece = np.full(m + 1, -np.inf), np.full(m + 1, -1, np.int32)  # the last: all others
        reach[rows], piece[rows] = ExplainLimits().explained * shapes.length[group], group

        def link(some, distances, near):
            own, near = rows[some], self._places(near)
            close = distances <= reach[near] + reach[own, None]
            i, j = np.nonzero(close & (piece[near] != piece[own, None]))
            distances, one, other = distances[i, j], own[i], near[i, j]
            del near, close, i, j
            a, b = piece[one], piece[other]
            # One of both, at least, is as near to the other as to anything real; or both have one
            # plane.
            linked = distances <= np.maximum(gaps[a], gaps[b])
            linked |= shapes.are_coplanar(a, b, self.points[one], self.points[other])
            both = np.stack([self.groups[one], self.groups[other]])
            pairs.append(np.unique(both[:, linked], axis=1))

        # A small group has fewer points, so one of another is among them.
        self.rest.others.visit(self.points[rows], int(np.ceil(self.least)), link, self.n_jobs)
        one, other = np.hstack(pairs)
        shape = (self.groups.max() + 1,) * 2
        graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=shape)
        self.groups = connected_components(graph, directed=False)[1][self.groups]

    def _separation(self, rows, groups, gaps):
        """Of points of the rest the separation of their groups, none of whose points is left out,
        and whether these are straight."""
        group, usual = _numbered(groups), np.array(self.usual[rows])
        separation, straight = separation_of_groups(self.rest.points[rows], group, usual, gaps)
        return separation[group], straight[group]

    def _separate_large(self, small):
        """Find the separation of large groups that stand off from all else: over how many times as
        large they are as the least thing. What is large by copies alone is real."""
        points = self.rest.points
        own = Groups.of(self.groups, self.counts, self.usual[self.rows])
        own, n_own = own._replace(one=self.rows[own.one]), len(own.one)
        known = Groups(*map(np.concatenate, zip(own, self.large, strict=True)))
        # One point of each group, and the least size that it may have, tell which may stand off.
        weight, large = self.least / known.counts, known.sizes >= self.least
        gaps = self.gaps[known.one[large]]
        size = known.usual[large] / known.sizes[large]
        stands_off = ExplainLimits().explained
        large[large] = ratio(gaps, size) * weight[large] > (1 - 1e-9) * stands_off
        inside = np.flatnonzero(large[self.groups])
        chosen = ~self.are_few
        chosen[chosen] = large[n_own:]
        rows, of = self._members(chosen)
        groups = (np.cumsum(~self.are_few) - 1)[of]  # their places among the large ones
        rows = np.concatenate([self.rows[inside], rows])
        groups = np.concatenate([self.groups[inside], n_own + groups])

        gaps = np.array(self.gaps[rows])
        apart = self._separation(rows, groups, gaps)[0] * weight[groups] > stands_off
        rows, groups, gaps = rows[apart], groups[apart], gaps[apart]
        code = _numbered(groups) + 1  # 0 of all others that are real
        # The codes of two groups differ in one bit at least, so some search is of the other.
        for bit in range(int(code.max(initial=0)).bit_length()):
            one = code >> bit & 1 == 1
            without = np.concatenate([self.rows[small], rows[one]])
            searches = self.rest.others.without(without), NearestPoints(points[rows[one]])
            for asked, search in zip((one, ~one), searches, strict=True):
                if search.n and asked.any():
                    near = search.query(points[rows[asked]], 1, self.n_jobs)[0][:, 0]
                    gaps[asked] = np.minimum(gaps[asked], near)
        separation, _ = self._separation(rows, groups, gaps)
        self.apart, self.groups_apart = rows, groups
        self.separation_apart = separation * weight[groups]


def _numbered(groups):
    """Groups as numbers from 0 on: int32."""
    return np.unique(groups, return_inverse=True)[1].astype(np.int32)


def gaps_to(queries, real, n_jobs):
    """Distances of queries to the nearest point that is real, inf if there is none."""
    gaps = np.full(len(queries), np.inf)
    for search in real:
        np.minimum(gaps, search.query(queries, 1, n_jobs)[0][:, 0], out=gaps)
    return gaps
