"""The plane of the surface that a point lies on: its own, or near an edge that of a neighbor.

Two things are mended in the planes of Algorithm 4. Where a neighborhood is smooth, nothing is
removed from it. Where it is not, next to an edge, the majority may be the other face, or one plane
may run across both: of the planes of all its neighbors the point is given the one that explains
it best, and planes that are noisier than is usual around come last.
"""

import numpy as np

from sklearn_mcmd.normals._smoothness import SmoothnessLimits, is_smooth, whole_planes
from sklearn_mcmd.planes._around import extents, quantile_around
from sklearn_mcmd.planes._chunks import each_chunk, each_slice, run
from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.planes._local_planes import CHUNK
from sklearn_mcmd.planes._neighborhoods import spatial_order
from sklearn_mcmd.planes._plane import flat_normals, normal_errors
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.planes._record import Planes

__all__ = ["SurfacePlanes"]

# A point asks its neighbors where so much of its own neighborhood was removed, or where its plane
# is noisier than is usual around.
REMOVED = 0.1
# Share of a neighborhood's radius that counts as noise: no surface is flatter.
LEAST_NOISE = 0.01
# What is usual is what the best tenth of the neighbors have and so many standard errors of a
# deviation that so few members tell. A curved surface is as curved next to a point as at it; what
# is not is no smooth surface, though a quadric fits it.
BEST, NOISY = 0.1, 3.0
# A plane that leans by no more than so many of its standard errors is not borrowed: the least noisy
# of many is so by chance, and no better.
SIGNIFICANT = 3.0
# A plane explains points within so many of its standard deviations.
EXPLAINED = 3.0


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

    def fit(self, X):
        """Planes of the fitted points X (n, d), and whose they are: rows of X, (n,)."""
        n = len(X)
        index = self.model.index
        rows = index.rows
        # In spatial order every stage is faster; it is undone at the end.
        order = rows if index.n_distinct == n else spatial_order(X)
        X = X[order]
        planes = Planes.empty(*X.shape)
        smooth, noise = np.empty(n, dtype=bool), np.empty(n)
        members = np.arange(n)  # rows of X; without copies among the points all of them, in order
        if index.n_distinct < n:
            members = np.argsort(order)[rows]
        neighborhoods = {}  # of all points: a search more would take longer than all that follows

        def sweep(part):
            around = self._query(X[part])
            own = planes.take(part)  # of a slice: views, which are filled
            smooth[part], noise[part] = self._own(X[part], own, around)
            neighborhoods[part.start] = part, around

        def unfold(start):
            part, around = neighborhoods.pop(start)
            own = planes.take(part)
            self._unfold(X[part], own, smooth[part], noise[part], around)
            rough = _rough(own, smooth[part])  # smooth ones are done, and their neighbors let go
            neighborhoods[start] = part, rough, around.take(rough)

        def ask(start):
            part, rough, around = neighborhoods.pop(start)
            lenders[part][rough] = self._lenders(X[part], planes.take(part), rough, around)

        with progress_part(0.0, 0.8, "normals"):
            each_slice(n, self._chunk(), sweep, self.n_jobs)
        self.noise = noise[members]
        starts = [(start,) for start in neighborhoods]
        with progress_part(0.8, 0.9, "normals next to edges"):
            run(starts, unfold, self.n_jobs, told=True)
        # The planes as they are before any is lent.
        self.members = planes if index.n_distinct == n else planes.take(members)
        self.usable = np.ones(len(members), dtype=bool)
        lenders = np.full(n, -1)
        if self.borrow:
            with progress_part(0.9, 1.0, "normals next to edges"):
                run(starts, ask, self.n_jobs, told=True)
        neighborhoods.clear()
        result, plane_index = Planes.empty(*X.shape), np.empty(n, dtype=np.intp)
        plane_index[order] = order

        def put_back(values, sorted_values):
            values[order] = sorted_values

        run(list(zip(result, planes, strict=True)), put_back, self.n_jobs)
        borrowing = np.flatnonzero(lenders >= 0)
        self._lend(result, order[borrowing], lenders[borrowing])
        plane_index[order[borrowing]] = order[members[lenders[borrowing]]]
        return result, plane_index

    def evaluate(self, queries):
        """Planes of any queries (m, d)."""
        planes = Planes.empty(*queries.shape)

        def task(part):
            points = queries[part]
            around = self._query(points)
            own = Planes.empty(*points.shape)
            smooth, noise = self._own(points, own, around)
            self._unfold(points, own, smooth, noise, around)
            if self.borrow:
                rough = _rough(own, smooth)
                lenders = self._lenders(points, own, rough, around.take(rough))
                self._lend(own, rough[lenders >= 0], lenders[lenders >= 0])
            planes.put(part, own)

        each_chunk(queries, self._chunk(), task, self.n_jobs)
        return planes

    @property
    def compiled(self):
        """Whether compiled code does the work, here and now: a pickle may come elsewhere."""
        return self.model.ready()

    def _chunk(self):
        return max(1, CHUNK[self.compiled] // self.model.index.n_neighbors)

    def _query(self, points):
        return self.model.index.query(np.ascontiguousarray(points, dtype=np.float64))

    def _robust(self, points, around):
        precision = np.finfo(points.dtype).eps
        points = np.ascontiguousarray(points, dtype=np.float64)
        return self.model.evaluate_neighborhoods(points, around, precision)[0]

    def _own(self, points, planes, around):
        """Fill the planes of neighborhoods, of all members where these are smooth; bool (m,), which
        are; and the noise (m,) of the surface, curved or not."""
        deviation, left, smooth = self._fit_whole(points, planes, around)
        rest = np.flatnonzero(~smooth)
        if len(rest):
            robust = self._robust(points[rest], around.take(rest))
            whole = is_smooth(deviation[rest], left[rest], planes.eigenvalues[rest], robust.scale)
            smooth[rest] = whole
            planes.put(rest[~whole], robust.take(~whole))
        return smooth, np.where(smooth, np.minimum(deviation, left), planes.scale)

    def _fit_whole(self, points, planes, around):
        """Fill planes of all members; `deviation`, `left` and `ordinary` of `whole_planes`.

        Where there are too few members to tell a deviation, the plane is to be overwritten.
        """
        members, directions = self.model.index.points, np.empty_like(planes.normals)
        if self.compiled:
            from sklearn_mcmd.normals._smoothness_numba import whole_planes_3d

            m = len(points)
            found = np.empty(m), np.empty(m), np.empty(m, dtype=bool)
            limits = SmoothnessLimits.of(around.indices.shape[1], 3)
            whole_planes_3d(members, around, limits, planes, directions, *found)
        else:
            fitted = whole_planes(members[around.indices], around.sizes)
            planes.centroids[:], planes.eigenvalues[:], axes = fitted[:3]
            planes.normals[:], directions[:] = axes[..., 0], axes[..., -1]
            found = fitted[3:]
        flat_normals(planes.normals, planes.eigenvalues, directions)
        points = np.ascontiguousarray(points, dtype=np.float64)
        planes.spacing[:], planes.radius[:] = extents(members, points, around, self.compiled)
        deviation = np.where(np.isfinite(found[0]), found[0], 0.0)
        rounding = self.model.rounding * np.abs(planes.centroids).max(axis=1)
        planes.scale[:] = np.maximum(deviation, np.maximum(rounding, self.model.least_scale))
        planes.kept[:] = 1.0
        planes.normal_error[:] = normal_errors(planes.scale, planes.eigenvalues, around.sizes)
        return found

    def _unfold(self, points, planes, smooth, noise, around):
        """Give neighborhoods their robust planes back, in place, that lie across a crease."""
        rows = np.flatnonzero(smooth)
        around, radius = around.take(rows), planes.radius[rows]
        creased = np.hypot(noise[rows], LEAST_NOISE * radius) > self._most(
            self.noise, radius, around
        )
        rows = rows[creased]
        if len(rows):
            planes.put(rows, self._robust(points[rows], around.take(creased)))
            smooth[rows] = False

    def _lenders(self, points, planes, rough, around):
        """Whose planes those of the rows `rough` are given that ask their neighbors.

        Returns rows of the members for each of `rough`, -1 for none; its neighborhoods are
        `around`.
        """
        lenders = np.full(len(rough), -1)
        queries = np.ascontiguousarray(points[rough], dtype=np.float64)
        own = planes.take(rough)
        least = LEAST_NOISE * own.radius
        most = self._most(self.members.scale, own.radius, around)
        asking = np.flatnonzero((1 - own.kept > REMOVED) | (np.hypot(own.scale, least) > most))
        likeliest = ExplainLimits(likely=True, explained=EXPLAINED)
        best, _ = explain(
            queries[asking], around.take(asking), self.members, likeliest, self.usable,
            least[asking], most[asking], self.compiled,
        )  # fmt: skip
        asking, best = asking[best >= 0], best[best >= 0]
        cosine = np.einsum("md,md->m", own.normals[asking], self.members.normals[best])
        angle = np.degrees(np.arccos(np.minimum(np.abs(cosine), 1.0)))
        leans = angle > SIGNIFICANT * self.members.normal_error[best]
        lenders[asking[leans]] = best[leans]
        return lenders

    def _lend(self, planes, rows, lenders):
        """Give rows of planes, in place, those of members; their own extents stay."""
        lent = self.members.take(lenders)
        own = planes.take(rows)
        planes.put(rows, lent._replace(kept=own.kept, radius=own.radius, spacing=own.spacing))

    def _most(self, values, radius, around):
        """The largest deviation that is usual among the neighbors."""
        usual = quantile_around(values, around, BEST, self.compiled)
        return (1 + NOISY / np.sqrt(2 * around.sizes)) * np.hypot(usual, LEAST_NOISE * radius)


def _rough(planes, smooth):
    """Rows that are not smooth and have a plane."""
    return np.flatnonzero(~smooth & (planes.scale > 0))
