"""The plane of the surface that a point lies on: its own, or near an edge that of a neighbor.

Two things are mended in the planes of Algorithm 4. Where a neighborhood is smooth, nothing is
removed from it. Where it is not, next to an edge, the majority may be the other face, or one plane
may run across both: of the planes of all its neighbors the point is given the one that explains
it best, and planes that are noisier than is usual around come last.
"""

from dataclasses import fields

import numpy as np

from sklearn_mcmd.normals._smoothness import is_smooth, whole_planes
from sklearn_mcmd.planes._around import quantile_around, ratio
from sklearn_mcmd.planes._chunks import each_chunk, each_slice, run
from sklearn_mcmd.planes._explaining import EXPLAINED, explanation_cost
from sklearn_mcmd.planes._local_planes import CHUNK, LocalPlanes
from sklearn_mcmd.planes._neighborhoods import spatial_order
from sklearn_mcmd.planes._plane import flat_normals, normal_errors

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
NOISY, CREASED = 3.0, 3.25
# A plane that leans by no more than so many of its standard errors is not borrowed: the least noisy
# of many is so by chance, and no better.
SIGNIFICANT = 3.0


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
        rows = self.model.index.rows
        # In spatial order every stage is faster; it is undone at the end.
        order = rows if len(rows) == n else spatial_order(X)
        X = X[order]
        planes = LocalPlanes.empty(*X.shape)
        smooth, noise = np.empty(n, dtype=bool), np.empty(n)
        members = np.arange(n)  # rows of X; without copies among the points all of them, in order
        if len(rows) < n:
            members = np.argsort(order)[rows]
        neighborhoods = {}  # of all points: a search more would take longer than all that follows

        def sweep(part):
            indices, sizes = self._neighborhoods(X[part])
            own = planes.take(part)  # of a slice: views, which are filled
            smooth[part], noise[part] = self._own(X[part], own, indices, sizes)
            neighborhoods[part.start] = part, indices, sizes

        def unfold(start):
            part, indices, sizes = neighborhoods.pop(start)
            own = planes.take(part)
            self._unfold(X[part], own, smooth[part], noise[part], indices, sizes)
            rough = _rough(own, smooth[part])  # smooth ones are done, and their neighbors let go
            neighborhoods[start] = part, rough, indices[rough], sizes[rough]

        def ask(start):
            part, rough, indices, sizes = neighborhoods.pop(start)
            found = self._lenders(X[part], planes.take(part), rough, indices, sizes)
            lenders[part][rough] = found

        each_slice(n, self._chunk(), sweep, self.n_jobs)
        self.noise = noise[members]
        starts = [(start,) for start in neighborhoods]
        run(starts, unfold, self.n_jobs)
        # The planes as they are before any is lent.
        self.members = planes if len(rows) == n else planes.take(members)
        self.kept = self.members.n_inliers / self.members.n_members
        lenders = np.full(n, -1)
        if self.borrow:
            run(starts, ask, self.n_jobs)
        neighborhoods.clear()
        result, plane_index = LocalPlanes.empty(*X.shape), np.empty(n, dtype=np.intp)
        plane_index[order] = order

        def put_back(name):
            getattr(result, name)[order] = getattr(planes, name)

        run([(f.name,) for f in fields(planes)], put_back, self.n_jobs)
        borrowing = np.flatnonzero(lenders >= 0)
        self._lend(result, order[borrowing], lenders[borrowing])
        plane_index[order[borrowing]] = order[members[lenders[borrowing]]]
        return result, plane_index

    def evaluate(self, queries):
        """Planes of any queries (m, d)."""
        planes = LocalPlanes.empty(*queries.shape)

        def task(part):
            points = queries[part]
            indices, sizes = self._neighborhoods(points)
            own = LocalPlanes.empty(*points.shape)
            smooth, noise = self._own(points, own, indices, sizes)
            self._unfold(points, own, smooth, noise, indices, sizes)
            if self.borrow:
                rough = _rough(own, smooth)
                lenders = self._lenders(points, own, rough, indices[rough], sizes[rough])
                self._lend(own, rough[lenders >= 0], lenders[lenders >= 0])
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

    def _own(self, points, planes, indices, sizes):
        """Fill the planes of neighborhoods, of all members where these are smooth; bool (m,), which
        are; and the noise (m,) of the surface, curved or not."""
        deviation, left, smooth = self._fit_whole(planes, indices, sizes)
        self._finish_whole(planes, points, sizes, deviation)
        rest = np.flatnonzero(~smooth)
        if len(rest):
            robust = self._robust(points[rest], indices[rest], sizes[rest])
            values = planes.eigenvalues[rest]
            whole = is_smooth(deviation[rest], left[rest], values, robust.scale)
            smooth[rest] = whole
            planes[rest[~whole]] = robust.take(~whole)
        return smooth, np.where(smooth, np.minimum(deviation, left), planes.scale)

    def _fit_whole(self, planes, indices, sizes):
        """Fill planes of all members; `deviation`, `left` and `ordinary` of `whole_planes`."""
        members = self.model.index.points
        if self.compiled:
            from sklearn_mcmd.normals._smoothness_numba import whole_planes_3d

            n = len(indices)
            found = np.empty(n), np.empty(n), np.empty(n, dtype=bool)
            whole_planes_3d(
                members,
                indices,
                sizes,
                planes.centroids,
                planes.eigenvalues,
                planes.normals,
                planes.directions,
                *found,
            )
            return found
        fitted = whole_planes(members[indices], sizes)
        planes.centroids[:], planes.eigenvalues[:], axes = fitted[:3]
        planes.normals[:], planes.directions[:] = axes[..., 0], axes[..., -1]
        return fitted[3:]

    def _finish_whole(self, planes, points, sizes, deviation):
        """What follows from planes of all members; where these are too few to tell a deviation,
        something to be overwritten."""
        flat_normals(planes.normals, planes.eigenvalues, planes.directions)
        deviation = np.where(np.isfinite(deviation), deviation, 0.0)
        rounding = self.model.rounding * np.abs(planes.centroids).max(axis=1)
        planes.scale[:] = np.maximum(deviation, np.maximum(rounding, self.model.least_scale))
        planes.n_inliers[:] = planes.n_members[:] = sizes
        planes.normal_error[:] = normal_errors(planes.scale, planes.eigenvalues, planes.n_inliers)
        height = np.einsum("md,md->m", points - planes.centroids, planes.normals)
        planes.distance[:] = ratio(np.abs(height), planes.scale)

    def _unfold(self, points, planes, smooth, noise, indices, sizes):
        """Give neighborhoods their robust planes back, in place, that lie across a crease."""
        rows = np.flatnonzero(smooth)
        indices, sizes = indices[rows], sizes[rows]
        radius = self._radius(points[rows], indices, sizes)
        most = self._most(self.noise, radius, indices, sizes, CREASED)
        creased = np.hypot(noise[rows], LEAST_NOISE * radius) > most
        rows = rows[creased]
        if len(rows):
            planes[rows] = self._robust(points[rows], indices[creased], sizes[creased])
            smooth[rows] = False

    def _lenders(self, points, planes, rough, indices, sizes):
        """Whose planes those of the rows `rough` are given that ask their neighbors.

        Returns rows of the members for each of `rough`, -1 for none; its neighborhoods are
        `indices` and `sizes`.
        """
        lenders = np.full(len(rough), -1)
        queries = np.ascontiguousarray(points[rough], dtype=np.float64)
        own = planes.take(rough)
        radius = self._radius(queries, indices, sizes)
        most = self._most(self.members.scale, radius, indices, sizes, NOISY)
        height = np.einsum("md,md->m", queries - own.centroids, own.normals)
        ask = (own.removed_fraction > REMOVED) | (np.abs(height) > OFF * own.scale)
        ask |= np.hypot(own.scale, LEAST_NOISE * radius) > most
        best = self._best_planes(queries[ask], indices[ask], sizes[ask], most[ask])
        asking, best = np.flatnonzero(ask)[best >= 0], best[best >= 0]
        cosine = np.einsum("md,md->m", own.normals[asking], self.members.normals[best])
        angle = np.degrees(np.arccos(np.minimum(np.abs(cosine), 1.0)))
        leans = angle > SIGNIFICANT * self.members.normal_error[best]
        lenders[asking[leans]] = best[leans]
        return lenders

    def _lend(self, planes, rows, lenders):
        """Give rows of planes, in place, those of members."""
        for name in ("centroids", "normals", "eigenvalues", "directions", "scale", "normal_error"):
            getattr(planes, name)[rows] = getattr(self.members, name)[lenders]

    def _radius(self, points, indices, sizes):
        last = indices[np.arange(len(indices)), sizes - 1]
        gaps = self.model.index.points[last] - points
        return np.sqrt(np.einsum("md,md->m", gaps, gaps))

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
        if self.compiled:
            from sklearn_mcmd.planes._explaining_numba import best_planes

            best = np.empty(len(queries), dtype=np.int64)
            best_planes(
                queries, self.model.index.points, indices, sizes,
                members.centroids, members.normals, members.scale, self.kept,
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
        cost = explanation_cost(heights, variance, self.kept[indices])
        cost[~valid | (reach > radius[:, None]) | (members.scale[indices] <= 0)] = np.inf
        cost = np.nan_to_num(cost, nan=np.inf, posinf=np.inf)
        usual = variance <= np.square(most)[:, None]
        usual &= np.square(heights) <= EXPLAINED**2 * variance
        cost_of_usual = np.where(usual, cost, np.inf)
        some = np.isfinite(cost_of_usual).any(axis=1)
        cost[some] = cost_of_usual[some]
        best = cost.argmin(axis=1)
        each = np.arange(len(queries))
        return np.where(np.isfinite(cost[each, best]), indices[each, best], -1)


def _rough(planes, smooth):
    """Rows that are not smooth and have a plane."""
    return np.flatnonzero(~smooth & (planes.scale > 0))
