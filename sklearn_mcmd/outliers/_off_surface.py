"""Points that no surface explains: how far each, or its group, stands off from all that is real."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sklearn_mcmd.outliers._groups import are_flat_groups, gaps_of_groups, separation_of_groups
from sklearn_mcmd.outliers._isolation import chosen_rows, mean_distance_to_rest
from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._explaining import connected
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.runtime._progress import progress_part

__all__ = ["OffSurface", "OffSurfaceLimits", "Places"]

# Where no point is on a surface, what is usual is half of all points: the sparse quarter of them
# would be the very points that are judged.
HALF = 0.5
# Each off-surface point is linked to at most so many others, as those of surfaces are.
LINKED = SurfaceLimits().n_links
# Larger groups stand off by more sizes than this, or count as things.
STANDS_OFF = SurfaceLimits().explained


class OffSurfaceLimits(NamedTuple):
    """When points are near each other.

    Two off-surface points are of one group if they are within `reach` usual spacings. The usual
    spacing around a point is the quantile `usual` of those of the `n_usual` nearest points on
    surfaces. A group is flat if its standard deviation along its longest axis is `flat` times the
    one off its plane.
    """

    n_near: int = 8  # spacing is the mean distance to this many neighbors
    n_usual: int = 128
    usual: float = 0.75
    reach: float = 2.5
    # Weight of the spacing among off-surface points against that among all points, in their
    # geometric mean.
    rest_weight: float = 2 / 3
    flat: float = 3.0


class Places(NamedTuple):
    """The places of a cloud, which are its n distinct points, and how close they lie.

    Points that a surface explains are `explained`, bool (n,); the other m are off-surface points.
    Their `spacing` (m,) is the mean distance to the nearest measurements, by `mean_distance`. The
    `usual_spacing` is that of the explained, or of all if there are none, to measurements at other
    places, which is never 0.
    """

    cloud: NeighborIndex  # or what answers as one
    counts: np.ndarray  # measurements at each: a place measured often is near to itself
    explained: np.ndarray
    spacing: np.ndarray
    usual_spacing: np.ndarray

    @classmethod
    def of(cls, index, counts, explained, spacing, other_spacing):
        """From both spacings of all points, which need not be kept."""
        if explained.any():
            other_spacing = chosen_rows(index, other_spacing, explained)
        return cls(index, counts, explained, spacing[~explained], other_spacing)


class OffSurface:
    """The points that no surface explains: things such as foliage and wires, or errors.

    No plane can tell these apart. What tells is how far a point, or the small group that it
    belongs to, stands off from everything else, in units of its own size. The size of a point is
    the usual spacing of the surfaces around. The size of a group is its standard deviation along
    its longest axis.

    Scanners measure the skins of things, and where their lines are far apart, a thing lies in
    pieces, which are flat. So flat groups that are nearer to each other than to anything real are
    one group. Ghosts fill space.

    The more points a group has, the less likely are all of them errors: n times as many as a thing
    needs must stand off n times as far. A group of at least `least` measurements is a thing, unless
    it stands off very far.

    Of the m points that no surface explains, `rows` (m,) are their rows in the cloud, `groups` (m,)
    their groups, from 0 on, where pieces of one thing are one group, and `isolation` and
    `separation` (m,) are as in `measure`.
    """

    def __init__(self, places, least, limits, n_jobs):
        index, explained = places.cloud, places.explained
        self.limits = limits
        self.low, self.high = index.points.min(axis=0), index.points.max(axis=0)
        self.reference = index.among(explained if explained.any() else ~explained)
        self.reference_spacing = places.usual_spacing
        self.quantile = limits.usual if explained.any() else HALF
        self.rows = rest = np.flatnonzero(~explained)
        self.points, self.counts = chosen_rows(index, index.points, ~explained), places.counts[rest]
        self.others = index.among(~explained)
        with progress_part(0.0, 0.2):
            self.usual = self._usual(self.points, n_jobs)
        with progress_part(0.2, 0.7):
            among_rest, linked = self._neighbors(index, n_jobs)
        self.isolation = self._isolated(among_rest, places.spacing, self.usual)
        groups = connected(linked)[0]
        del linked
        self._find_real(index, groups, least, explained)
        groups = self._joined(groups, least, n_jobs)
        self.others.release()
        self.groups = groups
        sizes = self._find_real(index, groups, least, explained)
        with progress_part(0.7, 1.0):
            self.separation = self._separated(groups, n_jobs)
            if explained.any():
                self._separate_large(index, groups, least, sizes, n_jobs)
        for real in self.real:
            real.release()

    def measure(self, queries, spacing, n_jobs=None):
        """How far m new points stand off, each as if it were alone added to the cloud.

        `spacing` (m,) is the mean distance of each to its nearest measurements. Returns, of each,

        - isolation: spacing among off-surface points and among all points, over the usual one;
          what has others near has about 1;
        - separation: gap between the query, with the small group that it belongs to, and what is
          real, over their size; 0 for what belongs to a thing;
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
        usual, place = np.empty(len(queries)), int(self.quantile * n_usual)

        def measure(rows, distances, near):
            spacings = self.reference_spacing[near]
            usual[rows] = np.partition(spacings, place, axis=1)[:, place]

        self.reference.visit(queries, n_usual, measure, n_jobs)
        return usual

    def _neighbors(self, index, n_jobs):
        """Mean distance of each point to others, and those that are of its group."""
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

    def _find_real(self, index, groups, least, explained):
        """Find which groups are too `small` for a thing, and what is `real`: the points on
        surfaces, and those of the other groups. Returns the sizes of groups."""
        sizes = np.bincount(groups, self.counts)
        self.small = sizes < least
        self.real = [self.reference]
        if not explained.any():
            self.small &= sizes < sizes.max(initial=0)
            self.real = []
        if not self.small[groups].all():
            self.real.append(self._points_of(index, ~self.small[groups]))
        return sizes

    def _points_of(self, index, wanted):
        """Search of those off-surface points that are wanted, bool (m,)."""
        chosen = np.zeros(len(index.points), bool)
        chosen[self.rows[wanted]] = True
        return index.among(chosen)

    def _joined(self, groups, least, n_jobs):
        """The groups, where those that are pieces of one thing are one."""
        rows = np.flatnonzero(self.small[groups])
        if len(rows) == 0:
            return groups
        _, group = np.unique(groups[rows], return_inverse=True)
        gaps = gaps_of_groups(group, self._gaps(self.points[rows], n_jobs))
        for real in self.real[1:]:
            real.release()
        gaps[~are_flat_groups(self.points[rows], group, self.limits.flat)] = 0.0
        gap = np.zeros(len(groups) + 1)  # that of a missing point, the last, stays 0
        gap[rows] = gaps[group]
        rows = rows[gap[rows] > 0]
        if len(rows) == 0:
            return groups
        group_there, pairs = np.append(groups, -1), []

        def link(some, distances, near):
            own = rows[some]
            # One of both groups, at least, is as near to the other as to anything real.
            pieces = distances <= np.maximum(gap[own, None], gap[near])
            i, j = np.nonzero(pieces & (gap[near] > 0))
            pair = np.stack([groups[own[i]], group_there[near[i, j]]])
            pairs.append(np.unique(pair, axis=1))

        # A small group has fewer points, so one of another is among them.
        self.others.visit(self.points[rows], int(np.ceil(least)), link, n_jobs)
        one, other = np.hstack(pairs)
        shape = len(self.small), len(self.small)
        graph = coo_array((np.ones(len(one), np.int8), (one, other)), shape=shape)
        return connected_components(graph, directed=False)[1][groups]

    def _among_rest(self, queries, distances, near, itself):
        counts = np.append(self.counts, self.limits.n_near)[near]  # of a missing one: all
        counts[:, 0] -= itself
        box = self.low, self.high
        return mean_distance_to_rest(queries, distances, counts, box, self.limits.n_near)

    def _isolated(self, among_rest, among_all, usual):
        """Most weight is on off-surface points: what lies near surfaces may be alone off them."""
        weight = self.limits.rest_weight
        return ratio(among_rest**weight * among_all ** (1 - weight), usual)

    def _steps(self, usual, distances, near):
        """Distances (m, w) to neighbors in usual spacings, the smaller of both points'."""
        usual_there = np.append(self.usual, np.inf)[near]  # the last is that of a missing one
        return ratio(distances, np.minimum(usual[:, None], usual_there))

    def _gaps(self, queries, n_jobs):
        """Distances of queries to the nearest point that is real."""
        gaps = np.full(len(queries), np.inf)
        for real in self.real:
            np.minimum(gaps, real.query(queries, 1, n_jobs)[0][:, 0], out=gaps)
        return gaps

    def _separated(self, groups, n_jobs):
        """Gap of each point's group over the size of the group, 0 if that is large."""
        separation = np.zeros(len(groups))
        rows = np.flatnonzero(self.small[groups])
        if len(rows):
            separation[rows] = self._separation(groups[rows], rows, self._gaps, n_jobs)
        return separation

    def _separate_large(self, index, groups, least, sizes, n_jobs):
        """The same of large groups, over how many times as large they are as the least thing, if
        they stand off from all else. What is large by copies alone is real."""

        def to_surfaces(queries, n_jobs):
            return self.reference.query(queries, 1, n_jobs)[0][:, 0]

        # One point of each group, and the least size that it may have, tell which may stand off.
        one = np.empty(len(self.small), np.intp)
        one[groups[::-1]] = np.arange(len(groups))[::-1]
        usual = np.bincount(groups, self.usual) / np.bincount(groups)
        weight, large = least / sizes, np.bincount(groups) >= least
        gaps = to_surfaces(self.points[one[large]], n_jobs)
        large[large] = ratio(gaps, usual[large]) * weight[large] > (1 - 1e-9) * STANDS_OFF
        rows = np.flatnonzero(large[groups])
        apart = self._separation(groups[rows], rows, to_surfaces, n_jobs) * weight[groups[rows]]
        rows = rows[apart > STANDS_OFF]
        if len(rows) == 0:
            return
        _, number = np.unique(groups[rows], return_inverse=True)
        code = np.where(self.small[groups], -1, 0)  # of each point; 0 of those that are real
        code[rows] = number + 1
        gaps = to_surfaces(self.points[rows], n_jobs)
        # The numbers of two groups differ in one bit at least, so some search is of the other.
        for bit in range(int(code.max()).bit_length()):
            for value in (0, 1):
                others = (code >= 0) & (code >> bit & 1 != value)
                asked = np.flatnonzero(code[rows] >> bit & 1 == value)
                if others.any() and len(asked):
                    search = self._points_of(index, others)
                    near = search.query(self.points[rows[asked]], 1, n_jobs)[0][:, 0]
                    gaps[asked] = np.minimum(gaps[asked], near)
        apart = self._separation(groups[rows], rows, lambda *_: gaps, n_jobs)
        self.separation[rows] = apart * weight[groups[rows]]

    def _separation(self, groups, rows, gaps_of, n_jobs):
        """Of each of these points the separation of its group, none of which is left out."""
        _, group = np.unique(groups, return_inverse=True)
        points = self.points[rows]
        gaps = gaps_of(points, n_jobs)
        return separation_of_groups(points, group, self.usual[rows], gaps)[group]
