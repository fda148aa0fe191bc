"""The plane of the surface that a point lies on: its own, or near an edge that of a neighbor.

Three corrections improve the planes of Algorithm 4. A smooth neighborhood keeps all its members. If
it bends, its normal is that of a quadric at the point. In other neighborhoods, next to an edge, the
majority may lie on the other face, or one plane may run across both faces. There the point is given
the plane of a neighbor that explains it best. Planes noisier than is usual around come last.
"""

import numpy as np

from sklearn_mcmd.normals._folds import are_folded, quadric_normals
from sklearn_mcmd.normals._lenders import find_lenders
from sklearn_mcmd.normals._smoothness import SmoothnessLimits, is_smooth, whole_planes
from sklearn_mcmd.planes._around import extents, quantile_around
from sklearn_mcmd.planes._chunks import each_chunk, each_slice
from sklearn_mcmd.planes._plane import flat_normals, normal_errors
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.planes._record import Planes

__all__ = ["SurfacePlanes"]

# Forms of neighborhoods: ROUGH ones have a robust plane, and may borrow another. The others keep
# all members: FLAT ones have the plane of these, BENT ones the tangent plane of a quadric.
ROUGH, FLAT, BENT = range(3)
# A point asks its neighbors if a larger share of its own neighborhood was removed, or if its plane
# is noisier than is usual around.
REMOVED = 0.1
# Least noise of a plane, as a share of its neighborhood's radius.
LEAST_NOISE = 0.01
# The usual noise around a point is the noise of the best tenth of its neighbors. A plane may exceed
# it by NOISY standard errors of a deviation. Where a quadric leaves more, a surface may be folded:
# a curved one is as curved next to a point as at the point.
BEST, NOISY = 0.1, 3.0
# A plane is borrowed only if it leans by more than this number of its standard errors, within which
# the true normal is with 95 % confidence. With less, it is the least noisy of many planes by
# chance, and no better.
SIGNIFICANT = 1.73
# Field of the planes that no one asks of a member.
UNUSED = "spacing"


class SurfacePlanes:
    """Planes of the surfaces of a fitted cloud.

    Parameters
    ----------
    model : LocalPlaneModel
        A model with neighborhoods.
    borrow : bool
    n_jobs : int or None
    """

    ROUGH, BENT = ROUGH, BENT

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
        planes, forms = Planes.empty(m, d).without(UNUSED), np.empty(m, dtype=np.int8)
        self.noise, lenders = np.empty(m), np.full(m, -1, dtype=np.int32)

        def sweep(rows):
            own = Planes.empty(rows.stop - rows.start, d)
            found = self._own(points[rows], own, index.query_own(rows))
            forms[rows], self.noise[rows] = found
            planes.put(rows, own)

        def bend(rows):
            own, around = planes.take(rows), index.query_own(rows)  # views, which are filled
            self._bend(points[rows], own, forms[rows], self.noise[rows], around)

        def ask(rows):
            own = planes.take(rows)
            rough = _rough(own, forms[rows])
            around = index.query_own(rows.start + rough)
            found = self._lenders(points[rows], own, rough, around, lent)
            lenders[rows.start + rough] = found

        with progress_part(0.0, 0.8, "normals"):
            each_slice(m, self.model.chunk(), sweep, self.n_jobs)
        with progress_part(0.8, 0.9, "normals next to edges"):
            each_slice(m, self.model.chunk(), bend, self.n_jobs)
        self.lent_noise = np.where(forms == BENT, self.noise, planes.scale)
        lent = planes._replace(scale=self.lent_noise)
        if self.borrow:
            with progress_part(0.9, 1.0, "normals next to edges"):
                each_slice(m, self.model.chunk(), ask, self.n_jobs)
        return planes, lenders

    def evaluate(self, queries):
        """Planes of any queries (m, d)."""
        planes = Planes.empty(*queries.shape)
        members = self.members_of(np.arange(len(self.model.index.points)))

        def task(part):
            points = queries[part]
            around = self._query(points)
            own = Planes.empty(*points.shape)
            forms, noise = self._own(points, own, around)
            self._bend(points, own, forms, noise, around)
            if self.borrow:
                self.lend(points, own, forms, around, members, self.lent_noise)
            planes.put(part, own)

        each_chunk(queries, self.model.chunk(), task, self.n_jobs)
        return planes

    def members_of(self, rows):
        """The planes of some of the index's points before any was lent."""
        members = self.planes.take(self.model.index.rows[rows])
        if len(self.borrowing):
            places = np.minimum(np.searchsorted(self.borrowing, rows), len(self.borrowing) - 1)
            borrowed = np.flatnonzero(self.borrowing[places] == rows)
            members.put(borrowed, self.before.take(places[borrowed]))
        return members

    def lend(self, points, planes, forms, around, members, noise):
        """Replace planes of queries, in place, by those of members that explain them better.

        Parameters
        ----------
        points : ndarray of shape (m, d)
        planes : Planes
        forms : ndarray of int of shape (m,)
        around : Neighborhoods
        members : Planes
            Of the model's points.
        noise : ndarray
            What a surface leaves at each of these.
        """
        rough = _rough(planes, forms)
        lent = members._replace(scale=noise)
        lenders = self._lenders(points, planes, rough, around.take(rough), lent)
        borrowing = lenders >= 0
        self._lend(planes, rough[borrowing], members.take(lenders[borrowing]))

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
        """Fill the planes of neighborhoods; smooth ones get the plane of all members.

        Returns the forms (m,), where BENT ones may be folded, and the noise (m,) of the surface,
        flat or curved.
        """
        deviation, left, ordinary = self._fit_whole(points, planes, around)
        forms = np.where(ordinary, FLAT, BENT).astype(np.int8)
        rest = np.flatnonzero(~ordinary)
        if len(rest):
            robust = self._robust(points[rest], around.take(rest))
            rough = ~is_smooth(left[rest], robust.scale)
            forms[rest[rough]] = ROUGH
            planes.put(rest[rough], robust.take(rough))
        noise = np.maximum(np.minimum(deviation, left), self._floor(planes))
        noise[forms == ROUGH] = planes.scale[forms == ROUGH]
        return forms, noise

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
        planes.scale[:] = np.maximum(deviation, self._floor(planes))
        planes.kept[:] = 1.0
        planes.normal_error[:] = normal_errors(planes.scale, planes.eigenvalues, around.sizes)
        return found

    def _bend(self, points, planes, forms, noise, around):
        """Give folded neighborhoods their robust planes back, and others that bend the tangent
        planes of their quadrics, in place."""
        self._unfold(points, planes, forms, noise, around)
        rows = np.flatnonzero(forms == BENT)
        if len(rows):
            whole = planes.take(rows)
            queries = np.ascontiguousarray(points[rows], dtype=np.float64)
            normals, centroids, errors = quadric_normals(
                self.model.index.points, queries, around.take(rows), whole, noise[rows],
                self.compiled,
            )  # fmt: skip
            planes.put(
                rows, whole._replace(normals=normals, centroids=centroids, normal_error=errors)
            )

    def _unfold(self, points, planes, forms, noise, around):
        """Give neighborhoods that are folded their robust planes back, in place.

        They are looked for where more noise is left than is usual around.
        """
        rows = np.flatnonzero(forms != ROUGH)
        near, radius = around.take(rows), planes.radius[rows]
        creased = np.hypot(noise[rows], LEAST_NOISE * radius) > self._most(self.noise, radius, near)
        rows, near = rows[creased], near.take(creased)
        if len(rows):
            faces = self._robust(points[rows], near)
            members, whole = self.model.index.points, planes.take(rows)
            folded = are_folded(members, near, whole, faces, self.compiled)
            folded |= forms[rows] == FLAT  # one plane across the faces, with noise of their heights
            planes.put(rows[folded], faces.take(folded))
            forms[rows[folded]] = ROUGH

    def _floor(self, planes):
        """Least deviations that are no rounding."""
        rounding = self.model.rounding * np.abs(planes.centroids).max(axis=1)
        return np.maximum(rounding, self.model.least_scale)

    def _lenders(self, points, planes, rough, around, members):
        """The members whose planes the rows `rough` borrow; -1 for rows that borrow none.

        `around` are the neighborhoods of `rough`. The scales of `members` are noise: of those that
        bend, what the quadric leaves.
        """
        lenders = np.full(len(rough), -1)
        queries = np.ascontiguousarray(points[rough], dtype=np.float64)
        own = planes.take(rough)
        least = LEAST_NOISE * own.radius
        most = self._most(members.scale, own.radius, around)
        asking = np.flatnonzero((1 - own.kept > REMOVED) | (np.hypot(own.scale, least) > most))
        best = find_lenders(
            self.model.index.points, queries[asking], around.take(asking), members,
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


def _rough(planes, forms):
    """Rows that are rough and have a plane."""
    return np.flatnonzero((forms == ROUGH) & (planes.scale > 0))
