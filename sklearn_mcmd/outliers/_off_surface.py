"""Points that no surface explains: how far each, or its group, stands off from all that is real."""

from dataclasses import dataclass
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
from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._explaining import ExplainLimits, connected
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.runtime._progress import progress_part

AT_ONCE = 1_000_000  # rows that are copied at once; it limits the memory


class OffSurfaceLimits(NamedTuple):
    """How points off the surfaces are judged by their company."""

    n_near: int = 8  # spacing is the mean distance to this many neighbors
    n_usual: int = 128  # nearest points on surfaces, of whose spacings a quantile is usual
    usual: float = 0.75  # this quantile is usual
    # Where no point is on a surface, the usual spacing is this quantile of those of all points: the
    # sparse quarter of them would be the very points that are judged.
    half: float = 0.5
    reach: float = 2.5  # two points are of one group if they are within this many usual spacings
    # Weight of the spacing among off-surface points against that among all points, in their
    # geometric mean.
    rest_weight: float = 2 / 3
    thing: float = 2.0  # a thing has as many points as this many neighborhoods
    # Dimensions from which on company is everywhere. Of gross errors beside a plane, 10 % of 1,000
    # points, company tells 88 % and more in 4D, 22 % in 5D and 4 % in 6D; planes alone tell all.
    crowded: int = 5


@dataclass
class OffSurface:
    """The m points that no surface explains, as `MCMDOutlierDetector` judges their company.

    Scanners measure the skins of things, and where their lines are far apart, a thing lies in
    pieces, which are flat; of a wire or a pole there is no more than a row of points. Ghosts fill
    space.
    """

    rest: "Rest"
    usual: np.ndarray  # (m,), the usual spacing around each point
    real: list  # searches of the points that are real
    groups: np.ndarray  # (m,), from 0 on; pieces of one thing are one group
    straight: np.ndarray  # bool (m,), in a small group that is straight
    isolation: np.ndarray  # (m,), as the separation: see `measure`
    separation: np.ndarray

    def measure(self, queries, spacing):
        """How far m new points stand off, each as if it were alone added to the cloud.

        `spacing` (m,) is the mean distance of each to its nearest measurements. Isolation is the
        spacing among off-surface points and among all points, over the usual one; what has others
        near has about 1. Separation is the gap between the query, with the small group that it
        belongs to, and what is real, over their size; 0 for what belongs to a thing. The third says
        whether a query belongs to a group of the cloud, whose separation it has.
        """
        rest, limits = self.rest, self.rest.limits
        usual = rest.usual_around(queries, None)
        distances, near = rest.others.query(queries, limits.n_near, None)
        among_rest = rest.spacing(queries, distances, near, itself=False)
        steps = _steps(usual, self.usual, distances[:, :1], near[:, :1])[:, 0]
        separation = ratio(_gaps(queries, self.real, None), usual)
        joined = steps <= limits.reach
        separation[joined] = self.separation[near[joined, 0]]
        return rest.isolated(among_rest, spacing, usual), separation, joined


class Rest(NamedTuple):
    """The m points that no surface explains, and what is asked around them."""

    cloud: NeighborIndex
    limits: OffSurfaceLimits
    box: tuple  # low and high corner of the cloud
    reference: NearestPoints  # of points on surfaces, of all points if there are none
    reference_spacing: np.ndarray  # theirs
    quantile: float  # of these spacings, which is usual
    has_surface: bool  # whether any point is on a surface
    others: NearestPoints  # of the points themselves
    rows: np.ndarray  # (m,), in the cloud
    points: np.ndarray
    counts: np.ndarray  # (m,), measurements at each
    among_all: np.ndarray  # (m,), the mean distance to the nearest measurements

    @classmethod
    def of(cls, index, counts, explained, spacing, other_spacing, limits):
        """Of the n distinct points of an index those that are not `explained`, bool (n,).

        `counts` (n,) are measurements: a place measured often is near to itself. Spacings (n,) are
        mean distances to the nearest measurements, and to those at other places, never 0.
        """
        rows, any_explained = np.flatnonzero(~explained), explained.any()
        if any_explained:
            other_spacing = chosen_rows(index, other_spacing, explained)
        return cls(
            cloud=index,
            limits=limits,
            box=(index.points.min(axis=0), index.points.max(axis=0)),
            reference=index.among(explained if any_explained else ~explained),
            reference_spacing=other_spacing,
            quantile=limits.usual if any_explained else limits.half,
            has_surface=bool(any_explained),
            others=index.among(~explained),
            rows=rows,
            points=chosen_rows(index, index.points, ~explained),
            counts=counts[rows],
            among_all=spacing[rows],
        )

    def usual_around(self, queries, n_jobs):
        """Spacing that is usual on the surfaces around queries."""
        n_usual = min(self.limits.n_usual, len(self.reference_spacing))
        usual, place = np.empty(len(queries)), int(self.quantile * n_usual)

        def measure(rows, distances, near):
            spacings = self.reference_spacing[near]
            usual[rows] = np.partition(spacings, place, axis=1)[:, place]

        self.reference.visit(queries, n_usual, measure, n_jobs)
        return usual

    def neighbors(self, usual, n_jobs):
        """Mean distance of each point to others, and those that are of its group."""
        m, n_links = len(self.points), max(SurfaceLimits().n_links, self.limits.n_near)
        own = np.arange(m, dtype=np.int32)  # as `connected` takes them
        among_rest, linked = np.empty(m), self.cloud.empty((m, n_links), np.int32)

        def measure(rows, distances, near):
            among_rest[rows] = self.spacing(self.points[rows], distances, near, itself=True)
            steps = _steps(usual[rows], usual, distances[:, 1:], near[:, 1:])
            linked[rows] = np.where(steps <= self.limits.reach, near[:, 1:], own[rows][:, None])

        self.others.visit(self.points, n_links + 1, measure, n_jobs)
        return among_rest, linked

    def spacing(self, queries, distances, near, itself):
        """Mean distance of queries to off-surface points, `itself` among these or not."""
        counts = np.append(self.counts, self.limits.n_near)[near]  # of a missing one: all
        counts[:, 0] -= itself
        # Those that are missing are as far away as the cloud with the query in it is large.
        extent = np.maximum(queries, self.box[1]) - np.minimum(queries, self.box[0])
        extent = np.linalg.norm(extent, axis=1)[:, None]
        distances = np.where(np.isinf(distances), extent, distances)
        return mean_distance(distances, counts, self.limits.n_near)

    def isolated(self, among_rest, among_all, usual):
        """Most weight is on off-surface points: what lies near surfaces may be alone off them."""
        weight = self.limits.rest_weight
        return ratio(among_rest**weight * among_all ** (1 - weight), usual)

    def real(self, groups, least):
        """Which groups are too small for a thing, and searches of what is real: the points on
        surfaces, and those of the other groups."""
        sizes = np.bincount(groups, self.counts)
        small, real = sizes < least, [self.reference]
        if not self.has_surface:
            small &= sizes < sizes.max(initial=0)
            real = []
        if not small[groups].all():
            real.append(self.search_of(~small[groups]))
        return small, real

    def search_of(self, wanted):
        """Search of those points that are wanted, bool (m,)."""
        chosen = np.zeros(len(self.cloud.points), bool)
        chosen[self.rows[wanted]] = True
        return self.cloud.among(chosen)


def judge_off_surface(rest, least, n_jobs):
    """The `OffSurface` of the `Rest`, where a thing has `least` measurements."""
    with progress_part(0.0, 0.2):
        usual = rest.usual_around(rest.points, n_jobs)
    with progress_part(0.2, 0.7):
        among_rest, linked = rest.neighbors(usual, n_jobs)
    isolation = rest.isolated(among_rest, rest.among_all, usual)
    groups = connected(linked)[0]
    del linked
    groups, in_row = _rows_parted(rest, groups, least, n_jobs)
    groups = _pieces_joined(rest, groups, least, n_jobs)
    rest.others.release()
    small, real = rest.real(groups, least)
    with progress_part(0.7, 1.0):
        separation, straight = np.zeros(len(groups)), np.zeros(len(groups), bool)
        rows = np.flatnonzero(small[groups])
        if len(rows):
            gaps = _gaps(rest.points[rows], real, n_jobs)
            separation[rows], straight[rows] = _separation(rest, usual, groups, rows, gaps)
            # What is in a row keeps company with it, however far apart its points are.
            isolation = np.where(in_row | straight, np.minimum(isolation, separation), isolation)
        if rest.has_surface:
            _separate_large(rest, usual, groups, least, small, separation, n_jobs)
    for search in real:
        search.release()
    return OffSurface(
        rest=rest,
        usual=usual,
        real=real,
        groups=groups,
        straight=straight,
        isolation=isolation,
        separation=separation,
    )


def _rows_parted(rest, groups, least, n_jobs):
    """The groups, where points of small ones that lie in a row are a group of their own, and which
    points these are: straight with their nearest others, and among the nearest of each other."""
    m, n_near = len(groups), rest.limits.n_near
    asked = np.flatnonzero(rest.real(groups, least)[0][groups])
    in_row, links = np.zeros(m, bool), []
    if m <= n_near or len(asked) == 0:
        return groups, in_row

    def link(some, distances, near):
        away = rest.points[near] - rest.points[near].mean(axis=1, keepdims=True)
        covariance = np.einsum("mki,mkj->mij", away, away) / (n_near + 1)
        deviations = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0.0))
        straight = are_straight(deviations, np.full(len(near), n_near + 1))
        own = np.repeat(asked[some][straight], n_near)
        links.append(np.stack([own, near[straight, 1:].ravel()]))

    rest.others.visit(rest.points[asked], n_near + 1, link, n_jobs)
    one, other = np.hstack(links)
    graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=(m, m)).tocsr()
    part = connected_components(graph * graph.T, directed=False)[1]
    rows = np.flatnonzero(np.bincount(part)[part] > 1)
    rows = rows[np.lexsort(rest.points[rows].T[::-1])]
    _, part = np.unique(part[rows], return_inverse=True)
    straight = Shapes.of(rest.points[rows], part).straight[part]
    groups, in_row[rows] = groups.copy(), straight
    groups[rows[straight]] = m + part[straight]
    return np.unique(groups, return_inverse=True)[1], in_row


def _pieces_joined(rest, groups, least, n_jobs):
    """The groups, where those that are pieces of one thing are one."""
    small, real = rest.real(groups, least)
    rows = np.flatnonzero(small[groups])
    rows = rows[np.lexsort(rest.points[rows].T[::-1])]
    _, group = np.unique(groups[rows], return_inverse=True)
    gaps = gaps_of_groups(group, _gaps(rest.points[rows], real, n_jobs))
    for search in real[1:]:
        search.release()
    shapes = Shapes.of(rest.points[rows], group)
    rows, group = rows[shapes.flat[group]], group[shapes.flat[group]]
    if len(rows) == 0:
        return groups
    # Pieces of a thing are no farther apart than a few of their lengths.
    reach, pairs = np.full(len(groups) + 1, -np.inf), []  # the last is of a missing point
    reach[rows] = ExplainLimits().explained * shapes.length[group]
    piece = np.full(len(reach), -1, np.int32)
    piece[rows] = group

    def link(some, distances, near):
        own = rows[some]
        others = piece[near] != piece[own, None]
        i, j = np.nonzero(others & (distances <= reach[own, None] + reach[near]))
        distances, one, other = distances[i, j], own[i], near[i, j]
        a, b = piece[one], piece[other]
        # One of both, at least, is as near to the other as to anything real; or both have one
        # plane.
        linked = distances <= np.maximum(gaps[a], gaps[b])
        linked |= shapes.are_coplanar(a, b, rest.points[one], rest.points[other])
        pairs.append(np.unique(np.stack([groups[one], groups[other]])[:, linked], axis=1))

    # A small group has fewer points, so one of another is among them.
    rest.others.visit(rest.points[rows], int(np.ceil(least)), link, n_jobs)
    one, other = np.hstack(pairs)
    shape = len(small), len(small)
    graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=shape)
    return connected_components(graph, directed=False)[1][groups]


def _steps(usual, usual_of_rest, distances, near):
    """Distances (m, w) to neighbors in usual spacings, the smaller of both points'."""
    usual_there = np.append(usual_of_rest, np.inf)[near]  # the last is that of a missing one
    return ratio(distances, np.minimum(usual[:, None], usual_there))


def _gaps(queries, real, n_jobs):
    """Distances of queries to the nearest point that is real."""
    gaps = np.full(len(queries), np.inf)
    for search in real:
        np.minimum(gaps, search.query(queries, 1, n_jobs)[0][:, 0], out=gaps)
    return gaps


def _separation(rest, usual, groups, rows, gaps):
    """Of each of these rows the separation of its group, none of whose points is left out, and
    whether the group is straight."""
    _, group = np.unique(groups[rows], return_inverse=True)
    separation, straight = separation_of_groups(rest.points[rows], group, usual[rows], gaps)
    return separation[group], straight[group]


def _separate_large(rest, usual, groups, least, small, separation, n_jobs):
    """Fill the separation of large groups that stand off from all else: over how many times as
    large they are as the least thing. What is large by copies alone is real."""
    stands_off = ExplainLimits().explained
    # One point of each group, and the least size that it may have, tell which may stand off.
    one = np.empty(len(small), np.intp)
    one[groups[::-1]] = np.arange(len(groups))[::-1]
    sizes = np.bincount(groups)
    usual_of = np.bincount(groups, usual) / sizes
    weight, large = least / np.bincount(groups, rest.counts), sizes >= least
    gaps = _gaps(rest.points[one[large]], [rest.reference], n_jobs)
    large[large] = ratio(gaps, usual_of[large]) * weight[large] > (1 - 1e-9) * stands_off
    rows = np.flatnonzero(large[groups])
    gaps = _gaps(rest.points[rows], [rest.reference], n_jobs)
    apart = _separation(rest, usual, groups, rows, gaps)[0] * weight[groups[rows]] > stands_off
    rows, gaps = rows[apart], gaps[apart]
    if len(rows) == 0:
        return
    _, number = np.unique(groups[rows], return_inverse=True)
    code = np.where(small[groups], -1, 0)  # of each point; 0 of those that are real
    code[rows] = number + 1
    # The numbers of two groups differ in one bit at least, so some search is of the other.
    for bit in range(int(code.max()).bit_length()):
        for value in (0, 1):
            others = (code >= 0) & (code >> bit & 1 != value)
            asked = np.flatnonzero(code[rows] >> bit & 1 == value)
            if others.any() and len(asked):
                near = rest.search_of(others).query(rest.points[rows[asked]], 1, n_jobs)[0][:, 0]
                gaps[asked] = np.minimum(gaps[asked], near)
    separation[rows] = _separation(rest, usual, groups, rows, gaps)[0] * weight[groups[rows]]


def mean_distance(distances, counts, n_near):
    """Mean distance to the `n_near` nearest measurements, or to all if fewer: distances (m, w)
    ascend, and `counts` are the measurements at each."""
    reached = np.minimum(np.cumsum(counts, axis=1), n_near)
    taken = np.diff(reached, axis=1, prepend=0)
    return (taken * distances).sum(axis=1) / np.maximum(reached[:, -1], 1)


def chosen_rows(index, values, chosen):
    """Those of the values (n, ...) that are chosen, bool (n,), as an array of the index."""
    rows = index.empty((np.count_nonzero(chosen), *values.shape[1:]), values.dtype)
    end = 0
    for first in range(0, len(values), AT_ONCE):  # so that no more is in memory
        part = values[first : first + AT_ONCE][chosen[first : first + AT_ONCE]]
        rows[end : end + len(part)], end = part, end + len(part)
    return rows
