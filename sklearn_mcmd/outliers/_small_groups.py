"""Groups of too few points for a thing: rows among them, pieces of one, and how far they are."""

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


class SmallGroups:
    """The points of all groups off the surfaces that have fewer than `least` measurements.

    `rest` is the `Rest`, of whose m points `usual` (m,) are the usual spacings, `gaps` (m,) the
    distances from surfaces, and `groups` (m,) their groups, from 0 on.
    """

    def __init__(self, rest, usual, gaps, groups, least, n_jobs):
        self.rest, self.least, self.n_jobs = rest, least, n_jobs
        counts = np.bincount(groups, rest.counts)
        are_large = counts >= least
        rows = np.flatnonzero(~are_large[groups])
        self.rows = rows.astype(np.int32)
        self.points, self.counts = rest.points[rows], rest.counts[rows]
        self.usual, self.gaps, self.groups = usual, gaps, _numbered(groups[rows])
        self.most = counts[are_large].max(initial=0)  # measurements of the largest
        # Of all points the groups when `judge` has found those of small ones; large ones are first.
        self.all_groups = np.cumsum(are_large, dtype=np.int32)[groups] - 1
        self.n_large = np.count_nonzero(are_large)

    def judge(self, isolation):
        """Find which groups are rows, pieces of one thing, or a thing; how far others stand off.

        What is in a row keeps company with it, however far apart its points are: its `isolation`
        (m,) changes. Returns searches of all that is real, the groups (m,) from 0 on, their
        separation (m,), and which points are in small groups that are straight, bool (m,).
        """
        in_row = np.zeros(len(self.rows), bool)
        if len(self.rows):
            in_row = self._part_rows()
            self._join_pieces()
        self.rest.others.release()
        groups = self.all_groups
        groups[self.rows] = self.n_large + self.groups
        separation, straight = np.zeros(len(groups)), np.zeros(len(groups), bool)
        small = self._are_small()
        real, some = self._real(small), self.rows[small]
        found = self._separation(some, groups[some], self._gaps(small, real))
        separation[some], straight[some] = found
        in_row = self.rows[in_row | straight[self.rows]]
        isolation[in_row] = np.minimum(isolation[in_row], separation[in_row])
        if self.rest.has_surface:
            self._separate_large(groups, some, separation)
        real = [self.rest.reference] * self.rest.has_surface + real
        for search in real:
            search.release()
        return real, groups, separation, straight

    def _are_small(self):
        """Which points are in groups too small for a thing, bool."""
        sizes = np.bincount(self.groups, self.counts)
        small = sizes < self.least
        if not self.rest.has_surface:
            small &= sizes < max(sizes.max(initial=0), self.most)
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
        nearest others, and among the nearest of each other. Returns which points are, bool."""
        m, n_near = len(self.rows), self.rest.limits.n_near
        in_row, asked, links = np.zeros(m, bool), np.flatnonzero(self._are_small()), []
        if self.rest.others.n <= n_near or len(asked) == 0:
            return in_row

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
        in_row[rows] = straight
        self.groups[rows[straight]] = m + part[straight]
        self.groups = _numbered(self.groups)
        return in_row

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
        group, points = _numbered(groups), self.rest.points[rows]
        separation, straight = separation_of_groups(points, group, self.usual[rows], gaps)
        return separation[group], straight[group]

    def _separate_large(self, groups, small, separation):
        """Fill the separation of large groups that stand off from all else, `small` points apart:
        over how many times as large they are as the least thing. What is large by copies alone is
        real."""
        counts, sizes = np.bincount(groups, self.rest.counts), np.bincount(groups)
        weight, large = self.least / counts, sizes >= self.least
        # One point of each group, and the least size that it may have, tell which may stand off.
        one = np.empty(len(sizes), np.intp)
        one[groups] = np.arange(len(groups))
        gaps = self.gaps[one[large]]
        size = np.bincount(groups, self.usual)[large] / sizes[large]
        stands_off = ExplainLimits().explained
        large[large] = ratio(gaps, size) * weight[large] > (1 - 1e-9) * stands_off
        rows = np.flatnonzero(large[groups])
        groups, gaps = groups[rows], self.gaps[rows]
        apart = self._separation(rows, groups, gaps)[0] * weight[groups] > stands_off
        rows, groups, gaps = rows[apart], groups[apart], gaps[apart]
        code = _numbered(groups) + 1  # 0 of all others that are real
        # The codes of two groups differ in one bit at least, so some search is of the other.
        for bit in range(int(code.max(initial=0)).bit_length()):
            one = code >> bit & 1 == 1
            others = self.rest.others.without(np.concatenate([small, rows[one]]))
            searches = others, NearestPoints(self.rest.points[rows[one]])
            for asked, search in zip((one, ~one), searches, strict=True):
                if search.n and asked.any():
                    near = search.query(self.rest.points[rows[asked]], 1, self.n_jobs)[0][:, 0]
                    gaps[asked] = np.minimum(gaps[asked], near)
        separation[rows] = self._separation(rows, groups, gaps)[0] * weight[groups]


def _numbered(groups):
    """Groups as numbers from 0 on: int32."""
    return np.unique(groups, return_inverse=True)[1].astype(np.int32)


def gaps_to(queries, real, n_jobs):
    """Distances of queries to the nearest point that is real, inf if there is none."""
    gaps = np.full(len(queries), np.inf)
    for search in real:
        np.minimum(gaps, search.query(queries, 1, n_jobs)[0][:, 0], out=gaps)
    return gaps
