"""A fitted cloud that scores its own points and new ones: planes, surfaces, then all else."""

from itertools import chain
from math import fsum
from typing import NamedTuple

import numpy as np
from sklearn.utils import check_array

from sklearn_mcmd._errors import warn
from sklearn_mcmd.outliers._off_surface import (
    OffSurfaceLimits,
    Rest,
    judge_off_surface,
    least_thing,
    mean_distance,
)
from sklearn_mcmd.outliers._ray_evidence import RayEvidence
from sklearn_mcmd.outliers._surfaces import are_usable, find_surfaces, least_surface, own_distances
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._rules import small_sample_inflation
from sklearn_mcmd.planes._whole import whole_cloud
from sklearn_mcmd.runtime._chunks import each_chunk, each_slice, run, slices
from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.sensors._rays import RayLimits, distances_between

UNUSED = "eigenvalues", "spacing", "normal_error"  # fields of planes that no later step asks for
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


class Judgement(NamedTuple):
    """What is found of each of n points: arrays (n,), the last three as the detector has them."""

    scores: np.ndarray  # the larger, the more abnormal
    plane_index: np.ndarray  # the row whose plane explains the point best, its own if none does
    on_surface: np.ndarray
    isolation: np.ndarray | None = None
    separation: np.ndarray | None = None
    group_index: np.ndarray | None = None


class JudgedCloud:
    """A cloud whose points are scored by its surfaces and by how far they stand off from all else.

    `strictness` and `noise_scale` are the detector's. `origins`, float64 (n, d), tells where the
    sensor stood when it measured each point of the model's index, and `intensity` (n,) has the
    `ranks_of_intensity` of these. It is `telling` from 0, where isolated points are as bright as
    all others, to 1, where they are the darkest. An origin that is `doubted` is not used if
    surfaces would go by it, but that parts of a cloud leave this to the whole; `ray_doubt` says in
    words that they would, else it is "". `raised` (m, 3) has what is known of the places of which
    rays think worse than coordinates, `raised_rows`: both scores, and measurements.
    """

    def __init__(
        self, model, *, strictness, noise_scale, n_jobs, origins=None, intensity=None, doubted=False
    ):
        self.model = model
        self.own_planes_only = strictness is None or model.index.n_neighbors is None
        if not self.own_planes_only:
            self.level = LEVELS[strictness]
            if len(model.index.points) <= model.index.n_neighbors:
                # The cloud is one neighborhood, and half of few points say too little about noise.
                self.level = self.level._replace(off_surfaces=False)
        self.noise_scale = noise_scale
        self.n_jobs = n_jobs
        self.origins = origins
        self.intensity, self.telling, self.doubted = intensity, 0.0, doubted
        self.rays, self.ray_doubt, self.raised = None, "", np.empty((0, 3))
        self.raised_rows = np.empty(0, np.intp)

    def fit(self, X):
        """The `Judgement` of the points X (n, d), those that the model has indexed."""
        if self.own_planes_only:
            with progress_part(0.0, 1.0, "planes"):
                scores = self.paper_scores(*self.model.evaluate_fitted(X, self.n_jobs))
            return Judgement(scores, np.arange(len(X)), scores <= ExplainLimits().explained)
        index = self.model.index
        counts = np.broadcast_to(np.int32(1), len(X))  # which takes no memory
        if index.n_distinct < len(X):  # measurements at each point
            counts = np.maximum(np.bincount(index.places, minlength=len(index.points)), 1)
        owners = self.judge(counts, len(X))
        first = index.places
        isolation, separation, group_index = self._company(first)
        return Judgement(
            scores=self.point_scores[first],
            plane_index=index.rows[owners[first]],
            on_surface=self.explained[first],
            isolation=isolation,
            separation=separation,
            group_index=group_index,
        )

    def _company(self, places):
        """Isolation, separation and group of the points at these places."""
        off, at = self.off_surface, np.full(len(self.explained), -1)  # where the others' value is
        at[off.rest.rows] = np.arange(len(off.rest.rows))
        at = at[places]
        group, rest = np.append(off.groups, -1)[at], at >= 0
        _, first, own = np.unique(group[rest], return_index=True, return_inverse=True)
        group[rest] = np.argsort(np.argsort(first))[own]
        return np.append(off.isolation, 0.0)[at], np.append(off.separation, 0.0)[at], group

    def judge(self, counts, n_points):
        """Find `point_scores`, those of all points of the index; returns the rows that explain.

        `counts` (n,) are the measurements at each of these points, `n_points` all of them.
        """
        self.counts, index = counts, self.model.index
        with progress_part(0.0, FITTING, "planes"):
            with progress_part(0.0, 0.8):
                self.model.agree(self.n_jobs)
            with progress_part(0.8, 1.0):
                planes, *spacings = self._measure_planes()
        self.model.offers = None  # nobody asks any more
        with progress_part(FITTING, 1.0, "outliers"):
            with progress_part(0.0, 0.4):
                owners, distances = self._find_surfaces(planes)
            least = least_thing(index.n_neighbors, n_of_whole(n_points))
            rest = Rest.of(index, counts, self.explained, *spacings)
            self.reference = rest.reference if rest.has_surface else None
            del planes, spacings
            with progress_part(0.4, 1.0):
                self.off_surface = off_surface = judge_off_surface(rest, least, self.n_jobs)
        rest, points = off_surface.rest.rows, off_surface.rest.points
        if self.intensity is not None:
            whole = whole_cloud()
            # Those whose isolation no surface would explain.
            self.isolated = rest[off_surface.isolation > ExplainLimits().explained]
            ranks = self.intensity[self.isolated]
            self.telling = telling_of([ranks]) if whole is None else whole.telling
        doubt = self.darkness(rest)
        apart = off_surface.isolation * doubt, off_surface.separation
        if self.rays is None:
            distances[rest] = self.joined(distances[rest], points, *apart)
        else:
            known = off_surface.rest.among_all, self.explained, self.to_planes, index
            by_rays = self.rays.judge(off_surface, *known, doubt)
            given = apart, by_rays, self.rays.rest.of_sheets, points, off_surface.rest.counts
            distances[rest], self.raised, worse = self.by_rays(distances[rest], *given)
            self.raised_rows = rest[worse]
            apart = by_rays
        off_surface.isolation, off_surface.separation = apart
        self.point_scores = distances
        return owners

    def score(self, queries):
        """Scores of queries (m, d), each as if it alone were added to the cloud.

        A query that is a point of the cloud has the score of that point.
        """
        if self.own_planes_only:
            return self.paper_scores(*self.model.evaluate(queries, self.n_jobs))
        index, precision = self.model.index, np.finfo(queries.dtype).eps
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

        each_chunk(queries, self.model.chunk(), task, self.n_jobs)
        return scores

    def _score_new(self, queries, around, precision):
        _, distances = self.to_planes(queries, around.take, self.explaining, precision)
        n_near = OffSurfaceLimits().n_near
        near = around.indices[:, :n_near]
        gaps = distances_between(self.model.index.points[near], queries)
        spacing = mean_distance(gaps, self.counts[near], n_near)
        isolation, separation = np.zeros((2, len(queries)))
        joined = np.zeros(len(queries), bool)
        rest = np.flatnonzero(distances > ExplainLimits().explained)
        if len(rest):
            isolation[rest], separation[rest], joined[rest] = self.off_surface.measure(
                queries[rest], spacing[rest]
            )
        doubt = self.darkness(around.indices[:, 0])
        if self.rays is None:
            return self.joined(distances, queries, isolation * doubt, separation)
        apart, planes = (isolation, separation, joined), (self.explained, self.to_planes)
        by_rays = self.rays.judge_new(queries, around, apart, spacing, *planes, doubt)
        return self.joined(distances, queries, *by_rays)

    def darkness(self, rows):
        """The factor on the isolation of these points by their intensity: as far as this tells,
        from 0 of the brightest of all to 1.4 of the darkest, 1 in the middle."""
        if self.intensity is None:
            return 1.0
        return np.sqrt(2 * (1 - self.intensity[rows])) ** self.telling

    def paper_scores(self, planes, distances):
        """Scores by the own plane, from the robust distances of a model."""
        if self.noise_scale is not None:
            distances = ratio(distances * planes.scale, self.noise_scale)
        return np.minimum(distances, np.finfo(float).max)

    def _measure_planes(self):
        """Planes of the index's points, and both of their spacings."""
        index, (n, d) = self.model.index, self.model.index.points.shape
        spacing = np.empty(n)
        other_spacing = np.empty(n) if self.counts.strides[0] else spacing  # there are copies
        # The share of members that are kept counts where all points share one plane.
        unused = (*UNUSED, "kept") if n > index.n_neighbors else UNUSED
        planes = Planes.empty(n, d).without(*unused)

        def task(rows):
            around = index.query_own(rows)
            planes.put(rows, self.model.own_planes(rows, around))
            spacing[rows], other_spacing[rows] = self._spacings(index.points[rows], around.indices)

        each_slice(n, self.model.chunk(), task, self.n_jobs)
        return planes, spacing, other_spacing

    def _spacings(self, queries, near):
        """Mean distances of points to the nearest measurements, and to those at other places."""
        n_near = OffSurfaceLimits().n_near
        near = near[:, : n_near + 1]
        distances = distances_between(self.model.index.points[near], queries)
        counts = self.counts[near]
        counts[:, 0] -= 1  # itself
        spacing = mean_distance(distances, counts, n_near)
        counts[:, 0] = 0
        return spacing, mean_distance(distances, counts, n_near)

    def _find_surfaces(self, planes):
        """What explains points: its rows, and how far from it they are."""
        index = self.model.index
        points, n, chunk = index.points, len(index.points), self.model.chunk()
        self.planes = self.measured(planes).without("kept")
        distances = np.empty(n)

        def measure(rows):
            floor = self._floor(points[rows], 0.0)
            distances[rows] = own_distances(points[rows], self.planes.take(rows), floor)

        run([(rows,) for rows in slices(n, chunk)], measure, self.n_jobs)
        least = least_surface(index.n_neighbors, n_of_whole(n))
        usable = are_usable(planes, distances)
        free = usable
        if self.origins is not None:
            given = self.origins, self.planes, usable, self.n_jobs
            self.rays, free, ends = RayEvidence.of(index, *given)
        with progress_part(0.0, 0.6):
            self.explaining = find_surfaces(index, planes, free, least)
        if self.rays is not None:
            least_sheet = least * RayLimits().sheet
            self.rays.on_sheet = find_surfaces(index, planes, ends, least_sheet)
            self.ray_doubt = self.rays.doubt(self.explaining, self.counts)
            if self.ray_doubt and self.doubted and whole_cloud() is None:
                self.rays = None
                self.explaining = find_surfaces(index, planes, usable, least)
            warn_of_doubt(self.ray_doubt, not self.doubted)
        with progress_part(0.6, 1.0):
            owners = self._explain_others(distances)
        self.explained = distances <= ExplainLimits().explained
        if self.level.off_surfaces:
            self.explained_scale = self.planes.scale[owners[self.explained]]
        return owners, distances

    def _explain_others(self, distances):
        """The rows whose planes explain points, and, filled in, the distances of those that are on
        no surface from these planes."""
        index, owners = self.model.index, np.arange(len(distances), dtype=np.int32)
        others = owners[~self.explaining]
        found, distances[others] = self.to_planes(
            index.points[others], lambda rows: index.query_own(others[rows]), self.explaining
        )
        owners[others] = np.where(found < 0, others, found)
        return owners

    def to_planes(self, queries, neighbors_of, wanted, precision=0.0):
        """The nearest of the wanted planes among each query's neighbors: its row, and the distance.

        The row is -1 where none reaches the query, and the distance inf; it is in standard
        deviations. ``neighbors_of(rows)`` gives the `Neighborhoods` of a slice of queries.
        """
        m, floor = len(queries), self._floor(queries, precision)
        owners, distances = np.full(m, -1, np.int32), np.full(m, np.inf)

        def task(rows):
            owners[rows], distances[rows] = explain(
                queries[rows], neighbors_of(rows), self.planes, wanted, floor[rows]
            )

        each_slice(m, self.model.chunk(), task, self.n_jobs)
        return owners, distances

    def measured(self, planes):
        """The planes with the noise by which distances are measured."""
        if self.noise_scale is not None:
            return planes._replace(scale=np.full(len(planes.scale), self.noise_scale))
        n, d = self.model.index.points.shape
        if n > self.model.index.n_neighbors:
            return planes
        # All points share one plane. In larger clouds each has several, and the nearest counts,
        # which makes up for a scale of few points being too small.
        inflation = small_sample_inflation(d, np.rint(planes.kept * n), n)
        return planes._replace(scale=planes.scale * inflation)

    def _floor(self, queries, precision):
        return max(self.model.rounding, 8 * precision) * np.abs(queries).max(axis=1)

    def joined(self, distances, points, isolation, separation):
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
            beside = ratio(gaps[:, 0], self.explained_scale[near[:, 0]])
            scores[lost] = np.maximum(beside, apart[lost])
        return scores

    def by_rays(self, distances, apart, by_rays, of_sheets, points, counts):
        """Scores of points off the surfaces by their isolation and separation as rays have it, and
        the `raised`, and which these are; `apart` are both without rays."""
        without = np.where(of_sheets, 0.0, distances)  # to coordinates, sheets are surfaces
        without = self.joined(without, points, *apart)
        scores = self.joined(distances, points, *by_rays)
        worse = scores > without
        return scores, np.column_stack([scores, without, counts])[worse], worse


def n_of_whole(n_points):
    """Points of the cloud of which these may be a part."""
    whole = whole_cloud()
    return n_points if whole is None else max(n_points, whole.n_points)


def n_by_rays(raised, cutoff):
    """Measurements beyond the cutoff by rays alone, of places that `JudgedCloud` has `raised`."""
    with_rays, without, counts = raised.T
    return int(counts[(with_rays > cutoff) & (without <= cutoff)].sum())


def ranks_of_intensity(intensity, index, n):
    """The share of the points of an index that returned less than each, and half of the equal.

    None if `intensity` (n,) is None or the same everywhere. Copies have the largest of theirs: as
    ranks it needs no scale, and it doubts least, since one bright return tells a solid place. Of a
    part of a cloud, `intensity` has the ranks in the whole.
    """
    if intensity is None:
        return None
    if np.shape(intensity) != (n,):
        shape = np.shape(intensity)
        raise ValueError(f"intensity must have the shape ({n},) of the points; got {shape}.")
    given = check_array(intensity, dtype=np.float64, ensure_2d=False, input_name="intensity")
    largest = given[index.rows]
    np.maximum.at(largest, index.places, given)
    if whole_cloud() is not None:
        return largest
    values, place, counts = np.unique(largest, return_inverse=True, return_counts=True)
    return middle_ranks(counts)[place] if len(values) > 1 else None


def warn_of_doubt(doubt, used):
    """Warn of what speaks against the position of the sensor, which is used or not."""
    if doubt:
        warn(f"{doubt}. {USED if used else NOT_USED}")


def telling_of(parts):
    """How far intensity tells, by the ranks of isolated points, in any parts and order."""
    n = sum(map(len, parts))
    return max(0.0, 1 - 2 * fsum(chain.from_iterable(parts)) / n) if n else 0.0


def middle_ranks(counts):
    """The share of all values that are less than each, and half of the equal ones."""
    return (np.cumsum(counts) - counts / 2) / counts.sum()
