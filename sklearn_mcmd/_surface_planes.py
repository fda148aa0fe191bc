"""The plane of the surface that a point lies on: its own, or near an edge that of a neighbor.

Two things are mended in the planes of Algorithm 4. Where a neighborhood is smooth, nothing is
removed from it. Where it is not, next to an edge, the majority may be the other face: of the
planes of all its neighbors the point is given the one that explains it best.
"""

import numpy as np

from sklearn_mcmd._borrowing import explanation_cost
from sklearn_mcmd._chunks import each_chunk, run
from sklearn_mcmd._local_planes import CHUNK, LocalPlanes
from sklearn_mcmd._plane import flat_normals, normal_errors
from sklearn_mcmd._smoothness import smooth_planes

__all__ = ["SurfacePlanes"]

# A point asks its neighbors where so much of its own neighborhood was removed, or where it is so
# many standard deviations off its own plane.
REMOVED, OFF = 0.1, 2.5
# Share of a neighborhood's radius that counts as noise: no surface is flatter.
LEAST_NOISE = 0.01


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
        planes, asking = self._sweep(X)
        self.rows = self.model.index.rows
        self.members = planes.take(self.rows)
        return self._lend(X, planes, asking)

    def evaluate(self, queries):
        """Planes of any queries (m, d)."""
        planes, asking = self._sweep(queries)
        return self._lend(queries, planes, asking)[0]

    def _sweep(self, queries):
        """Own planes, whole where smooth, and the neighborhoods of those who ask others."""
        precision = np.finfo(queries.dtype).eps
        queries = np.ascontiguousarray(queries, dtype=np.float64)
        planes, asking = LocalPlanes.empty(*queries.shape), []

        def task(part):
            points = queries[part]
            indices, sizes = self.model.index.query(points)
            own = self.model.evaluate_neighborhoods(points, indices, sizes, precision)
            smooth = self._keep_smooth(own, indices, sizes)
            planes[part] = own
            if self.borrow:
                height = np.einsum("md,md->m", points - own.centroids, own.normals)
                ask = (own.removed_fraction > REMOVED) | (np.abs(height) > OFF * own.scale)
                ask &= ~smooth & (own.scale > 0)
                found = indices[ask].astype(np.int32), sizes[ask]
                asking.append((part[ask], *found))

        size = max(1, CHUNK[self.compiled] // self.model.index.n_neighbors)
        each_chunk(queries, size, task, self.n_jobs)
        return planes, asking

    def _keep_smooth(self, planes, indices, sizes):
        """Replace planes of smooth neighborhoods by those of all members; bool (m,)."""
        points = self.model.index.points
        if self.compiled:
            from sklearn_mcmd._smoothness_numba import smooth_planes_3d

            smooth, deviation = np.empty(len(indices), dtype=bool), planes.scale.copy()
            smooth_planes_3d(
                points,
                indices,
                sizes,
                planes.scale,
                smooth,
                planes.centroids,
                planes.eigenvalues,
                planes.normals,
                planes.directions,
                deviation,
            )
        else:
            smooth, centroids, values, axes, deviation = smooth_planes(
                points[indices], sizes, planes.scale
            )
            planes.centroids[smooth], planes.eigenvalues[smooth] = centroids[smooth], values[smooth]
            planes.normals[smooth] = axes[smooth, :, 0]
            planes.directions[smooth] = axes[smooth, :, -1]
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
        return smooth

    def _lend(self, queries, planes, asking):
        owners = np.arange(len(queries))

        def task(rows, indices, sizes):
            best = self._best_planes(queries[rows].astype(np.float64), indices, sizes)
            found = best >= 0
            rows, best = rows[found], best[found]
            lent = self.members.take(best)
            for name in ("centroids", "normals", "eigenvalues", "directions"):
                getattr(planes, name)[rows] = getattr(lent, name)
            planes.scale[rows], planes.normal_error[rows] = lent.scale, lent.normal_error
            owners[rows] = self.rows[best]

        run(asking, task, self.n_jobs)
        return planes, owners

    def _best_planes(self, queries, indices, sizes):
        """The member whose plane explains each query best: positions (m,), -1 for none."""
        members = self.members
        kept = members.n_inliers / members.n_members
        if self.compiled:
            from sklearn_mcmd._borrowing_numba import best_planes

            best = np.empty(len(queries), dtype=np.int64)
            best_planes(
                queries, self.model.index.points, indices, sizes,
                members.centroids, members.normals, members.scale, kept,
                LEAST_NOISE, best,
            )  # fmt: skip
            return best
        gaps = self.model.index.points[indices] - queries[:, None]
        valid = np.arange(indices.shape[1]) < sizes[:, None]
        radius = np.sqrt(np.where(valid, np.square(gaps).sum(axis=2), 0.0).max(axis=1))
        deviations = queries[:, None] - members.centroids[indices]
        heights = np.einsum("mkd,mkd->mk", deviations, members.normals[indices])
        reach = np.sqrt(np.square(deviations).sum(axis=2))
        variance = np.square(members.scale[indices])
        variance += np.square(LEAST_NOISE * radius)[:, None]
        cost = explanation_cost(heights, variance, kept[indices])
        cost[~valid | (reach > radius[:, None]) | (members.scale[indices] <= 0)] = np.inf
        best = np.nan_to_num(cost, nan=np.inf).argmin(axis=1)
        each = np.arange(len(queries))
        return np.where(np.isfinite(cost[each, best]), indices[each, best], -1)
