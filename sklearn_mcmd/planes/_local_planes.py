"""From neighborhoods to planes: Algorithm 4 in chunks and threads, compiled or in NumPy."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._agreement import AgreementLimits, agreed_offers
from sklearn_mcmd.planes._around import radii
from sklearn_mcmd.planes._consistent_set import (
    Trials,
    localize,
    maximum_consistent_sets,
    n_support_points,
)
from sklearn_mcmd.planes._nearest import COMPILE_FROM
from sklearn_mcmd.planes._principal_planes import (
    RANK_TOLERANCE,
    fit_planes,
    flat_normals,
    normal_errors,
)
from sklearn_mcmd.planes._quadrics import whole_planes
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._resolution import RoundingLimits, least_scales
from sklearn_mcmd.planes._rules import METHODS, RuleArguments, robust_distances
from sklearn_mcmd.planes._whole import Steps
from sklearn_mcmd.runtime._chunks import each_chunk, each_slice
from sklearn_mcmd.runtime._compiling import compiled_function

CHUNK = 12_800  # neighbors a task in NumPy: what bounds the memory whatever n_neighbors is


class RuleFit(NamedTuple):
    """What a rule of `METHODS` found in neighborhoods, as ``baselines.NeighborhoodFit``."""

    origin: np.ndarray
    radius: np.ndarray
    centers: np.ndarray
    whitening: np.ndarray
    scale: np.ndarray
    support: np.ndarray

    def score(self, queries):
        local = (queries - self.origin[:, None]) / self.radius[:, None, None]
        return robust_distances(local, self.centers, self.whitening)


class RobustPlanes(NamedTuple):
    """Planes at m queries whose outliers are left out, and how far the queries are from them."""

    planes: Planes  # without radii and errors of normals
    directions: np.ndarray  # (m, d), the axes of the largest eigenvalues
    distances: np.ndarray  # (m,), robust

    @classmethod
    def empty(cls, m, d):
        """A record to be filled."""
        planes = Planes.empty(m, d).without("radius")
        return cls(planes, np.empty((m, d)), np.empty(m))

    def put_rule(self, points, fit, sizes):
        """Fill the planes of the members (m, k, d) that a rule keeps, as `RuleFit`."""
        planes = self.planes
        planes.scale[:] = fit.scale
        planes.centroids[:], planes.eigenvalues[:], axes = fit_planes(points, fit.support)
        planes.normals[:], self.directions[:] = axes[..., 0], axes[..., -1]
        planes.kept[:] = fit.support.sum(axis=1) / sizes


class PlaneSettings(NamedTuple):
    """How the plane of a neighborhood is found."""

    method: str  # key of `METHODS`; without meaning where there is a comparator
    precision: float  # relative rounding error of the coordinates, eps of their dtype
    steps: Steps = Steps()  # to which the coordinates were rounded before
    support_fraction: float = 0.5
    cutoff: float | None = None
    reweight: bool = False
    agrees: bool = False  # whether neighbors agree on planes, see ``_agreement``
    small_faces: bool = False  # whether they may be those of less than half of a neighborhood
    # A `baselines.Method` that judges in the place of a rule; trials are then a seed.
    comparator: object = None


class LocalPlaneModel:
    """A fitted cloud that answers with the plane of any query's neighborhood.

    `index` is a `NeighborIndex`, and `trials` a table of int (T, k).
    """

    def __init__(self, index, trials, settings):
        self.index, self.trials, self.settings = index, trials, settings
        self.rounding = _rounding(settings.precision)
        self.least_scale = RoundingLimits().least_steps * settings.steps.lattice
        n, d = index.points.shape
        # Decided by the fitted cloud, so that predicting one row is the same arithmetic.
        self.compiled = index.n_neighbors is not None and d <= 3 and n >= COMPILE_FROM
        # With one neighborhood of all points, its plane and what the rule says of it.
        self.whole = self._fit_whole() if index.n_neighbors is None else None
        self.offers = None  # `Offers` of the index's points, once neighbors agree

    def evaluate(self, queries, n_jobs=None):
        """Planes of the neighborhoods of queries (m, d), and robust distances (m,) to them."""
        precision = np.finfo(queries.dtype).eps
        queries = np.ascontiguousarray(queries, dtype=np.float64)
        planes, distance = Planes.empty(*queries.shape), np.empty(len(queries))
        if self.whole is not None:
            rule_fit, plane = self.whole
            return self._evaluate_whole(queries, rule_fit, plane)

        def task(rows):
            part = queries[rows]
            around = self.index.query(part)
            new, distance[rows] = self.evaluate_neighborhoods(part, around, precision)
            planes.put(rows, new)

        each_chunk(queries, self.chunk(), task, n_jobs)
        return planes, distance

    def evaluate_fitted(self, X, n_jobs=None):
        """The same of the points X (n, d) that the index was made of, with a faster search."""
        index = self.index
        if self.whole is not None:
            return self.evaluate(X, n_jobs)
        (n, d), copies = index.points.shape, index.n_distinct < len(X)
        planes, distance = Planes.empty(n, d), np.empty(n)

        def task(rows):
            around = index.query_own(rows, keep=False)
            new, new_distance = self.evaluate_neighborhoods(index.points[rows], around)
            rows = rows if copies else index.rows[rows]
            planes.put(rows, new)
            distance[rows] = new_distance

        each_slice(n, self.chunk(), task, n_jobs)
        if copies:
            return planes.take(index.places), distance[index.places]
        return planes, distance

    def agree(self, n_jobs=None, **how):
        """Let the index's points find planes together, if this is how planes are found, as
        `agreed_offers` says."""
        if self.settings.agrees:
            self.offers = agreed_offers(self, n_jobs, **how)

    def own_planes(self, rows, neighborhoods):
        """Planes of a slice of the index's points, ordinary ones without eigenvalues and errors."""
        points = self.index.points[rows]
        if self.offers is None:
            return self.evaluate_neighborhoods(points, neighborhoods)[0]
        planes, asking = Planes.unknown(*points.shape), np.flatnonzero(self.offers.asks[rows])
        for name in ("centroids", "normals", "scale"):
            getattr(planes, name)[:] = getattr(self.offers.planes, name)[rows]
        planes.radius[:] = radii(self.index.points, points, neighborhoods)
        planes.kept[:] = 1.0
        if len(asking):
            near = neighborhoods.take(asking)
            planes.put(asking, self.evaluate_neighborhoods(points[asking], near, measured=False)[0])
        return planes

    def first_planes(self, queries, neighborhoods, keep=None):
        """Planes before anyone is asked, and which are not those of all members: bool (m,).

        ``keep`` gets what `whole_planes` returns, if neighbors agree.
        """
        if not self.settings.agrees:
            planes, _ = self.evaluate_neighborhoods(queries, neighborhoods)
            return planes, np.ones(len(queries), dtype=bool)
        planes, fit = self.whole_planes(queries, neighborhoods)
        if keep is not None:
            keep(planes, fit)
        asking = np.flatnonzero(~fit.ordinary)
        if len(asking):
            near = neighborhoods.take(asking)
            robust = self.robust_planes(queries[asking], near, self.rounding)
            planes.put(asking, robust.planes)
        return planes, ~fit.ordinary

    def evaluate_neighborhoods(self, queries, neighborhoods, precision=0.0, measured=True):
        """The same of given neighborhoods, rows of the index's points.

        `precision` is the relative rounding error of the queries, where that is greater. The
        planes are `measured` unless the radii of their neighborhoods are known.
        """
        rounding = max(self.rounding, _rounding(precision))
        offers = None if self.offers is None else self.offers.planes
        robust = self.robust_planes(queries, neighborhoods, rounding, offers)
        self._measure_degenerate(queries, neighborhoods, rounding, robust)
        self._finish(robust, neighborhoods.sizes)
        planes = robust.planes
        if measured:
            planes = planes._replace(radius=radii(self.index.points, queries, neighborhoods))
        return planes, robust.distances

    def whole_planes(self, queries, neighborhoods):
        """Planes of all members, and the `QuadricFit`, of neighborhoods in 2D or 3D."""
        members = self.index.points
        planes, directions, fit = whole_planes(members, neighborhoods)
        flat_normals(planes.normals, planes.eigenvalues, directions)
        queries = np.ascontiguousarray(queries, dtype=np.float64)
        planes.radius[:] = radii(members, queries, neighborhoods)
        least = self.least_scales(planes.centroids)
        finite = np.isfinite(fit.deviation)
        # Rounding is no noise to test.
        fit.ordinary[:] |= (fit.deviation <= least) & np.isfinite(fit.left)
        planes.scale[:] = np.maximum(np.where(finite, fit.deviation, 0.0), least)
        planes.kept[:] = 1.0
        errors = normal_errors(planes.scale, planes.eigenvalues, neighborhoods.sizes)
        planes.normal_error[:] = errors
        return planes, fit

    def robust_planes(self, queries, neighborhoods, rounding, offers=None):
        """The `RobustPlanes` of neighborhoods: the best of offers, or else of trials."""
        robust, members = RobustPlanes.empty(*queries.shape), self.index.points
        method, rule = self.settings.method, self._rule(rounding)
        if offers is not None:
            ask = compiled_function("planes._local_planes_numba", "ask_neighbors")
            ask(members, neighborhoods, queries, offers, method, rule, robust)
        elif self.ready():
            fit = compiled_function("planes._local_planes_numba", "fit_neighborhoods")
            trials = self._trials(neighborhoods.indices.shape[1])
            fit(members, neighborhoods, queries, trials, method, rule, robust)
        else:
            points = members[neighborhoods.indices]
            rule_fit = self.fit_rule(points, neighborhoods.sizes, rounding)
            robust.distances[:] = rule_fit.score(queries[:, None])[:, 0]
            robust.put_rule(points, rule_fit, neighborhoods.sizes)
        return robust

    def least_scales(self, points):
        """As `least_scales` of points, by the rounding of the fitted ones."""
        return least_scales(points, self.settings.precision, self.settings.steps)

    def chunk(self):
        """Queries a task."""
        return self.index.chunk if self.ready() else max(1, CHUNK // self.index.n_neighbors)

    def ready(self):
        """Whether compiled code does the work."""
        comparator, method = self.settings.comparator, self.settings.method
        return self.compiled and comparator is None and METHODS[method].compiled

    def _finish(self, robust, sizes):
        """Fill what follows from the fitted planes, row by row: errors of their normals."""
        planes = robust.planes
        flat_normals(planes.normals, planes.eigenvalues, robust.directions)
        d, n_kept = planes.normals.shape[1], np.rint(planes.kept * sizes)
        inflation = 1.0
        if self.settings.comparator is None:
            rule, cutoff = METHODS[self.settings.method], self.settings.cutoff
            inflation = rule.inflation(cutoff, d, n_kept, sizes)
        errors = normal_errors(planes.scale, planes.eigenvalues, n_kept, inflation)
        planes.normal_error[:] = errors

    def _trials(self, k):
        """The table of trials, for neighborhoods of up to k members."""
        d = self.index.points.shape[1]
        n_support = n_support_points(self.settings.support_fraction, np.arange(k + 1), d)
        return Trials(positions=self.trials, n_support=n_support, d=d)

    def _rule(self, rounding):
        settings = self.settings
        return RuleArguments.of(
            d=self.index.points.shape[1],
            cutoff=settings.cutoff,
            reweight=settings.reweight,
            rounding=rounding,
            least_scale=self.least_scale,
            outliers=1.0 - settings.support_fraction,
            least_face=AgreementLimits().face if settings.small_faces else np.inf,
        )

    def _measure_degenerate(self, queries, neighborhoods, rounding, robust):
        """Fill distances where no consistent set spans a plane: where the scale is negative.

        Members of a line or a location are at distance zero from it; a query away from it has
        nothing that explains it. Where the neighborhood as a whole spans a plane, that is it.
        """
        rows = np.flatnonzero(robust.planes.scale < 0)
        if rows.size:
            around = neighborhoods.take(rows)
            points = self.index.points[around.indices]
            robust.distances[rows], robust.planes.scale[rows] = self._degenerate_distances(
                queries[rows], points, around.valid, rounding
            )

    def _degenerate_distances(self, queries, points, members, rounding):
        """Distances and scales of queries (m, d) to what neighborhoods (m or 1, k, d) span."""
        centers, eigenvalues, axes = fit_planes(points, members)
        largest = np.sqrt(eigenvalues[:, -1:])
        floor = rounding * (np.abs(points[:, 0]).max(axis=1, keepdims=True) + largest)
        floor = np.maximum(floor, self.least_scale)
        # Along an axis that the members do not span, their deviation is what `fit_planes` leaves by
        # rounding, ten times: the root of its tolerance is a share of the longest axis.
        null = eigenvalues <= RANK_TOLERANCE * eigenvalues[:, -1:]
        thin = np.maximum(floor, 10 * np.sqrt(RANK_TOLERANCE) * largest)
        thin = np.maximum(thin, np.finfo(float).tiny)  # of copies of the origin
        # Where they span all axes, only the distance along the normal counts.
        deviations = np.where(null, thin, np.inf)
        spread = ~null.any(axis=1)
        deviations[spread, :1] = np.maximum(np.sqrt(eigenvalues[spread, :1]), floor[spread])
        projections = np.matmul((queries - centers)[:, None], axes)[:, 0] / deviations
        with np.errstate(over="ignore"):  # infinitely far from copies of one point
            return np.sqrt(np.square(projections).sum(axis=1)), deviations[:, 0]

    def _fit_whole(self):
        """The `RuleFit` and the plane of the one neighborhood of all points."""
        points, sizes = self.index.points[None], np.array([len(self.index.points)])
        rule_fit = self.fit_rule(points, sizes, self.rounding)
        robust = RobustPlanes.empty(1, points.shape[2])
        robust.put_rule(points, rule_fit, sizes)
        self._finish(robust, sizes)
        return rule_fit, robust.planes

    def _evaluate_whole(self, queries, rule_fit, plane):
        """The one plane for each query, and their distances."""
        planes = Planes.empty(*queries.shape)
        planes.put(slice(None), plane)
        distances = rule_fit.score(queries[None])[0]
        planes.radius[:] = np.linalg.norm(self.index.points - plane.centroids, axis=1).max()
        if plane.scale[0] < 0:
            points = self.index.points[None]
            members = np.ones(points.shape[:2], dtype=bool)
            distances, planes.scale[:] = self._degenerate_distances(
                queries, points, members, self.rounding
            )
        return planes, distances

    def fit_rule(self, neighborhoods, sizes, rounding):
        """What the method finds in neighborhoods (B, k, d)."""
        if self.settings.comparator is not None:
            return self.settings.comparator.fit_sizes(
                neighborhoods, sizes, self.trials, rounding=rounding, least_scale=self.least_scale
            )
        _, k, d = neighborhoods.shape
        rule = METHODS[self.settings.method]
        local, radius = localize(neighborhoods, sizes)
        valid = np.arange(k) < sizes[:, None]
        floor = rounding * (np.abs(neighborhoods[:, 0]).max(axis=1) / radius + 1.0)
        floor = np.maximum(floor, self.least_scale / radius)
        support, flat = None, np.zeros(len(local), dtype=bool)
        if rule.needs_consistent_set:
            n_support = n_support_points(self.settings.support_fraction, sizes, d)
            support, _, flat = maximum_consistent_sets(neighborhoods, self.trials, n_support, sizes)
        centers, whitening = rule.apply(local, valid, support, self.settings.reweight, floor)
        scale = 1.0 / np.linalg.norm(whitening[..., 0], axis=1)
        if rule.needs_consistent_set:
            # No member is an outlier where none spans a plane; see `_measure_flat`.
            whitening[flat], scale[flat] = 0.0, -1.0
            valid &= robust_distances(local, centers, whitening) < self.settings.cutoff
        return RuleFit(
            origin=neighborhoods[:, 0],
            radius=radius,
            centers=centers,
            whitening=whitening,
            scale=radius * scale,
            support=valid,
        )


def _rounding(precision):
    return RoundingLimits().errors * float(precision)  # a float32 would compile anew
