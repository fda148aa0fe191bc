"""The company of points off the surfaces: rows and pieces among small groups, and how far these
stand off from all that is real."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.outliers._groups import (
    ShapeLimits,
    Shapes,
    Things,
    are_straight,
    gaps_between_groups,
    gaps_of_groups,
    numbered,
    separation_of_groups,
)
from sklearn_mcmd.outliers._off_surface import OffSurface, Unexplained
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._explaining import ExplainLimits, connected
from sklearn_mcmd.runtime._progress import progress_part


def judge_off_surface(unexplained, least, n_jobs):
    """The `OffSurface` of `Unexplained` points, where a thing has `least` measurements."""
    # Step 1: how far each is from others, and what hangs together.
    with progress_part(0.0, 0.2):
        usual, gaps = unexplained.usual_around(unexplained.points, n_jobs)
    with progress_part(0.2, 0.7):
        among_unexplained, linked = unexplained.neighbors(usual, n_jobs)
    isolation = unexplained.isolated(among_unexplained, unexplained.among_all, usual)
    groups = connected(linked)[0]
    del linked
    with progress_part(0.7, 1.0):
        # Step 2: of small groups, what lies in a row is a group, and pieces of one thing are one.
        small = SmallGroups.of(unexplained, gaps, groups, least, n_jobs)
        of_small, in_row = small.divided_by_rows(numbered(groups[small.rows]))
        of_small = small.joined_pieces(of_small)
        unexplained.search.release()
        # Numbers of large groups come first, then those of small ones.
        are_large = np.bincount(groups, unexplained.counts) >= least
        groups = np.cumsum(are_large, dtype=np.int32)[groups] - 1
        groups[small.rows] = np.count_nonzero(are_large) + of_small
        # Step 3: groups that are still small stand off by their gap to all that is real.
        are_small = small.are_small(of_small)
        rows, things = small.rows[are_small], small.things(are_small, among_unexplained)
        beside = things.beside(unexplained.points[rows], unexplained.limits.n_near, n_jobs)
        separation, straight = np.zeros(len(groups)), np.zeros(len(groups), bool)
        separation[rows], straight[rows] = separation_of_groups(
            unexplained.points[rows], groups[rows], usual[rows], small.gaps[are_small], beside
        )
        in_row |= straight[small.rows]
        small.hang(groups, usual, among_unexplained, isolation, separation, in_row)
        # What is in a row keeps company with it, however far apart it is.
        in_row = small.rows[in_row]
        isolation[in_row] = np.minimum(isolation[in_row], separation[in_row])
        if unexplained.has_surface:
            # Step 4: large groups that hang far from all else stand off, too.
            is_real = np.ones(len(groups), bool)
            is_real[rows] = False
            _separate_large(unexplained, usual, gaps, groups, is_real, least, separation, n_jobs)
            unexplained.reference.release()
        things.search.release()
    return OffSurface(
        unexplained=unexplained,
        usual=usual,
        things=things,
        groups=groups,
        straight=straight,
        isolation=isolation,
        separation=separation,
    )


class SmallGroups(NamedTuple):
    """The s points of all groups off the surfaces that have fewer than `least` measurements.

    Methods take the groups of these points, numbers from 0 on, int32 (s,).
    """

    unexplained: Unexplained  # all points off the surfaces
    rows: np.ndarray  # int32 (s,), of the points among these
    points: np.ndarray  # (s, d)
    counts: np.ndarray  # (s,), measurements at each
    gaps: np.ndarray  # (s,), distances from surfaces, inf if there are none
    least: float
    largest_thing: float  # measurements of the largest of the other groups, 0 if there is none
    n_jobs: int | None

    @classmethod
    def of(cls, unexplained, gaps, groups, least, n_jobs):
        """From the `groups` (m,) of all points off the surfaces, and their `gaps` (m,)."""
        counts = np.bincount(groups, unexplained.counts)
        rows = np.flatnonzero((counts < least)[groups]).astype(np.int32)
        return cls(
            unexplained=unexplained,
            rows=rows,
            points=unexplained.points[rows],
            counts=unexplained.counts[rows],
            gaps=gaps[rows] if unexplained.has_surface else np.full(len(rows), np.inf),
            least=least,
            largest_thing=counts[counts >= least].max(initial=0),
            n_jobs=n_jobs,
        )

    def are_small(self, groups):
        """Which points are in groups too small for a thing, bool (s,)."""
        sizes = np.bincount(groups, self.counts)
        small = sizes < self.least
        if not self.unexplained.has_surface:  # something is real: the largest group of all
            small &= sizes < max(sizes.max(initial=0), self.largest_thing)
        return small[groups]

    def things(self, are_small, spacing):
        """The points off the surfaces that are in no small group; `spacing` is of all (m,)."""
        rows = self.rows[are_small]
        return Things(self.unexplained.search.without(rows), np.delete(spacing, rows))

    def gaps_to_real(self, chosen, things):
        """Distances of chosen points from what is real, on surfaces and beside them."""
        gaps = things.beside(self.points[chosen], 1, self.n_jobs)[0]
        return np.minimum(gaps, self.gaps[chosen])

    def hang(self, groups, usual, spacing, isolation, separation, in_row):
        """Lessen the separation of what hangs beside small flat groups that are kept, and so on:
        these are pieces, rows and plates, while errors fill space.

        All arrays but the last, bool (s,), are of all points off the surfaces.
        """
        of_point, limit = groups[self.rows], ExplainLimits().explained
        order, part = np.lexsort(self.points.T[::-1]), numbered(of_point)
        small = self.are_small(of_point)
        strange = small & ~Shapes.of(self.points[order], part[order]).flat[part]
        while True:
            apart = np.where(in_row, 0.0, isolation[self.rows])
            apart = np.maximum(apart, separation[self.rows])
            left = small & (strange | (-gaps_of_groups(part, -apart)[part] > limit))
            rows = self.rows[left]
            gaps = self.gaps_to_real(left, self.things(left, spacing))
            nearer = separation_of_groups(self.points[left], groups[rows], usual[rows], gaps)[0]
            hang = (nearer <= limit) & (separation[rows] > limit)
            if not hang.any():
                return
            separation[rows[hang]] = nearer[hang]

    def places(self, near):
        """Places among these points of rows of all that are off the surfaces; s of the others."""
        places = np.searchsorted(self.rows, near).astype(np.int32)
        np.minimum(places, len(self.rows) - 1, out=places)
        places[self.rows[places] != near] = len(self.rows)
        return places

    def divided_by_rows(self, groups):
        """The groups once points that lie in a row are a group of their own; and which these are.

        They are straight with their nearest others, and among the nearest of each other.
        """
        s, n_near = len(self.rows), self.unexplained.limits.n_near
        in_row, asked, links = np.zeros(s, bool), np.flatnonzero(self.are_small(groups)), []
        if self.unexplained.search.n <= n_near or len(asked) == 0:
            return groups, in_row

        def link(part, distances, near):
            around = self.unexplained.points[near]
            away = around - around.mean(axis=1, keepdims=True)
            covariance = np.einsum("mki,mkj->mij", away, away) / (n_near + 1)
            deviations = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0.0))
            straight = are_straight(deviations, np.full(len(near), n_near + 1))
            from_point = np.repeat(asked[part][straight], n_near)
            to_neighbor = self.places(near[straight, 1:].ravel())
            links.append(np.stack([from_point, to_neighbor])[:, to_neighbor < s])

        self.unexplained.search.visit(self.points[asked], n_near + 1, link, self.n_jobs)
        first, second = np.hstack(links)
        graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(s, s)).tocsr()
        # A product with the transpose leaves links that go both ways.
        part = connected_components(graph * graph.T, directed=False)[1]
        rows = np.flatnonzero(np.bincount(part)[part] > 1)
        rows = rows[np.lexsort(self.points[rows].T[::-1])]
        part = numbered(part[rows])
        straight = Shapes.of(self.points[rows], part).straight[part]
        in_row[rows] = straight
        groups = groups.copy()
        groups[rows[straight]] = s + part[straight]
        return numbered(groups), in_row

    def joined_pieces(self, groups):
        """The groups once those that are pieces of one thing are one."""
        # Step 1: pieces are flat groups, with their gaps to what is real.
        are_small = self.are_small(groups)
        things, rows = self.things(are_small, self.unexplained.among_all), np.flatnonzero(are_small)
        piece = numbered(groups[rows])
        gaps = gaps_of_groups(piece, self.gaps_to_real(rows, things))
        things.search.release()
        order = np.lexsort(self.points[rows].T[::-1])
        shapes = Shapes.of(self.points[rows[order]], piece[order])
        rows, piece = rows[shapes.flat[piece]], piece[shapes.flat[piece]]
        if len(rows) == 0:
            return groups
        # Step 2: link those that are no farther apart than some of their lengths. What is no piece
        # reaches nowhere; the last place stands for all points that are not in small groups.
        s, pairs = len(self.rows), []
        reach, piece_of = np.full(s + 1, -np.inf), np.full(s + 1, -1, np.int32)
        reach[rows], piece_of[rows] = ShapeLimits().apart * shapes.length[piece], piece

        def link(part, distances, near):
            asked, near = rows[part], self.places(near)
            reaches = reach[near] + reach[asked, None]
            i, j = np.nonzero((distances <= reaches) & (piece_of[near] != piece_of[asked, None]))
            distances, reaches, first, second = distances[i, j], reaches[i, j], asked[i], near[i, j]
            a, b = piece_of[first], piece_of[second]
            farther = np.maximum(gaps[a], gaps[b])
            # One of both, at least, is as near to the other as to anything real; or both have one
            # plane. Far off nothing real is beside them, and what is far from it reaches less far.
            linked = distances <= farther
            linked |= shapes.are_coplanar(a, b, self.points[first], self.points[second])
            linked &= distances * farther <= reaches**2
            both = np.stack([groups[first], groups[second]])
            pairs.append(np.unique(both[:, linked], axis=1))

        # A small group has fewer than `least` points, so one of another is among as many.
        n_asked = int(np.ceil(self.least))
        self.unexplained.search.visit(self.points[rows], n_asked, link, self.n_jobs)
        first, second = np.hstack(pairs)
        shape = (groups.max() + 1,) * 2
        graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=shape)
        return connected_components(graph, directed=False)[1][groups]


def _separate_large(unexplained, usual, gaps, groups, is_real, least, separation, n_jobs):
    """Fill the separation of large groups that stand off from all that `is_real`, bool (m,).

    A group of n times as many measurements as the least thing must stand off n times as far. What
    is large by copies alone is real.
    """
    weight, sizes = least / np.bincount(groups, unexplained.counts), np.bincount(groups)
    # Step 1: one point of each group, and the least size that it may have, tell which may stand
    # off. The sums of sizes come in another order than below, and differ by rounding.
    a_point = np.empty(len(sizes), np.intp)
    a_point[groups] = np.arange(len(groups))
    size = ratio(np.bincount(groups, usual), sizes)
    stands_off = ExplainLimits().explained
    far = ratio(gaps[a_point], size) * weight > (1 - 1e-9) * stands_off
    rows = np.flatnonzero(((sizes >= least) & far)[groups])
    # Step 2: all points of these groups tell.
    points, of_row, spacing = unexplained.points[rows], groups[rows], usual[rows]
    apart = separation_of_groups(points, of_row, spacing, gaps[rows])[0] * weight[of_row]
    rows = rows[apart > stands_off]
    # Step 3: others that hang there, too, are real to them.
    code = np.zeros(len(groups), np.int32)
    code[rows] = 1 + numbered(groups[rows])
    gaps = gaps.copy()
    gaps[is_real] = np.minimum(
        gaps[is_real], gaps_between_groups(unexplained.points[is_real], code[is_real], n_jobs)
    )
    points, of_row, spacing = unexplained.points[rows], groups[rows], usual[rows]
    apart = separation_of_groups(points, of_row, spacing, gaps[rows])[0]
    separation[rows] = apart * weight[of_row]
