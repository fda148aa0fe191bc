"""From neighborhoods to planes: Algorithm 4 in chunks and threads, compiled or in NumPy."""

from copy import copy
from dataclasses import dataclass, fields
from threading import Lock

import numpy as np
from joblib import Parallel, delayed

from sklearn_mcmd._consistent_set import localize, maximum_consistent_sets, n_support_points
from sklearn_mcmd._neighborhoods import ORDER_FROM, NeighborIndex, spatial_order
from sklearn_mcmd._plane import fit_planes, flat_normals
from sklearn_mcmd._progress import current_listener
from sklearn_mcmd._rules import METHODS, robust_distances

__all__ = ["LocalPlaneModel", "LocalPlanes"]

# Smaller clouds take NumPy: loading compiled code would take longer than the work.
COMPILE_FROM = 1_000
CHUNK = {True: 4096, False: 256}  # rows a task, compiled or not


@dataclass
class LocalPlanes:
    """The plane of each query's neighborhood; arrays of the length of the queries.

    distance : robust distance of the query to its own plane
    scale : standard deviation of the noise along the normal, in units of X
    centroids, normals, eigenvalues, directions (axis of the largest eigenvalue) : of the
        members left after outliers are removed
    removed_fraction : share of the neighborhood that was removed
    """

    distance: np.ndarray
    scale: np.ndarray
    centroids: np.ndarray
    normals: np.ndarray
    eigenvalues: np.ndarray
    directions: np.ndarray
    removed_fraction: np.ndarray

    @classmethod
    def empty(cls, n, d):
        vector = {"centroids", "normals", "eigenvalues", "directions"}
        return cls(*(np.empty((n, d) if f.name in vector else n) for f in fields(cls)))

    def take(self, rows):
        """The planes of some of the queries."""
        return type(self)(*(getattr(self, f.name)[rows] for f in fields(self)))

    def __setitem__(self, rows, part):
        for f in fields(self):
            getattr(self, f.name)[rows] = getattr(part, f.name)


class LocalPlaneModel:
    """A fitted cloud that answers with the plane of any query's neighborhood.

    Parameters
    ----------
    index : NeighborIndex
    trials : ndarray of int of shape (T, k)
    method : str, key of `METHODS`
    support_fraction, cutoff : float
    reweight : bool
    precision : float
        Relative rounding error of the coordinates, eps of their dtype.
    step : float, default=0
        Step to which the coordinates were rounded before.
    """

    def __init__(
        self, index, trials, *, method, support_fraction, cutoff, reweight, precision, step=0.0
    ):
        self.index = index
        self.trials = trials
        self.method = method
        self.support_fraction = support_fraction
        self.cutoff = cutoff
        self.reweight = reweight
        self.rounding = 8 * precision
        # At the usual cutoffs a distance of one step is then no outlier.
        self.least_scale = step / 2
        n, d = index.points.shape
        # Decided by the fitted cloud, so that predicting one row is the same arithmetic.
        self.compiled = (
            index.n_neighbors is not None
            and d == 3
            and n >= COMPILE_FROM
            and _compiled_driver() is not None
        )
        self.whole = self._fit_whole() if index.n_neighbors is None else None

    def over(self, points):
        """The same model over other points (m, d), m at least `n_neighbors`."""
        other = copy(self)
        other.index = NeighborIndex(points, self.index.n_neighbors, self.index.radius)
        return other

    def evaluate(self, queries, *, saliency=True, n_jobs=None):
        """Planes of the neighborhoods of queries (m, d).

        Without `saliency` only `distance` and `scale` are filled.
        """
        queries = np.ascontiguousarray(queries, dtype=np.float64)
        planes = LocalPlanes.empty(*queries.shape)
        if self.whole is not None:
            self._evaluate_whole(queries, planes)
            return planes
        n_queries = len(queries)
        order = spatial_order(queries) if n_queries >= ORDER_FROM else np.arange(n_queries)
        step = CHUNK[self.compiled]
        evaluate = self._evaluate_compiled if self.compiled else self._evaluate_numpy

        listener, n_done, lock = current_listener(), 0, Lock()

        def task(rows):
            nonlocal n_done
            planes[rows] = evaluate(queries[rows], saliency)
            if listener is not None:
                with lock:
                    n_done += len(rows)
                    listener(n_done, n_queries)

        chunks = (order[start : start + step] for start in range(0, n_queries, step))
        if n_queries <= step:
            for rows in chunks:
                task(rows)
        else:
            Parallel(n_jobs=n_jobs, require="sharedmem")(delayed(task)(rows) for rows in chunks)
        if saliency:
            flat_normals(planes.normals, planes.eigenvalues, planes.directions)
        return planes

    def _evaluate_compiled(self, queries, saliency):
        indices, sizes = self.index.query(queries)
        planes = LocalPlanes.empty(*queries.shape)
        n_support = n_support_points(self.support_fraction, np.arange(indices.shape[1] + 1), 3)
        _compiled_driver()(
            self.index.points,
            indices,
            sizes,
            queries,
            self.trials,
            n_support,
            METHODS[self.method].code,
            self.cutoff,
            self.reweight,
            self.rounding,
            self.least_scale,
            saliency,
            planes.distance,
            planes.scale,
            planes.centroids,
            planes.normals,
            planes.eigenvalues,
            planes.directions,
            planes.removed_fraction,
        )
        return planes

    def _evaluate_numpy(self, queries, saliency):
        indices, sizes = self.index.query(queries)
        planes = LocalPlanes.empty(*queries.shape)
        neighborhoods = self.index.points[indices]
        radius, centers, whitening, scale, inliers = self._fit_rule(neighborhoods, sizes)
        local = (queries - neighborhoods[:, 0]) / radius[:, None]
        planes.distance[:] = robust_distances(local[:, None], centers, whitening)[:, 0]
        planes.scale[:] = scale
        if saliency:
            planes.centroids[:], planes.eigenvalues[:], axes = fit_planes(neighborhoods, inliers)
            planes.normals[:], planes.directions[:] = axes[..., 0], axes[..., -1]
            planes.removed_fraction[:] = 1.0 - inliers.sum(axis=1) / sizes
        return planes

    def _fit_whole(self):
        points = self.index.points[None]
        rule = self._fit_rule(points, np.array([points.shape[1]]))
        radius, centers, whitening, scale, inliers = rule
        centroids, eigenvalues, axes = fit_planes(points, inliers)
        normals = flat_normals(axes[..., 0].copy(), eigenvalues, axes[..., -1])
        plane = (scale, centroids, normals, eigenvalues, axes[..., -1], 1.0 - inliers.mean(axis=1))
        return radius, centers, whitening, plane

    def _evaluate_whole(self, queries, planes):
        radius, centers, whitening, plane = self.whole
        local = (queries - self.index.points[0]) / radius
        distance = robust_distances(local[None], centers, whitening)[0]
        planes[:] = LocalPlanes(distance, *plane)

    def _fit_rule(self, neighborhoods, sizes):
        """Robust distances of neighborhoods (B, k, d), in the coordinates of `localize`."""
        _, k, d = neighborhoods.shape
        rule = METHODS[self.method]
        local, radius = localize(neighborhoods, sizes)
        valid = np.arange(k) < sizes[:, None]
        floor = self.rounding * (np.abs(neighborhoods[:, 0]).max(axis=1) / radius + 1.0)
        floor = np.maximum(floor, self.least_scale / radius)
        support, flat = None, np.zeros(len(local), dtype=bool)
        if rule.needs_consistent_set:
            n_support = n_support_points(self.support_fraction, sizes, d)
            support, _, flat = maximum_consistent_sets(neighborhoods, self.trials, n_support, sizes)
        centers, whitening = rule.apply(local, valid, support, self.reweight, floor)
        scale = 1.0 / np.linalg.norm(whitening[..., 0], axis=1)
        if not rule.needs_consistent_set:
            return radius, centers, whitening, radius * scale, valid
        # Points that span no plane leave nothing to be an outlier of.
        whitening[flat], scale[flat] = 0.0, floor[flat]
        inliers = valid & (robust_distances(local, centers, whitening) < self.cutoff)
        return radius, centers, whitening, radius * scale, inliers


def _compiled_driver():
    """The compiled form, imported on first use; None where Numba cannot be."""
    try:
        from sklearn_mcmd._rules_numba import fit_neighborhoods_3d
    except ImportError:
        return None
    return fit_neighborhoods_3d
