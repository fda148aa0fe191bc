"""Points that no surface explains: what is asked around them, and how far they stand off."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.outliers._groups import Things
from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._around import ratio, values_at
from sklearn_mcmd.planes._nearest import NearestPoints


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


class Unexplained(NamedTuple):
    """The m points that no surface explains, and what is asked around them."""

    box: tuple  # low and high corner of the cloud
    reference: NearestPoints  # of points on surfaces, of all points if there are none
    reference_spacing: np.ndarray  # theirs
    has_surface: bool  # whether any point is on a surface
    search: NearestPoints  # of the points themselves
    rows: np.ndarray  # (m,), in the cloud
    points: np.ndarray
    counts: np.ndarray  # (m,), measurements at each
    among_all: np.ndarray  # (m,), the mean distance to the nearest measurements

    @classmethod
    def of(cls, index, counts, explained, spacing, other_spacing):
        """Of the n distinct points of an index those that are not `explained`, bool (n,).

        `counts` (n,) are measurements: a place measured often is near to itself. Spacings (n,) are
        mean distances to the nearest measurements, and to those at other places, never 0.
        """
        rows, any_explained = np.flatnonzero(~explained), explained.any()
        if any_explained:
            other_spacing = other_spacing[explained]
        return cls(
            box=(index.points.min(axis=0), index.points.max(axis=0)),
            reference=NearestPoints(index.points, explained if any_explained else ~explained),
            reference_spacing=other_spacing,
            has_surface=bool(any_explained),
            search=NearestPoints(index.points, ~explained),
            rows=rows,
            points=index.points[rows],
            counts=counts[rows],
            among_all=spacing[rows],
        )

    @property
    def limits(self):
        return OffSurfaceLimits()

    def usual_around(self, queries, n_jobs):
        """Spacing that is usual on the surfaces around queries, and how far the nearest is."""
        limits = self.limits
        n_usual = min(limits.n_usual, self.reference.n)
        quantile = limits.usual if self.has_surface else limits.half
        (usual, gaps), place = np.empty((2, len(queries))), int(quantile * n_usual)

        def measure(rows, distances, near):
            spacings = self.reference_spacing[near]
            usual[rows] = np.partition(spacings, place, axis=1)[:, place]
            gaps[rows] = distances[:, 0]

        self.reference.visit(queries, n_usual, measure, n_jobs)
        return usual, gaps

    def neighbors(self, usual, n_jobs):
        """Mean distance of each point to others, and those that are of its group."""
        points, m = self.points, len(self.points)
        n_links = max(SurfaceLimits().n_links, self.limits.n_near)
        rows_of = np.arange(m, dtype=np.int32)  # as `connected` takes them
        among_unexplained, linked = np.empty(m), np.empty((m, n_links), np.int32)

        def measure(rows, distances, near):
            among_unexplained[rows] = self.spacing(points[rows], distances, near, itself=True)
            steps = steps_between(usual[rows], usual, distances[:, 1:], near[:, 1:])
            # A link to itself is none.
            linked[rows] = np.where(steps <= self.limits.reach, near[:, 1:], rows_of[rows, None])

        self.search.visit(points, n_links + 1, measure, n_jobs)
        return among_unexplained, linked

    def spacing(self, queries, distances, near, itself):
        """Mean distance of queries to off-surface points, `itself` among these or not."""
        # A missing neighbor counts as many as are asked for: nothing beyond it is.
        counts = values_at(self.counts, near, self.limits.n_near)
        counts[:, 0] -= itself
        # Those that are missing are as far away as the cloud with the query in it is large.
        extent = np.maximum(queries, self.box[1]) - np.minimum(queries, self.box[0])
        extent = np.linalg.norm(extent, axis=1)[:, None]
        distances = np.where(np.isinf(distances), extent, distances)
        return mean_distance(distances, counts, self.limits.n_near)

    def isolated(self, among_unexplained, among_all, usual):
        """Most weight is on off-surface points: what lies near surfaces may be alone off them."""
        weight = self.limits.rest_weight
        return ratio(among_unexplained**weight * among_all ** (1 - weight), usual)


class NewCompany(NamedTuple):
    """How far new points (m, d) stand off from a judged cloud."""

    spacing: np.ndarray  # (m,), as all, the mean distance to the nearest measurements
    isolation: np.ndarray
    separation: np.ndarray
    joined: np.ndarray  # bool: whether a point belongs to a group of the cloud, as separate as that

    @classmethod
    def none(cls, spacing):
        """Of points on surfaces."""
        isolation, separation = np.zeros((2, len(spacing)))
        return cls(spacing, isolation, separation, np.zeros(len(spacing), bool))


class OffSurface(NamedTuple):
    """The m points that no surface explains, as `MCMDOutlierDetector` judges their company.

    Scanners measure the skins of things, and where their lines are far apart, a thing lies in
    pieces, which are flat; of a wire or a pole there is no more than a row of points. Ghosts fill
    space.
    """

    unexplained: Unexplained
    usual: np.ndarray  # (m,), the usual spacing around each point
    things: Things  # what is real beside the surfaces
    groups: np.ndarray  # int32 (m,), from 0 on; pieces of one thing are one group
    straight: np.ndarray  # bool (m,), in a small group that is straight
    isolation: np.ndarray  # (m,), as the separation: see `measure`
    separation: np.ndarray

    @property
    def rows(self):
        """Rows (m,) of the points in the cloud's index."""
        return self.unexplained.rows

    def measure(self, queries, spacing):
        """The `NewCompany` of new points, each as if it were alone added to the cloud.

        `spacing` (m,) is as there. Isolation is the spacing among off-surface points and among all
        points, over the usual one; what has others near has about 1. Separation is the gap between
        the query, with the small group that it belongs to, and what is real, over their size; 0 for
        what belongs to a thing.
        """
        points, limits = self.unexplained, self.unexplained.limits
        usual, from_surface = points.usual_around(queries, None)
        distances, near = points.search.query(queries, limits.n_near, None)
        among_unexplained = points.spacing(queries, distances, near, itself=False)
        steps = steps_between(usual, self.usual, distances[:, :1], near[:, :1])[:, 0]
        from_thing, spacing_there = self.things.beside(queries, limits.n_near, None)
        separation = ratio(from_thing, np.maximum(usual, spacing_there))
        if points.has_surface:
            separation = np.minimum(separation, ratio(from_surface, usual))
        joined = steps <= limits.reach
        separation[joined] = self.separation[near[joined, 0]]
        isolation = points.isolated(among_unexplained, spacing, usual)
        return NewCompany(spacing, isolation, separation, joined)


def least_thing(n_neighbors, n_points):
    """Measurements that a thing has at least, of neighborhoods in a cloud of so many points."""
    share = SurfaceLimits().least_share * n_points
    return min(OffSurfaceLimits().thing * n_neighbors, share)


def steps_between(usual, usual_of_all, distances, near):
    """Distances (m, w) to neighbors in usual spacings, the smaller of both points'."""
    return ratio(distances, np.minimum(usual[:, None], values_at(usual_of_all, near, np.inf)))


def mean_distance(distances, counts, n_near):
    """Mean distance to the `n_near` nearest measurements, or to all if fewer: distances (m, w)
    ascend, and `counts` are the measurements at each."""
    reached = np.minimum(np.cumsum(counts, axis=1), n_near)
    taken = np.diff(reached, axis=1, prepend=0)
    return (taken * distances).sum(axis=1) / np.maximum(reached[:, -1], 1)
