"""The plane of the surface that a point lies on: its own, or near an edge that of a neighbor.

Two things are mended in the planes of Algorithm 4. Where a neighborhood is smooth, nothing is
removed from it. Where it is not, next to an edge, the majority may be the other face, or one plane
may run across both: of the planes of all its neighbors the point is given the one that explains
it best, and planes that are noisier than is usual around come last.
"""

import numpy as np

from sklearn_mcmd._borrowing import EXPLAINED, explanation_cost
from sklearn_mcmd._chunks import each_chunk, run
from sklearn_mcmd._judging import quantile_around
from sklearn_mcmd._local_planes import CHUNK, LocalPlanes
from sklearn_mcmd._plane import flat_normals, normal_errors
from sklearn_mcmd._smoothness import smooth_planes

__all__ = ["SurfacePlanes"]

# A point asks its neighbors where so much of its own neighborhood was removed, or where it is so
# many standard deviations off its own plane, or where that is noisier than is usual around.
REMOVED, OFF = 0.1, 2.5
# Share of a neighborhood's radius that counts as noise: no surface is flatter.
LEAST_NOISE = 0.01
# What is usual is what the best tenth of the neighbors have ...
BEST = 0.1
# ... and so many standard errors, of a deviation that so few members tell. A curved surface is
# as curved next to a point as at it; what is not is no smooth surface, though a quadric fits it.
NOISY, CREASED = 2.0, 4.0


class SurfacePlanes:
    """Planes of the surfaces of a fitted cloud.

    Parameters
    ----------
    model : LocalPlaneModel
        With neighborhoods.
    borrow : bool
    n_jobs : int or None
    """

    def __init__(self, model, borrow, n_jobs):
        self.model = model
        self.borrow = borrow
        self.n_jobs = n_jobs
        self.compiled = model.ready()

    def fit(self, X):
        """Planes of the fitted points X (n, d), and whose they are: rows of X, (n,)."""
        n = len(X)
        planes, owners = LocalPlanes.empty(*X.shape), np.arange(n)
        smooth, noise = np.empty(n, dtype=bool), np.empty(n)
        self.rows = self.model.index.rows
        chunks = []

        def sweep(part):
            indices, sizes = self._neighborhoods(X[part])
            planes[part], smooth[part], noise[part] = self._own(X[part], indices, sizes)
            chunks.append((part, indices, sizes))

        each_chunk(X, self._chunk(), sweep, self.n_jobs)
        if not self.borrow:
            return planes, owners
        self.noise = noise[self.rows]

        def unfold(part, indices, sizes):
            own, whole = planes.take(part), smooth[part]
            self._unfold(X[part], own, whole, noise[part], indices, sizes)
            planes[part], smooth[part] = own, whole

        run(chunks, unfold, self.n_jobs)
        self.members = planes.take(self.rows)

        def lend(part, indices, sizes):
            own = planes.take(part)
            lenders = self._lend(X[part], own, smooth[part], indices, sizes)
            planes[part] = own
            found = lenders >= 0
            owners[part[found]] = self.rows[lenders[found]]

        run(chunks, lend, self.n_jobs)
        return planes, owners

    def evaluate(self, queries):
        """Planes of any queries (m, d)."""
        planes = LocalPlanes.empty(*queries.shape)

        def task(part):
            points = queries[part]
            indices, sizes = self._neighborhoods(points)
            own, smooth, noise = self._own(points, indices, sizes)
            if self.borrow:
                self._unfold(points, own, smooth, noise, indices, sizes)
                self._lend(points, own, smooth, indices, sizes)
            planes[part] = own

        each_chunk(queries, self._chunk(), task, self.n_jobs)
        return planes

    def _chunk(self):
        return max(1, CHUNK[self.compiled] // self.model.index.n_neighbors)

    def _neighborhoods(self, points):
        indices, sizes = self.model.index.query(np.ascontiguousarray(points, dtype=np.float64))
        return indices.astype(np.int32), sizes

    def _robust(self, points, indices, sizes):
        precision = np.finfo(points.dtype).eps
        points = np.ascontiguousarray(points, dtype=np.float64)
        return self.model.evaluate_neighborhoods(points, indices, sizes, precision)

    def _own(self, points, indices, sizes):
        """Planes of neighborhoods, of all members where these are smooth; bool (m,), which are;
        and the noise (m,) of the surface, curved or not."""
        planes = self._robust(points, indices, sizes)
        members = self.model.index.points
        deviation, noise = planes.scale.copy(), planes.scale.copy()
        if self.compiled:
            from sklearn_mcmd._smoothness_numba import smooth_planes_3d

            smooth = np.empty(len(indices), dtype=bool)
            smooth_planes_3d(
                members,
                indices,
                sizes,
                planes.scale,
                smooth,
                planes.centroids,
                planes.eigenvalues,
                planes.normals,
                planes.directions,
                deviation,
                noise,
            )
        else:
            smooth, centroids, values, axes, deviation, left = smooth_planes(
                members[indices], sizes, planes.scale
            )
            planes.centroids[smooth], planes.eigenvalues[smooth] = centroids[smooth], values[smooth]
            planes.normals[smooth] = axes[smooth, :, 0]
            planes.directions[smooth] = axes[smooth, :, -1]
            noise[smooth] = left[smooth]
        rows = np.flatnonzero(smooth)
        if len(rows):
            normals = planes.normals[rows]
            values = planes.eigenvalues[rows]
            planes.normals[rows] = flat_normals(normals, values, planes.directions[rows])
            planes.n_inliers[rows] = planes.n_members[rows]
            rounding = self.model.rounding * np.abs(planes.centroids[rows]).max(axis=1)
            least = np.maximum(rounding, self.model.least_scale)
            planes.scale[rows] = np.maximum(deviation[rows], least)
            planes.normal_error[rows] = normal_errors(
                planes.scale[rows], values, planes.n_inliers[rows]
            )
        return planes, smooth, noise

    def _unfold(self, points, planes, smooth, noise, indices, sizes):
        """Give neighborhoods their robust planes back that lie across a crease."""
        rows = np.flatnonzero(smooth)
        indices, sizes = indices[rows], sizes[rows]
        radius = self._radius(points[rows], indices, sizes)
        most = self._most(self.noise, radius, indices, sizes, CREASED)
        creased = np.hypot(noise[rows], LEAST_NOISE * radius) > most
        rows = rows[creased]
        if len(rows):
            planes[rows] = self._robust(points[rows], indices[creased], sizes[creased])
            smooth[rows] = False

    def _lend(self, points, planes, smooth, indices, sizes):
        """Give planes of neighbors to who asks for them: who lent, rows (m,), -1 for none."""
        lenders = np.full(len(points), -1)
        rough = np.flatnonzero(~smooth & (planes.scale > 0))
        indices, sizes = indices[rough], sizes[rough]
        queries = np.ascontiguousarray(points[rough], dtype=np.float64)
        own = planes.take(rough)
        radius = self._radius(queries, indices, sizes)
        most = self._most(self.members.scale, radius, indices, sizes, NOISY)
        height = np.einsum("md,md->m", queries - own.centroids, own.normals)
        ask = (own.removed_fraction > REMOVED) | (np.abs(height) > OFF * own.scale)
        ask |= np.hypot(own.scale, LEAST_NOISE * radius) > most
        best = self._best_planes(queries[ask], indices[ask], sizes[ask], most[ask])
        rows = rough[ask][best >= 0]
        best = best[best >= 0]
        lent = self.members.take(best)
        for name in ("centroids", "normals", "eigenvalues", "directions", "scale", "normal_error"):
            getattr(planes, name)[rows] = getattr(lent, name)
        lenders[rows] = best
        return lenders

    def _radius(self, points, indices, sizes):
        last = indices[np.arange(len(indices)), sizes - 1]
        return np.sqrt(np.square(self.model.index.points[last] - points).sum(axis=1))

    def _most(self, values, radius, indices, sizes, n_errors):
        """The largest deviation that is usual among the neighbors."""
        usual = quantile_around(values, indices, sizes, BEST, self.compiled)
        return (1 + n_errors / np.sqrt(2 * sizes)) * np.hypot(usual, LEAST_NOISE * radius)

    def _best_planes(self, queries, indices, sizes, most):
        """The member whose plane explains each query best: rows (m,), -1 for none.

        Of planes whose deviation is at most `most` and that explain the query at all; only
        where there is none of these, of the others.
        """
        members = self.members
        kept = members.n_inliers / members.n_members
        if self.compiled:
            from sklearn_mcmd._borrowing_numba import best_planes

            best = np.empty(len(queries), dtype=np.int64)
            best_planes(
                queries, self.model.index.points, indices, sizes,
                members.centroids, members.normals, members.scale, kept,
                most, LEAST_NOISE, best,
            )  # fmt: skip
            return best
        valid = np.arange(indices.shape[1]) < sizes[:, None]
        radius = self._radius(queries, indices, sizes)
        deviations = queries[:, None] - members.centroids[indices]
        heights = np.einsum("mkd,mkd->mk", deviations, members.normals[indices])
        reach = np.sqrt(np.square(deviations).sum(axis=2))
        variance = np.square(members.scale[indices])
        variance += np.square(LEAST_NOISE * radius)[:, None]
        cost = explanation_cost(heights, variance, kept[indices])
        cost[~valid | (reach > radius[:, None]) | (members.scale[indices] <= 0)] = np.inf
        cost = np.nan_to_num(cost, nan=np.inf)
        usual = variance <= np.square(most)[:, None]
        usual &= np.square(heights) <= EXPLAINED**2 * variance
        cost_of_usual = np.where(usual, cost, np.inf)
        some = np.isfinite(cost_of_usual).any(axis=1)
        cost[some] = cost_of_usual[some]
        best = cost.argmin(axis=1)
        each = np.arange(len(queries))
        return np.where(np.isfinite(cost[each, best]), indices[each, best], -1)
