"""The plane of the surface that a point lies on: its own, or near an edge that of a neighbor.

Two corrections improve the planes of Algorithm 4. A smooth neighborhood keeps all its members. In
other neighborhoods, next to an edge, the majority may lie on the other face, or one plane may run
across both faces. There the point is given the plane of a neighbor that explains it best. Planes
noisier than is usual around come last.
"""

import numpy as np

from sklearn_mcmd.normals._smoothness import SmoothnessLimits, is_smooth, whole_planes
from sklearn_mcmd.planes._around import extents, quantile_around
from sklearn_mcmd.planes._chunks import each_chunk, each_slice
from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.planes._plane import flat_normals, normal_errors
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.planes._record import Planes

__all__ = ["SurfacePlanes"]

# A point asks its neighbors if a larger share of its own neighborhood was removed, or if its plane
# is noisier than is usual around.
REMOVED = 0.1
# Least noise of a plane, as a share of its neighborhood's radius.
LEAST_NOISE = 0.01
# The usual noise around a point is the noise of the best tenth of its neighbors. A plane may exceed
# it by NOISY standard errors of a deviation. A quadric that leaves more is no smooth surface,
# because a curved surface is as curved next to a point as at the point.
BEST, NOISY = 0.1, 3.0
# A plane is borrowed only if it leans by more than this number of its standard errors. With less,
# it is the least noisy of many planes by chance, and no better.
SIGNIFICANT = 3.0
# Field of the planes that no one asks of a member.
UNUSED = "spacing"
# Number of its standard deviations within which a plane explains points.
EXPLAINED = 3.0


class SurfacePlanes:
    """Planes of the surfaces of a fitted cloud.

    Parameters
    ----------
    model : LocalPlaneModel
        A model with neighborhoods.
    borrow : bool
    n_jobs : int or None
    """

    def __init__(self, model, borrow, n_jobs):
        self.model = model
        self.borrow = borrow
        self.n_jobs = n_jobs

    def fit(self, X):
        """Planes of the fitted points X (n, d), and the rows of X (n,) whose planes they are."""
        planes, lenders = self._fit_members()
        self.borrowing = np.flatnonzero(lenders >= 0)
        self.before = planes.take(self.borrowing)
        self._lend(planes, self.borrowing, planes.take(lenders[self.borrowing]))
        places, rows = self.model.index.places, self.model.index.rows
        self.planes = _moved(planes, places)
        lenders = lenders[places]
        return self.planes, np.where(lenders >= 0, rows[lenders], np.arange(len(X)))

    def _fit_members(self):
        """Planes of the index's points (m, d), and the rows of the planes that these borrow."""
        index = self.model.index
        points, (m, d) = index.points, index.points.shape
        planes, smooth = Planes.empty(m, d).without(UNUSED), np.empty(m, dtype=bool)
        self.noise, lenders = np.empty(m), np.full(m, -1, dtype=np.int32)

        def sweep(rows):
            own = Planes.empty(rows.stop - rows.start, d)
            smooth[rows], self.noise[rows] = self._own(points[rows], own, index.query_own(rows))
            planes.put(rows, own)

        def unfold(rows):
            own, around = planes.take(rows), index.query_own(rows)  # views, which are filled
            self._unfold(points[rows], own, smooth[rows], self.noise[rows], around)

        def ask(rows):
            own = planes.take(rows)
            rough = _rough(own, smooth[rows])
            around = index.query_own(rows.start + rough)
            lenders[rows.start + rough] = self._lenders(
                points[rows], own, rough, around, planes, usable
            )

        with progress_part(0.0, 0.8, "normals"):
            each_slice(m, self.model.chunk(), sweep, self.n_jobs)
        with progress_part(0.8, 0.9, "normals next to edges"):
            each_slice(m, self.model.chunk(), unfold, self.n_jobs)
        if self.borrow:
            usable = np.ones(m, dtype=bool)
            with progress_part(0.9, 1.0, "normals next to edges"):
                each_slice(m, self.model.chunk(), ask, self.n_jobs)
        return planes, lenders

    def evaluate(self, queries):
        """Planes of any queries (m, d)."""
        planes, members = Planes.empty(*queries.shape), self._members()
        usable = np.ones(len(members.scale), dtype=bool)

        def task(part):
            points = queries[part]
            around = self._query(points)
            own = Planes.empty(*points.shape)
            smooth, noise = self._own(points, own, around)
            self._unfold(points, own, smooth, noise, around)
            if self.borrow:
                rough = _rough(own, smooth)
                lenders = self._lenders(points, own, rough, around.take(rough), members, usable)
                borrowing = lenders >= 0
                self._lend(own, rough[borrowing], members.take(lenders[borrowing]))
            planes.put(part, own)

        each_chunk(queries, self.model.chunk(), task, self.n_jobs)
        return planes

    def _members(self):
        """The planes of the index's points before any was lent."""
        members = self.planes.take(self.model.index.rows)
        members.put(self.borrowing, self.before)
        return members

    @property
    def compiled(self):
        """Whether compiled code can do the work on this machine; a pickle may reach another."""
        return self.model.ready()

    def _query(self, points):
        return self.model.index.query(np.ascontiguousarray(points, dtype=np.float64))

    def _robust(self, points, around):
        precision = np.finfo(points.dtype).eps
        points = np.ascontiguousarray(points, dtype=np.float64)
        return self.model.evaluate_neighborhoods(points, around, precision)[0]

    def _own(self, points, planes, around):
        """Fill the planes of neighborhoods; smooth ones get the plane of all members. Returns which
        are smooth, bool (m,), and the noise (m,) of the surface, flat or curved."""
        deviation, left, smooth = self._fit_whole(points, planes, around)
        rest = np.flatnonzero(~smooth)
        if len(rest):
            robust = self._robust(points[rest], around.take(rest))
            whole = is_smooth(deviation[rest], left[rest], planes.eigenvalues[rest], robust.scale)
            smooth[rest] = whole
            planes.put(rest[~whole], robust.take(~whole))
        return smooth, np.where(smooth, np.minimum(deviation, left), planes.scale)

    def _fit_whole(self, points, planes, around):
        """Fill planes of all members; return `deviation`, `left` and `ordinary` of `whole_planes`.

        If there are too few members for a deviation, the caller must overwrite the plane.
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
        """Give neighborhoods that lie across a crease their robust planes back, in place."""
        rows = np.flatnonzero(smooth)
        around, radius = around.take(rows), planes.radius[rows]
        creased = np.hypot(noise[rows], LEAST_NOISE * radius) > self._most(
            self.noise, radius, around
        )
        rows = rows[creased]
        if len(rows):
            planes.put(rows, self._robust(points[rows], around.take(creased)))
            smooth[rows] = False

    def _lenders(self, points, planes, rough, around, members, usable):
        """The members whose planes the rows `rough` borrow; -1 for rows that borrow none.

        `around` are the neighborhoods of `rough`.
        """
        lenders = np.full(len(rough), -1)
        queries = np.ascontiguousarray(points[rough], dtype=np.float64)
        own = planes.take(rough)
        least = LEAST_NOISE * own.radius
        most = self._most(members.scale, own.radius, around)
        asking = np.flatnonzero((1 - own.kept > REMOVED) | (np.hypot(own.scale, least) > most))
        likeliest = ExplainLimits(likely=True, explained=EXPLAINED)
        best, _ = explain(
            queries[asking], around.take(asking), members, likeliest, usable,
            least[asking], most[asking], self.compiled,
        )  # fmt: skip
        asking, best = asking[best >= 0], best[best >= 0]
        cosine = np.einsum("md,md->m", own.normals[asking], members.normals[best])
        angle = np.degrees(np.arccos(np.minimum(np.abs(cosine), 1.0)))
        leans = angle > SIGNIFICANT * members.normal_error[best]
        lenders[asking[leans]] = best[leans]
        return lenders

    def _lend(self, planes, rows, lent):
        """Replace rows of planes, in place, by other planes; extents stay the rows' own."""
        own = planes.take(rows)
        planes.put(rows, lent._replace(kept=own.kept, radius=own.radius, spacing=own.spacing))

    def _most(self, values, radius, around):
        """The largest deviation that is usual among the neighbors."""
        usual = quantile_around(values, around, BEST, self.compiled)
        return (1 + NOISY / np.sqrt(2 * around.sizes)) * np.hypot(usual, LEAST_NOISE * radius)


def _moved(planes, places):
    """Planes in another order; without copies in place, a column at a time, to save memory."""
    if len(places) > len(planes.scale):
        return planes.take(places)
    for values in planes:
        for column in np.atleast_2d(values.T) if len(values) else ():
            column[:] = column[places]
    return planes


def _rough(planes, smooth):
    """Rows that are not smooth and have a plane."""
    return np.flatnonzero(~smooth & (planes.scale > 0))
