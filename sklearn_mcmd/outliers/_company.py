"""Company: how far a point that no surface explains stands off from everything real."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._linking import connected
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.runtime._progress import progress_part

__all__ = ["Company", "CompanyLimits", "Places", "chosen_rows", "mean_distance"]

# Where no point is on a surface, what is usual is half of all points: the sparse quarter of them
# would be the very points that are judged.
HALF = 0.5
# Each point of the rest is linked to at most so many others, as those of surfaces are.
LINKED = SurfaceLimits().n_links
AT_ONCE = 1_000_000  # rows that are copied
# Length of an evenly filled line, in its standard deviations.
LENGTH = np.sqrt(12.0)


class CompanyLimits(NamedTuple):
    """What keeps company.

    n_near : int
        Spacing is the mean distance to this many neighbors.
    n_usual : int
        The usual spacing around a point is that of this many nearest points on surfaces.
    usual : float
        Of their spacings it is this quantile.
    reach : float
        Two points of the rest are of one group if they are within this many usual spacings.
    rest_weight : float
        Weight of the spacing among the rest against that among all points, in their geometric
        mean.
    flat : float
        A group is flat if its standard deviation along its longest axis is so many times the one
        off its plane.
    bridge : float
        Flat groups are pieces of one thing if they are within so many lengths of the longer one.
    """

    n_near: int = 8
    n_usual: int = 128
    usual: float = 0.75
    reach: float = 2.5
    rest_weight: float = 2 / 3
    flat: float = 3.0
    bridge: float = 3.0


class Places(NamedTuple):
    """The places of a cloud, which are its distinct points, and how close they lie.

    cloud : NeighborIndex, or what answers as one
        Of n points.
    counts : ndarray of int of shape (n,)
        Measurements at each: a place that was measured often keeps company with itself.
    explained : ndarray of bool of shape (n,)
        Points that a surface explains. All others are the rest.
    spacing : ndarray of shape (m,)
        Mean distance of each of the rest to its nearest measurements, by `mean_distance`.
    usual_spacing : ndarray of shape (n - m,), or (n,) if a surface explains none
        The same of the others, to measurements at other places, which is never 0.
    """

    cloud: NeighborIndex
    counts: np.ndarray
    explained: np.ndarray
    spacing: np.ndarray
    usual_spacing: np.ndarray

    @classmethod
    def of(cls, index, counts, explained, spacing, other_spacing):
        """From both spacings of all points, which need not be kept."""
        if explained.any():
            other_spacing = chosen_rows(index, other_spacing, explained)
        return cls(index, counts, explained, spacing[~explained], other_spacing)


class Company:
    """The points that no surface explains, the rest: things such as foliage and wires, or errors.

    No plane can tell these apart. What tells is how far a point, or the small group that it
    belongs to, stands off from everything else, in units of its own size. The size of a point is
    the usual spacing of the surfaces around. The size of a group is its standard deviation along
    its longest axis.

    Scanners measure the skins of things, and where their lines are far apart, a thing lies in
    pieces, which are flat. So flat groups near each other are one group. Ghosts fill space.

    Parameters
    ----------
    places : Places
    least : float
        A group of this many measurements is a thing, however far it stands off.
    limits : CompanyLimits
    n_jobs : int or None

    Attributes
    ----------
    rest : ndarray of int of shape (m,)
        Rows of the points that no surface explains.
    groups : ndarray of int of shape (m,)
        Group of each, from 0 on; pieces of one thing are one group.
    isolation, separation : ndarray of shape (m,)
        Theirs, see `measure`.
    """

    def __init__(self, places, least, limits, n_jobs):
        index, explained = places.cloud, places.explained
        self.limits = limits
        self.low, self.high = index.points.min(axis=0), index.points.max(axis=0)
        self.reference = index.among(explained if explained.any() else ~explained)
        self.reference_spacing = places.usual_spacing
        self.quantile = limits.usual if explained.any() else HALF
        self.rest = rest = np.flatnonzero(~explained)
        self.points, self.counts = chosen_rows(index, index.points, ~explained), places.counts[rest]
        self.others = index.among(~explained)
        with progress_part(0.0, 0.2):
            self.usual = self._usual(self.points, n_jobs)
        with progress_part(0.2, 0.7):
            among_rest, linked = self._neighbors(index, n_jobs)
        self.isolation = self._isolated(among_rest, places.spacing, self.usual)
        groups = connected(linked)[0]
        del linked
        small = self._small(groups, least, explained)
        self.groups = groups = self._joined(groups, small, least, n_jobs)
        self.others.release()
        small = self._small(groups, least, explained)
        # What is real: the points on surfaces, and those of large groups.
        self.real = [self.reference] if explained.any() else []
        large = np.zeros(len(explained), bool)
        large[rest[~small[groups]]] = True
        if large.any():
            self.real.append(index.among(large))
        with progress_part(0.7, 1.0):
            self.separation = self._separated(groups, small, n_jobs)
        for real in self.real:
            real.release()

    def measure(self, queries, spacing, n_jobs=None):
        """How far m new points stand off, each as if it were alone added to the cloud.

        `spacing` (m,) is the mean distance of each to its nearest measurements. Returns, of each,

        - isolation: spacing among the rest and among all points, over the usual one; what keeps
          company has about 1;
        - separation: gap between the query, with the small group that it belongs to, and what is
          real, over their size; 0 for what belongs to a large group;
        - joined: whether it belongs to a group of the cloud, whose separation it has.
        """
        usual = self._usual(queries, n_jobs)
        distances, near = self.others.query(queries, self.limits.n_near, n_jobs)
        among_rest = self._among_rest(queries, distances, near, itself=False)
        steps = self._steps(usual, distances[:, :1], near[:, :1])[:, 0]
        separation = ratio(self._gaps(queries, n_jobs), usual)
        joined = steps <= self.limits.reach
        separation[joined] = self.separation[near[joined, 0]]
        return self._isolated(among_rest, spacing, usual), separation, joined

    def _usual(self, queries, n_jobs):
        """Spacing that is usual on the surfaces around queries."""
        n_usual = min(self.limits.n_usual, len(self.reference_spacing))
        usual = np.empty(len(queries))

        def measure(rows, distances, near):
            usual[rows] = usual_of(self.reference_spacing[near], self.quantile)

        self.reference.visit(queries, n_usual, measure, n_jobs)
        return usual

    def _neighbors(self, index, n_jobs):
        """Mean distance of each of the rest to others of it, and those that are of its group."""
        m, n_links = len(self.points), max(LINKED, self.limits.n_near)
        own = np.arange(m, dtype=np.int32)  # as `connected` takes them
        among_rest, linked = np.empty(m), index.empty((m, n_links), np.int32)

        def measure(rows, distances, near):
            queries = self.points[rows]
            among_rest[rows] = self._among_rest(queries, distances, near, itself=True)
            steps = self._steps(self.usual[rows], distances[:, 1:], near[:, 1:])
            linked[rows] = np.where(steps <= self.limits.reach, near[:, 1:], own[rows][:, None])

        self.others.visit(self.points, n_links + 1, measure, n_jobs)
        return among_rest, linked

    def _small(self, groups, least, explained):
        """Which groups are too small for a thing."""
        sizes = np.bincount(groups, self.counts)
        small = sizes < least
        return small if explained.any() else small & (sizes < sizes.max(initial=0))

    def _joined(self, groups, small, least, n_jobs):
        """The groups, where those that are pieces of one thing are one."""
        rows = np.flatnonzero(small[groups])
        _, group = np.unique(groups[rows], return_inverse=True)
        length = np.zeros(len(groups))
        length[rows] = lengths_of_pieces(self.points[rows], group, self.limits)[group]
        rows = np.flatnonzero(length)
        if len(rows) == 0:
            return groups
        length_there, group_there = np.append(length, 0.0), np.append(groups, -1)
        pairs = []

        def link(some, distances, near):
            own = rows[some]
            i, j = np.nonzero(
                are_pieces(length[own], length_there[near], distances, self.limits.bridge)
            )
            pair = np.stack([groups[own[i]], group_there[near[i, j]]])
            pairs.append(np.unique(pair, axis=1))

        # A small group has fewer points, so one of another is among them.
        self.others.visit(self.points[rows], int(np.ceil(least)), link, n_jobs)
        one, other = np.hstack(pairs)
        shape = len(small), len(small)
        graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=shape)
        return connected_components(graph, directed=False)[1][groups]

    def _among_rest(self, queries, distances, near, itself):
        counts = np.append(self.counts, self.limits.n_near)[near]  # of a missing one: all
        counts[:, 0] -= itself
        box = self.low, self.high
        return mean_distance_to_rest(queries, distances, counts, box, self.limits.n_near)

    def _isolated(self, among_rest, among_all, usual):
        return isolation_of(among_rest, among_all, usual, self.limits.rest_weight)

    def _steps(self, usual, distances, near):
        usual_there = np.append(self.usual, np.inf)[near]  # the last is that of a missing one
        return steps_between(usual, usual_there, distances)

    def _gaps(self, queries, n_jobs):
        """Distances of queries to the nearest point that is real."""
        gaps = np.full(len(queries), np.inf)
        for real in self.real:
            np.minimum(gaps, real.query(queries, 1, n_jobs)[0][:, 0], out=gaps)
        return gaps

    def _separated(self, groups, small, n_jobs):
        """Gap of each point's group over the size of the group, 0 if that is large."""
        rows = np.flatnonzero(small[groups])
        separation = np.zeros(len(groups))
        if len(rows) == 0:
            return separation
        _, group = np.unique(groups[rows], return_inverse=True)
        points = self.points[rows]
        gaps = self._gaps(points, n_jobs)
        separation[rows] = separation_of_groups(points, group, self.usual[rows], gaps)[group]
        return separation


def chosen_rows(index, values, chosen):
    """Those of the values (n, ...) that are chosen, bool (n,), as an array of the index."""
    rows = index.empty((np.count_nonzero(chosen), *values.shape[1:]), values.dtype)
    end = 0
    for first in range(0, len(values), AT_ONCE):  # so that no more is in memory
        part = values[first : first + AT_ONCE][chosen[first : first + AT_ONCE]]
        rows[end : end + len(part)], end = part, end + len(part)
    return rows


def usual_of(spacings, share):
    """The spacing (m,) that is usual among the nearest points on surfaces, (m, k)."""
    place = int(share * spacings.shape[1])
    return np.partition(spacings, place, axis=1)[:, place]


def mean_distance_to_rest(queries, distances, counts, box, n_near):
    """Mean distance to the nearest of the rest. Those that are missing are as far away as
    the cloud, whose low and high corner are the `box`, is large with the query in it."""
    low, high = box
    extent = np.maximum(queries, high) - np.minimum(queries, low)
    extent = np.linalg.norm(extent, axis=1)
    distances = np.where(np.isinf(distances), extent[:, None], distances)
    return mean_distance(distances, counts, n_near)


def isolation_of(among_rest, among_all, usual, rest_weight):
    """Most weight is on the rest: surfaces are poor company for what lies off them."""
    return ratio(among_rest**rest_weight * among_all ** (1 - rest_weight), usual)


def steps_between(usual, usual_there, distances):
    """Distances (m, w) to neighbors in usual spacings, the smaller of both points'."""
    return ratio(distances, np.minimum(usual[:, None], usual_there))


def lengths_of_pieces(points, group, limits):
    """Length of each group that is flat, 0 of the others.

    Sums are taken as by `separation_of_groups`. The deviation off the plane has as many degrees of
    freedom as there are points beyond those that a plane needs, and counts with its standard error:
    few points are flat by chance.
    """
    order = np.lexsort(points.T[::-1])
    sizes = np.bincount(group)
    spare = sizes - points.shape[1]
    deviations = _deviations(points[order], group[order], sizes, spare > 0)
    longest = deviations[:, -1]
    spare = np.maximum(spare, 1)
    off = deviations[:, 0] * np.sqrt(sizes / spare) * (1 + 1 / np.sqrt(2 * spare))
    return np.where(limits.flat * off <= longest, LENGTH * longest, 0.0)


def are_pieces(length, length_there, distances, bridge):
    """Whether points of flat groups belong to one thing with those that they are near to.

    `length` (m,) is of the group of each point, `length_there` (m, w) of that of each neighbor, 0
    if it is no piece, and `distances` (m, w) are how far away that is.
    """
    near = distances <= bridge * np.maximum(length[:, None], length_there)
    return near & (length_there > 0)


def separation_of_groups(points, group, usual, gaps):
    """Gap of each group over the size of the group.

    Sums are taken in the order of coordinates, so they do not depend on the order of the points
    (m, d). Of each, `group` is its group, from 0 on, `usual` the usual spacing around it, and
    `gaps` its distance to the nearest that is real.
    """
    order = np.lexsort(points.T[::-1])
    points, group, usual = points[order], group[order], usual[order]
    sizes = np.bincount(group)
    gap = np.full(len(sizes), np.inf)
    np.minimum.at(gap, group, gaps[order])
    size = np.bincount(group, usual) / sizes
    size = np.maximum(size, _deviations(points, group, sizes, sizes > 1)[:, -1])
    return ratio(gap, size)


def mean_distance(distances, counts, n_near):
    """Mean distance to the `n_near` nearest measurements, or to all that there are.

    Distances (m, w) to neighbors are ascending; `counts` are the measurements at each of these.
    """
    reached = np.minimum(np.cumsum(counts, axis=1), n_near)
    taken = np.diff(reached, axis=1, prepend=0)
    return (taken * distances).sum(axis=1) / np.maximum(reached[:, -1], 1)


def _deviations(points, group, sizes, asked):
    """Standard deviations of groups along their axes, ascending; 0 of those that are not asked."""
    d = points.shape[1]
    covariance = np.zeros((len(sizes), d, d))
    centers = np.stack([np.bincount(group, points[:, i]) / sizes for i in range(d)], axis=1)
    away = points - centers[group]
    for i in range(d):
        for j in range(i + 1):
            covariance[:, i, j] = np.bincount(group, away[:, i] * away[:, j]) / sizes
    deviations = np.zeros((len(sizes), d))
    deviations[asked] = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance[asked]), 0.0))
    return deviations
