"""A fitted cloud that scores its own points and new ones: planes, then surfaces, then the rest."""

import numpy as np

from sklearn_mcmd.outliers._company import Company, CompanyLimits, Places, mean_distance
from sklearn_mcmd.outliers._surfaces import (
    SurfaceLimits,
    distances_to_surfaces,
    find_surfaces,
    own_distances,
)
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._chunks import each_chunk, each_slice
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._rules import small_sample_inflation

__all__ = ["JudgedCloud"]

# A surface has as many points as a neighborhood, a thing as many as two; or this share of a
# small cloud.
SURFACE, THING, LEAST_SHARE = 1.0, 2.0, 1 / 5
# Fields of the planes that no later step asks for.
UNUSED = "eigenvalues", "spacing", "normal_error"
FITTING = 0.65  # share of the time that planes take, for the display of progress


class JudgedCloud:
    """A cloud whose points are scored by its surfaces and by the company that they keep.

    Parameters
    ----------
    model : LocalPlaneModel
    strictness : {"isolated", "groups", "surfaces"} or None
        None scores each point by the plane of its own neighborhood.
    noise_scale : float or None
        Standard deviation of the noise, in the place of each plane's own.
    n_jobs : int or None

    Attributes
    ----------
    scores : ndarray of shape (n,)
        Of the fitted cloud; the larger, the more abnormal.
    plane_index : ndarray of int of shape (n,)
        The row whose plane explains the point best, its own if none does.
    on_surface : ndarray of bool of shape (n,)
    """

    def __init__(self, model, *, strictness, noise_scale, n_jobs):
        self.model = model
        self.own_planes_only = strictness is None or model.index.n_neighbors is None
        self.strictness = strictness
        if strictness == "surfaces" and len(model.index.points) <= (model.index.n_neighbors or 0):
            # The cloud is one neighborhood, and half of few points say too little about noise.
            self.strictness = "groups"
        self.noise_scale = noise_scale
        self.n_jobs = n_jobs
        self.surface_limits = SurfaceLimits()
        self.company_limits = CompanyLimits()

    def fit(self, X):
        """Score the points X (n, d), those that the model has indexed."""
        if self.own_planes_only:
            fitted = self.model.evaluate_fitted(X, self.n_jobs)
            self.scores, self.plane_index = self._by_own_planes(*fitted), np.arange(len(X))
            self.on_surface = self.scores <= self.surface_limits.explained
            return self
        index = self.model.index
        self.counts = np.maximum(np.bincount(index.places, minlength=len(index.points)), 1)
        with progress_part(0.0, FITTING):
            planes, places = self._fit_planes()
        with progress_part(FITTING, 1.0):
            self._find_surfaces(planes)
            del planes  # the largest there are
            least = min(THING * index.n_neighbors, LEAST_SHARE * len(X))
            self.company = Company(places, self.explained, least, self.company_limits, self.n_jobs)
        rest, company = self.company.rest, self.company
        self.point_scores = self.distances
        self.point_scores[rest] = self._joined(
            self.distances[rest], company.isolation, company.separation, index.points[rest]
        )
        first = index.places
        self.scores = self.point_scores[first]
        self.on_surface = self.explained[first]
        self.plane_index = index.rows[self.owners[first]]
        del self.owners, self.distances
        return self

    def score(self, queries):
        """Scores of queries (m, d), each as if it alone were added to the cloud.

        A query that is a point of the cloud has the score of that point.
        """
        if self.own_planes_only:
            return self._by_own_planes(*self.model.evaluate(queries, self.n_jobs))
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
        floor = self._floor(queries, precision)
        _, distances = distances_to_surfaces(
            queries,
            around.take,
            self.planes,
            self.explaining,
            floor,
            self.model.ready(),
            len(queries),
        )
        near = around.indices[:, : self.company_limits.n_near]
        gaps = self._distances(queries, near)
        spacing = mean_distance(gaps, self.counts[near], self.company_limits.n_near)
        isolation, separation = np.zeros(len(queries)), np.zeros(len(queries))
        rest = np.flatnonzero(distances > self.surface_limits.explained)
        if len(rest):
            isolation[rest], separation[rest] = self.company.measure(queries[rest], spacing[rest])
        return self._joined(distances, isolation, separation, queries)

    def _by_own_planes(self, planes, distances):
        if self.noise_scale is not None:
            distances = ratio(distances * planes.scale, self.noise_scale)
        return np.minimum(distances, np.finfo(float).max)

    def _fit_planes(self):
        """Planes and spacings of all points of the index."""
        index = self.model.index
        n, d = index.points.shape
        spacing = np.empty(n)
        other_spacing = np.empty(n) if self.counts.max() > 1 else spacing
        planes = Planes.empty(n, d).without(*UNUSED)

        def task(rows):
            part, around = index.points[rows], index.query_own(rows)
            planes.put(rows, self.model.evaluate_neighborhoods(part, around)[0])
            spacing[rows], other_spacing[rows] = self._spacings(part, around.indices)

        each_slice(n, self.model.chunk(), task, self.n_jobs)
        return planes, Places(index.points, self.counts, spacing, other_spacing)

    def _spacings(self, points, near):
        """Mean distance of the cloud's points to measurements, and to those at other places."""
        n_near = self.company_limits.n_near
        near = near[:, : n_near + 1]
        distances, counts = self._distances(points, near), self.counts[near]
        counts[:, 0] -= 1  # itself
        spacing = mean_distance(distances, counts, n_near)
        counts[:, 0] = 0
        return spacing, mean_distance(distances, counts, n_near)

    def _find_surfaces(self, planes):
        """What explains points, which points it explains, and how far from it they are."""
        index, compiled = self.model.index, self.model.ready()
        points, n, k = index.points, len(index.points), index.n_neighbors
        floor, limits = self._floor(points, 0.0), self.surface_limits
        self.planes = self._measured(planes).without("kept")
        own = own_distances(points, self.planes, floor)
        least = min(SURFACE * k, LEAST_SHARE * n)
        self.explaining = find_surfaces(index, planes, own, least, limits, compiled)
        self.owners, self.distances = np.arange(n, dtype=np.int32), own
        others = np.flatnonzero(~self.explaining)
        owners, distances = distances_to_surfaces(
            points[others], lambda rows: index.query_own(others[rows]), self.planes,
            self.explaining, floor[others], compiled, self.model.chunk(), self.n_jobs,
        )  # fmt: skip
        self.distances[others] = distances
        self.owners[others] = np.where(owners < 0, others, owners)
        self.explained = self.distances <= limits.explained
        self.explained_scale = None
        if self.strictness == "surfaces":
            self.explained_scale = self.planes.scale[self.owners[self.explained]]

    def _measured(self, planes):
        """The planes with the noise by which distances are measured."""
        if self.noise_scale is not None:
            return planes._replace(scale=np.full(len(planes.scale), self.noise_scale))
        n, d = planes.normals.shape
        if n > self.model.index.n_neighbors:
            return planes
        # All points share one plane. In larger clouds each has several, and the nearest counts,
        # which makes up for a scale of few points being too small.
        inflation = small_sample_inflation(d, np.rint(planes.kept * n), n)
        return planes._replace(scale=planes.scale * inflation)

    def _floor(self, queries, precision):
        return max(self.model.rounding, 8 * precision) * np.abs(queries).max(axis=1)

    def _distances(self, queries, near):
        """Distances of queries (m, d) from points of the index (m, w)."""
        gaps = self.model.index.points[near] - queries[:, None]
        return np.sqrt(np.einsum("mkd,mkd->mk", gaps, gaps))

    def _joined(self, distances, isolation, separation, points):
        """One score: a point is as wrong as the best of its excuses leaves it."""
        apart = isolation
        if self.strictness != "isolated":
            apart = np.maximum(isolation, separation)
        if self.strictness != "surfaces" or not self.explained.any():
            rest = distances > self.surface_limits.explained
            return np.where(rest, np.minimum(distances, apart), distances)
        scores = distances.copy()
        lost = np.flatnonzero(np.isinf(distances))  # which no plane of a surface reaches
        if len(lost):
            gaps, near = self.company.reference.query(points[lost], 1)
            beside = ratio(gaps[:, 0], self.explained_scale[near[:, 0]])
            scores[lost] = np.maximum(beside, apart[lost])
        return scores
