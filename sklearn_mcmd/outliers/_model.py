"""A fitted cloud that scores its own points and new ones: planes, surfaces, then all else."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd._errors import warn
from sklearn_mcmd.outliers._intensity import Darkness
from sklearn_mcmd.outliers._off_surface import (
    NewCompany,
    OffSurface,
    OffSurfaceLimits,
    Unexplained,
    least_thing,
    mean_distance,
)
from sklearn_mcmd.outliers._ray_evidence import BesideRays, RayEvidence
from sklearn_mcmd.outliers._small_groups import judge_off_surface
from sklearn_mcmd.outliers._surfaces import (
    MeasuringPlanes,
    are_usable,
    find_surfaces,
    least_surface,
)
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._local_planes import LocalPlaneModel
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._whole import whole_cloud
from sklearn_mcmd.runtime._chunks import each_chunk, each_slice
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.sensors._rays import distances_between

UNUSED = "eigenvalues", "normal_error"  # fields of planes that no later step asks for
USED = "Look at what goes by it, or give another $sensor_origin, or none"
NOT_USED = "It is not used. Give $sensor_origin as it was, or none"
FITTING = 0.65  # share of the time that planes take, for the display of progress


class Level(NamedTuple):
    """What counts beside isolation at a level of strictness."""

    groups: bool  # whether a small group that stands off is an outlier
    off_surfaces: bool  # whether a point on no surface is, whatever company it has


# By the words of `Strictness`. Each level flags all that those before it flag.
LEVELS = {
    "isolated": Level(groups=False, off_surfaces=False),
    "groups": Level(groups=True, off_surfaces=False),
    "surfaces": Level(groups=True, off_surfaces=True),
}


class JudgeSettings(NamedTuple):
    """The detector's parameters by which points are judged."""

    strictness: str | None
    noise_scale: float | None  # in units of the points
    n_jobs: int | None


class Sensed(NamedTuple):
    """What is told of the n points of an index beside their coordinates."""

    origins: np.ndarray | None = None  # float64 (n, d), where the sensor was
    # An origin that is doubted is not used if surfaces would go by it. Parts of a cloud leave this
    # to the whole.
    doubted: bool = False
    intensity: np.ndarray | None = None  # (n,), as of `ranks_of_intensity`


class Judgement(NamedTuple):
    """What is known of each of n points: arrays (n,), the last three as the detector has them."""

    scores: np.ndarray  # the larger, the more abnormal
    plane_index: np.ndarray  # the row whose plane explains the point best, its own if none does
    on_surface: np.ndarray
    isolation: np.ndarray | None = None
    separation: np.ndarray | None = None
    group_index: np.ndarray | None = None


class Raised(NamedTuple):
    """The m places of which rays think worse than coordinates."""

    rows: np.ndarray  # (m,), in the index
    scores: np.ndarray  # (m, 3): with rays, without them, and measurements


NOTHING_SENSED = Sensed()
NONE_RAISED = Raised(np.empty(0, np.intp), np.empty((0, 3)))


def judge(model, X, settings, sensed=NOTHING_SENSED):
    """The judged cloud, and the `Judgement` of its points X (n, d), which the model has indexed."""
    index = model.index
    if settings.strictness is None or index.n_neighbors is None:
        cloud = OwnPlanesCloud(model, settings.noise_scale, settings.n_jobs)
        with progress_part(0.0, 1.0, "planes"):
            planes, distances = model.evaluate_fitted(X, settings.n_jobs)
            scores = cloud.paper_scores(planes, distances)
        return cloud, Judgement(scores, np.arange(len(X)), scores <= ExplainLimits().explained)
    counts = np.broadcast_to(np.int32(1), len(X))  # which takes no memory
    if index.n_distinct < len(X):  # measurements at each point
        counts = np.maximum(np.bincount(index.places, minlength=len(index.points)), 1)
    return _judge_cloud(model, counts, len(X), settings, sensed)


def _judge_cloud(model, counts, n_points, settings, sensed):
    """The same by surfaces and company; `counts` (n,) are the measurements at each point of the
    index, `n_points` all of them."""
    index, level, n_jobs = model.index, LEVELS[settings.strictness], settings.n_jobs
    if len(index.points) <= index.n_neighbors:
        # The cloud is one neighborhood, and half of few points say too little about noise.
        level = level._replace(off_surfaces=False)
    # Step 1: planes on which neighbors agree, and how near measurements are to each other.
    with progress_part(0.0, FITTING, "planes"):
        with progress_part(0.0, 0.8):
            model.agree(n_jobs)
        with progress_part(0.8, 1.0):
            planes, spacing, other_spacing = _measure_planes(model, counts, n_jobs)
    model.offers = None  # nobody asks any more
    with progress_part(FITTING, 1.0, "outliers"):
        # Step 2: surfaces, and which points they explain.
        with progress_part(0.0, 0.4):
            explaining = _find_explaining(model, planes, counts, settings, sensed)
        del planes
        # Step 3: the company of all other points.
        distances, explained = explaining.distances, explaining.explained
        least = least_thing(index.n_neighbors, n_of_whole(n_points))
        unexplained = Unexplained.of(index, counts, explained, spacing, other_spacing)
        del spacing, other_spacing
        with progress_part(0.4, 1.0):
            off_surface = judge_off_surface(unexplained, least, n_jobs)
    # Step 4: how dark they are, and what rays say, change how far they stand off.
    rows, darkness, factor = off_surface.rows, None, 1.0
    if sensed.intensity is not None:
        darkness = Darkness.of(sensed.intensity, rows, off_surface.isolation)
        factor = darkness.factor(rows)
    verdict = Verdict.of(level, off_surface, explaining)
    from_surfaces, points = distances[rows], unexplained.points
    isolation, separation = off_surface.isolation * factor, off_surface.separation
    scores = verdict.scores(from_surfaces, points, isolation, separation)
    rays, beside_rays, raised = explaining.rays, None, NONE_RAISED
    if rays is not None:
        isolated_by_rays, separated_by_rays, beside_rays = rays.judge(
            off_surface, explained, explaining.measuring, factor
        )
        # To coordinates, points on sheets are on surfaces.
        without = np.where(beside_rays.of_sheets, 0.0, from_surfaces)
        without = verdict.scores(without, points, isolation, separation)
        isolation, separation = isolated_by_rays, separated_by_rays
        scores = verdict.scores(from_surfaces, points, isolation, separation)
        both = np.column_stack([scores, without, unexplained.counts])
        raised = Raised(rows[scores > without], both[scores > without])
    distances[rows] = scores
    cloud = JudgedCloud(
        measuring=explaining.measuring,
        explaining=explaining.on_surface,
        explained=explained,
        off_surface=off_surface._replace(isolation=isolation, separation=separation),
        counts=counts,
        darkness=darkness,
        verdict=verdict,
        point_scores=distances,
        rays=rays,
        ray_doubt=explaining.ray_doubt,
        beside_rays=beside_rays,
        raised=raised,
        n_jobs=n_jobs,
    )
    return cloud, cloud.judgement(explaining.owners)


def _measure_planes(model, counts, n_jobs):
    """Planes of the index's points, and their mean distances to the nearest measurements, and to
    those at other places."""
    index, (n, d) = model.index, model.index.points.shape
    spacing = np.empty(n)
    other_spacing = np.empty(n) if counts.strides[0] else spacing  # there are copies
    # The share of members that are kept counts where all points share one plane.
    unused = (*UNUSED, "kept") if n > index.n_neighbors else UNUSED
    planes, n_near = Planes.empty(n, d).without(*unused), OffSurfaceLimits().n_near

    def measure(rows):
        around, points = index.query_own(rows), index.points[rows]
        planes.put(rows, model.own_planes(rows, around))
        near = around.indices[:, : n_near + 1]
        gaps, measured = distances_between(index.points[near], points), counts[near]
        measured[:, 0] -= 1  # itself
        spacing[rows] = mean_distance(gaps, measured, n_near)
        measured[:, 0] = 0
        other_spacing[rows] = mean_distance(gaps, measured, n_near)

    each_slice(n, model.chunk(), measure, n_jobs)
    return planes, spacing, other_spacing


class Explaining(NamedTuple):
    """Which planes explain the n points of an index; arrays are of shape (n,)."""

    measuring: MeasuringPlanes
    on_surface: np.ndarray  # bool: whose planes are of surfaces, and explain others
    owners: np.ndarray  # int32: rows whose planes explain the points, their own if none does
    distances: np.ndarray  # from these, in standard deviations; inf if none reaches
    rays: RayEvidence | None  # None if no position is used
    ray_doubt: str  # what speaks against the position, in words

    @property
    def explained(self):
        """Which points a surface explains, or else their own plane: bool (n,)."""
        return self.distances <= ExplainLimits().explained


def _find_explaining(model, planes, counts, settings, sensed):
    """What explains the points of a model's index, as `Explaining`."""
    index = model.index
    measuring = MeasuringPlanes.of(model, planes, settings.noise_scale, settings.n_jobs)
    distances = measuring.from_own()
    usable = free = are_usable(planes, distances)
    least = least_surface(index.n_neighbors, n_of_whole(len(usable)))
    rays, ray_doubt = None, ""
    with progress_part(0.0, 0.6):
        # Step 1: planes that contain the rays to their points are of no surface, unless there
        # would be so many of them that the position is wrong.
        if sensed.origins is not None:
            rays, free = RayEvidence.of(sensed.origins, measuring, planes, usable, least)
        on_surface = find_surfaces(index, planes, free, least)
        if rays is not None:
            ray_doubt = rays.doubt(on_surface, counts)
            if ray_doubt and sensed.doubted and whole_cloud() is None:
                rays, on_surface = None, find_surfaces(index, planes, usable, least)
            warn_of_doubt(ray_doubt, not sensed.doubted)
    # Step 2: points on no surface are explained by one that is near.
    owners = np.arange(len(usable), dtype=np.int32)
    others = owners[~on_surface]
    with progress_part(0.6, 1.0):
        near, distances[others] = measuring.nearest(
            index.points[others], lambda rows: index.query_own(others[rows]), on_surface
        )
    owners[others] = np.where(near < 0, others, near)
    return Explaining(measuring, on_surface, owners, distances, rays, ray_doubt)


class Verdict(NamedTuple):
    """How distances from surfaces and company join to one score."""

    level: Level
    reference: NearestPoints | None  # search of the points on surfaces, None if there are none
    reference_scale: np.ndarray  # of the planes that explain these; none if they are not asked

    @classmethod
    def of(cls, level, off_surface, explaining):
        unexplained = off_surface.unexplained
        reference = unexplained.reference if unexplained.has_surface else None
        owners = explaining.owners[explaining.explained & level.off_surfaces]
        return cls(level, reference, explaining.measuring.planes.scale[owners])

    def scores(self, distances, points, isolation, separation):
        """One score: a point is as wrong as the best of its excuses leaves it.

        Distances are from surfaces, inf of the lost, which none reaches. At the strictest level
        these are as wrong as their distance from the nearest point on a surface says, in its
        standard deviations, or as `isolation` and `separation` say if that is more.
        """
        apart = np.maximum(isolation, separation) if self.level.groups else isolation
        if not self.level.off_surfaces or self.reference is None:
            limit = ExplainLimits().explained
            return np.where(distances > limit, np.minimum(distances, apart), distances)
        scores = distances.copy()
        lost = np.flatnonzero(np.isinf(distances))
        if len(lost):
            gaps, near = self.reference.query(points[lost], 1)
            beside = ratio(gaps[:, 0], self.reference_scale[near[:, 0]])
            scores[lost] = np.maximum(beside, apart[lost])
        return scores


class OwnPlanesCloud(NamedTuple):
    """A cloud whose points are scored by their own planes alone; no rays are asked."""

    model: LocalPlaneModel
    noise_scale: float | None
    n_jobs: int | None
    rays: None = None
    ray_doubt: str = ""
    raised: Raised = NONE_RAISED

    def score(self, queries):
        """Scores of queries (m, d)."""
        planes, distances = self.model.evaluate(queries, self.n_jobs)
        return self.paper_scores(planes, distances)

    def paper_scores(self, planes, distances):
        """Scores from the robust distances of a model."""
        if self.noise_scale is not None:
            distances = ratio(distances * planes.scale, self.noise_scale)
        return np.minimum(distances, np.finfo(float).max)


class JudgedCloud(NamedTuple):
    """A cloud whose points are scored by its surfaces and by how far they stand off from all else.

    Arrays (n,) are of the points of its index.
    """

    measuring: MeasuringPlanes
    explaining: np.ndarray  # bool (n,): whose planes are of surfaces, and explain others
    explained: np.ndarray  # bool (n,): whom one of these explains
    off_surface: OffSurface  # the others, as rays and intensity have it
    counts: np.ndarray  # (n,), measurements at each
    darkness: Darkness | None
    verdict: Verdict
    point_scores: np.ndarray  # (n,)
    rays: RayEvidence | None
    ray_doubt: str
    beside_rays: BesideRays | None
    raised: Raised
    n_jobs: int | None

    @property
    def index(self):
        """The `NeighborIndex` of the points."""
        return self.measuring.model.index

    def judgement(self, owners):
        """The `Judgement` of all points of the cloud; rows (n,) of the index explain its points."""
        off, places = self.off_surface, self.index.places
        at = np.full(len(self.explained), -1)  # where its values are; the last stands for surfaces
        at[off.rows] = np.arange(len(off.rows))
        at = at[places]
        group, is_off = np.append(off.groups, -1)[at], at >= 0
        # Groups are numbered in the order of their first points.
        _, first, numbers = np.unique(group[is_off], return_index=True, return_inverse=True)
        group[is_off] = np.argsort(np.argsort(first))[numbers]
        return Judgement(
            scores=self.point_scores[places],
            plane_index=self.index.rows[owners[places]],
            on_surface=self.explained[places],
            isolation=np.append(off.isolation, 0.0)[at],
            separation=np.append(off.separation, 0.0)[at],
            group_index=group,
        )

    def score(self, queries):
        """Scores of queries (m, d), each as if it alone were added to the cloud.

        A query that is a point of the cloud has the score of that point.
        """
        index, precision = self.index, np.finfo(queries.dtype).eps
        queries = np.ascontiguousarray(queries, dtype=np.float64)
        scores = np.empty(len(queries))

        def task(rows):
            part = queries[rows]
            around = index.query(part)
            first = around.indices[:, 0]
            scores[rows] = self.point_scores[first]
            new = np.flatnonzero((part != index.points[first]).any(axis=1))
            if len(new):
                scores[rows[new]] = self._score_new(part[new], around.take(new), precision)

        each_chunk(queries, self.measuring.model.chunk(), task, self.n_jobs)
        return scores

    def _score_new(self, queries, around, precision):
        """Scores of queries that are no points of the cloud."""
        measuring, n_near = self.measuring, OffSurfaceLimits().n_near
        _, distances = measuring.nearest(queries, around.take, self.explaining, precision)
        near = around.indices[:, :n_near]
        gaps = distances_between(self.index.points[near], queries)
        spacing = mean_distance(gaps, self.counts[near], n_near)
        company = NewCompany.none(spacing)
        off = np.flatnonzero(distances > ExplainLimits().explained)
        if len(off):
            for values, measured in zip(
                company, self.off_surface.measure(queries[off], spacing[off]), strict=True
            ):
                values[off] = measured
        darkness = 1.0 if self.darkness is None else self.darkness.factor(around.indices[:, 0])
        if self.rays is None:
            isolation, separation = company.isolation * darkness, company.separation
        else:
            isolation, separation = self.rays.judge_new(
                queries, around, company, self.beside_rays, darkness, self.explained, measuring
            )
        return self.verdict.scores(distances, queries, isolation, separation)


def n_of_whole(n_points):
    """Points of the cloud of which these may be a part."""
    whole = whole_cloud()
    return n_points if whole is None else max(n_points, whole.n_points)


def n_by_rays(raised, cutoff):
    """Measurements beyond the cutoff by rays alone, from the scores (m, 3) of `Raised` places."""
    with_rays, without, counts = raised.T
    return int(counts[(with_rays > cutoff) & (without <= cutoff)].sum())


def warn_of_doubt(doubt, used):
    """Warn of what speaks against the position of the sensor, which is used or not."""
    if doubt:
        warn(f"{doubt}. {USED if used else NOT_USED}")
