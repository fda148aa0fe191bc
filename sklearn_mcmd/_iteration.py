"""Iteration over the cloud: every point is judged against the points retained so far.

One pass fits planes to the neighborhoods among the retained points and judges all points,
retained or not, by them: by their distance to the plane in standard deviations, their own or
a borrowed plane's, and by whether they stand apart. Who passes is retained for the next pass.
"""

from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from sklearn_mcmd._borrowing import credible_planes, most_of_a_surface, nearest_credible_planes
from sklearn_mcmd._local_planes import LocalPlanes
from sklearn_mcmd._neighborhoods import ORDER_FROM, spatial_order

__all__ = ["IteratedPlanes"]

CHUNK = 4096  # rows a task
# A point stands apart if its neighbors are so many times farther from it than from each other.
STANDS_APART = 1.8
# With one noise for all, a plane with so many times more is no plane of a surface.
NOISY_PLANE = 2.0
# Share of credible planes among the neighbors that makes a surface.
SURFACE = 0.5
# Below this share of changed points the retained set is settled.
SETTLED = 1e-3
# Iterating must not eat the cloud.
LEAST_RETAINED = 0.5
# What is suspected to be a group of outliers: see `_suspicious`.
SPARSER = 1.3
QUARTER = 0.25
LINKS = 12
SMALL_GROUP = 2  # neighborhoods
TRUSTING_PASSES = 2


@dataclass
class Members:
    """The retained points' planes and neighborhoods; arrays in the order of the index."""

    rows: np.ndarray  # of the fitted cloud
    centroids: np.ndarray
    normals: np.ndarray
    scale: np.ndarray
    spacing: np.ndarray  # mean distance of the neighbors
    radius: np.ndarray  # distance of the last neighbor
    credible: np.ndarray


class IteratedPlanes:
    """A fitted cloud that judges points by the planes of its retained points.

    Parameters
    ----------
    model : LocalPlaneModel
        Of the whole cloud; then, once fitted, of the retained points.
    noise_scale : {"own", "local", "pooled"} or float
    borrow : bool
    cutoff : float
    max_iter : int
    n_jobs : int or None

    Attributes
    ----------
    n_iter, noise_scale_found : as ``n_iter_`` and ``noise_scale_`` of the detector
    retained : ndarray of bool of shape (n,)
    plane_index : ndarray of int of shape (n,)
    """

    def __init__(self, model, *, noise_scale, borrow, cutoff, max_iter, n_jobs):
        self.model = model
        self.noise_scale = noise_scale
        self.borrow = borrow
        self.cutoff = cutoff
        self.common_noise = noise_scale not in ("own", "local")
        self.max_iter = max_iter
        # The paper; and one plane for all has no cloud to iterate over.
        self.own_planes_only = model.index.n_neighbors is None or (
            noise_scale == "own" and max_iter == 1 and not borrow
        )
        self.noise_scale_found = None if isinstance(noise_scale, str) else float(noise_scale)
        self.n_jobs = n_jobs

    def fit(self, X):
        """Iterate until the retained set settles."""
        n, d = X.shape
        self.n_iter = 1
        if self.own_planes_only:
            self.retained, self.plane_index = np.ones(n, dtype=bool), np.arange(n)
            return self
        retained = np.ones(n, dtype=bool)
        n_removals = np.zeros(n, dtype=np.int8)
        planes = LocalPlanes.empty(n, d)
        spacing, radius = np.empty(n), np.empty(n)
        stale = np.arange(n)
        for n_iter in range(1, self.max_iter + 1):
            self.n_iter = n_iter
            if n_iter > 1:
                self.model = self.model.over(X[retained])
            planes[stale] = self.model.evaluate(X[stale], n_jobs=self.n_jobs)
            spacing[stale], radius[stale] = self._extents(X[stale])
            self._settle_members(np.flatnonzero(retained), planes, spacing, radius)
            if n_iter == self.max_iter:
                break
            # With one noise for all, borrowed planes would let outliers creep back in.
            scores, _ = self._judge(X, planes, spacing, self.borrow and not self.common_noise)
            passed = scores <= self.cutoff
            if self.noise_scale != "own" and n_iter <= self.max_iter - TRUSTING_PASSES:
                passed[self.members.rows[self._suspicious()]] = False
            # A point that was let in again and failed again stays out: no oscillation.
            n_removals += retained & ~passed
            passed &= n_removals < 2
            changed = passed != retained
            least = max(self.model.index.points.shape[1] + 1, self.model.index.n_neighbors)
            if changed.sum() <= SETTLED * n or passed.sum() < max(least, LEAST_RETAINED * n):
                break
            stale = _reached(X, radius, X[changed])
            retained = passed
        self.retained = retained
        _, self.plane_index = self._judge(X, planes, spacing, self.borrow)
        return self

    def score(self, queries):
        """Robust distances of queries (m, d), those that stand apart raised accordingly."""
        if self.own_planes_only:
            planes = self.model.evaluate(queries, saliency=False, n_jobs=self.n_jobs)
            # Of one plane for all the noise may still be known.
            if self.common_noise and self.noise_scale != "pooled":
                return _ratio(planes.distance * planes.scale, self.noise_scale)
            return planes.distance
        planes = self.model.evaluate(queries, n_jobs=self.n_jobs)
        spacing, _ = self._extents(queries)
        return self._judge(queries, planes, spacing, self.borrow)[0]

    def _settle_members(self, retained_rows, planes, spacing, radius):
        rows = retained_rows[self.model.index.rows]
        scale, radius = planes.scale[rows], radius[rows]
        self.members = Members(
            rows, planes.centroids[rows], planes.normals[rows], scale, spacing[rows], radius, None
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            flatness = scale / radius
        self._usual_flatness = float(np.median(np.where(radius > 0, flatness, 0.0)))
        around = np.empty(len(rows))

        def look_around(part, indices, valid, _):
            around[part] = _masked_quantile(radius[indices], valid, 0.5)

        self._each_neighborhood(self.model.index.points, look_around)
        removed = planes.removed_fraction[rows]
        if self.noise_scale == "pooled":
            self.noise_scale_found = float(np.median(scale))
        self.members.credible = credible_planes(
            scale, removed, radius, around, self._usual_flatness
        )
        if self.common_noise:
            self.members.credible &= scale <= NOISY_PLANE * self.noise_scale_found

    def _judge(self, queries, planes, spacing, borrow):
        """Scores of queries, and the row of the fitted cloud whose plane each is measured by.

        Where it is the query's own plane that row is the query's.
        """
        members = self.members
        scores = np.empty(len(queries))
        owners = np.arange(len(queries))

        def judge(part, indices, valid, distances):
            plane = planes.take(part)
            own = np.abs(np.einsum("md,md->m", queries[part] - plane.centroids, plane.normals))
            ruler = self._ruler(plane, indices, valid, distances)
            score = plane.distance.copy() if self.noise_scale == "own" else _ratio(own, ruler)
            if borrow:
                far = np.flatnonzero(score > self.cutoff)
                others = members.scale[indices[far]]
                if self.common_noise:
                    others = np.full_like(others, self.noise_scale_found)
                borrowed, owner = nearest_credible_planes(
                    queries[part][far], indices[far], valid[far], members, others
                )
                nearer = borrowed < score[far]
                score[far[nearer]] = borrowed[nearer]
                owners[part[far[nearer]]] = members.rows[owner[nearer]]
            if self.noise_scale != "own":
                usual = _masked_quantile(members.spacing[indices], valid, 0.5)
                # Among copies of one point there is no spacing to compare with.
                apart = _ratio(spacing[part], np.where(usual > 0, usual, np.inf))
                score = np.maximum(score, self.cutoff / STANDS_APART * apart)
            scores[part] = score

        self._each_neighborhood(queries, judge)
        return scores, owners

    def _ruler(self, plane, indices, valid, distances):
        """Standard deviation by which the distance to the own plane is measured."""
        if self.noise_scale == "own":
            return plane.scale
        if self.common_noise:
            return np.full(len(plane.scale), self.noise_scale_found)
        # A credible plane is its own ruler: it knows its curvature. Among credible planes any
        # other would excuse by its roughness what they don't; where there are none, as in
        # foliage, roughness is what is usual.
        radius = np.max(np.where(valid, distances, 0.0), axis=1)
        around = _masked_quantile(self.members.radius[indices], valid, 0.5)
        usual = _masked_quantile(self.members.scale[indices], valid, 0.5)
        credible = credible_planes(
            plane.scale, plane.removed_fraction, radius, around, self._usual_flatness
        )
        n_credible = (self.members.credible[indices] & valid).sum(axis=1)
        on_surface = n_credible >= SURFACE * valid.sum(axis=1)
        other = np.where(on_surface, np.minimum(plane.scale, usual), np.maximum(plane.scale, usual))
        least = _masked_quantile(self.members.scale[indices], valid, QUARTER)
        return np.where(credible & on_surface, np.maximum(plane.scale, least), other)

    def _suspicious(self):
        """Retained points that may belong to a group of outliers: bool, in members' order.

        Rough, and of a group of few points that have no mutual links to others; with one noise
        for all also where rough and sparser than the denser of their surroundings, which is
        what foliage is as well. Such points are not retained in the first passes, but may pass
        again, judged by what remains.
        """
        members, index = self.members, self.model.index
        limit = most_of_a_surface(self._usual_flatness) * members.radius
        if self.common_noise:
            limit = np.minimum(limit, NOISY_PLANE * self.noise_scale_found)
        rough = members.scale > limit
        suspicious = self._group_sizes() < SMALL_GROUP * index.n_neighbors
        if self.common_noise:
            suspicious |= members.spacing > SPARSER * self._dense_spacing()
        return rough & suspicious

    def _dense_spacing(self):
        """The lower quartile of the spacing around each member, and once more of that."""
        points = self.model.index.points
        spacing = self.members.spacing
        for _ in range(2):
            around = np.empty(len(points))

            def take_quartile(part, indices, valid, _, values=spacing, out=around):
                out[part] = _masked_quantile(values[indices], valid, QUARTER)

            self._each_neighborhood(points, take_quartile)
            spacing = around
        return spacing

    def _group_sizes(self):
        """Size of the group of each member, of those linked by being near neighbors mutually."""
        index = self.model.index
        n, n_links = len(index.points), min(LINKS, index.n_neighbors - 1)
        others, distances = np.empty((n, n_links), dtype=np.int32), np.empty((n, n_links))

        def link(part, indices, _, gaps):
            others[part] = indices[:, 1 : n_links + 1]
            distances[part] = gaps[:, 1 : n_links + 1]

        self._each_neighborhood(index.points, link)
        mutual = distances <= distances[:, -1][others]
        rows = np.repeat(np.arange(n, dtype=np.int32), mutual.sum(axis=1))
        ones = np.ones(len(rows), dtype=np.int8)
        graph = coo_array((ones, (rows, others[mutual])), shape=(n, n))
        _, labels = connected_components(graph, directed=False)
        return np.bincount(labels)[labels]

    def _extents(self, queries):
        """Mean distance of the neighbors of queries (m, d), and that of the last."""
        spacing, radius = np.empty(len(queries)), np.empty(len(queries))

        def measure(part, _, valid, distances):
            inside = np.where(valid, distances, 0.0)
            spacing[part] = inside.sum(axis=1) / valid.sum(axis=1)
            radius[part] = inside.max(axis=1)

        self._each_neighborhood(queries, measure)
        return spacing, radius

    def _each_neighborhood(self, queries, work):
        """Call `work` with chunks: rows of queries, indices (m, k), which are valid, distances."""
        index = self.model.index
        n = len(queries)
        order = spatial_order(queries) if n >= ORDER_FROM else np.arange(n)
        parts = [order[start : start + CHUNK] for start in range(0, n, CHUNK)]

        def task(part):
            indices, sizes = index.query(queries[part])
            gaps = index.points[indices] - queries[part][:, None]
            distances = np.sqrt(np.einsum("mkd,mkd->mk", gaps, gaps))
            work(part, indices, np.arange(indices.shape[1]) < sizes[:, None], distances)

        if len(parts) == 1:
            task(parts[0])
        else:
            Parallel(n_jobs=self.n_jobs, require="sharedmem")(delayed(task)(p) for p in parts)


def _reached(X, radius, changed):
    """Rows whose neighborhood a removed or readmitted point lies in: the others stand."""
    nearest, _ = cKDTree(changed).query(X)
    return np.flatnonzero(nearest <= radius)


def _masked_quantile(values, valid, q):
    """The q-quantile of each row of (m, k) over its valid entries, from above."""
    if valid.all():
        position = int(q * values.shape[1])
        return np.partition(values, position, axis=1)[:, position]
    ordered = np.sort(np.where(valid, values, np.inf), axis=1)
    return ordered[np.arange(len(values)), (q * valid.sum(axis=1)).astype(int)]


def _ratio(numerator, denominator):
    """Quotients, 0 / 0 being 0, limited to finite numbers."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        quotient = numerator / denominator
    return np.nan_to_num(quotient, nan=0.0, posinf=np.finfo(float).max)
