"""The plane of the surface that a point lies on: its own, or near an edge that of a neighbor.

Three corrections improve the planes of Algorithm 4. A smooth neighborhood keeps all its members. If
it bends, its normal is that of a quadric at the point. In other neighborhoods, next to an edge, the
majority may lie on the other face, or one plane may run across both faces. There the point is given
the plane of a neighbor that explains it best. Planes noisier than is usual around come last.

One point alone lies near many planes by chance, also near wrong ones. So a plane must explain the
patch around the point as well: its nearest neighbors, of which most lie on the same face. The
standard error of a plane says how noise tilts it, and not that another plane could have been
chosen. Those planes exist, one of each neighbor, and so do their probabilities.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.normals._adaptive_k import angles
from sklearn_mcmd.planes._around import most_noise_around, quantile_around, ratio
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._principal_planes import are_rows
from sklearn_mcmd.planes._quadrics import (
    QuadricLimits,
    are_folded,
    is_smooth,
    quadric_normals,
    tangents_of,
    work_arrays,
)
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import each_chunk
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.runtime._progress import progress_part

# Forms of neighborhoods: ROUGH ones have a robust plane, and may borrow another. The others keep
# all members: FLAT ones have the plane of these, BENT ones the tangent plane of a quadric.
ROUGH, FLAT, BENT = range(3)


class MendLimits(NamedTuple):
    """When the plane of a neighborhood is mended."""

    # A point may borrow a plane if a larger share of its own neighborhood was removed, or if its
    # plane is noisier than is usual around.
    removed: float = 0.1
    # Share of the neighbors that say what noise is usual around a point: among two fifths of
    # outliers few neighborhoods are without any.
    quiet: float = 0.1
    # Half a ball deviates from its plane by this share of its width, both as standard deviations.
    # What bends more is no height over a plane, whatever a quadric makes of it.
    half_ball: float = 0.5


class PatchLimits(NamedTuple):
    """What the patch of a point is."""

    # Standard deviations within which a plane explains its point. Members of the patch count as
    # this far off at most, since some lie on the other face.
    explained: float
    patch: float = 1 / 3  # share of the neighborhood that is the patch: those nearest to the point


class Patch(NamedTuple):
    """Work arrays for a patch of k points at most, parts of one array."""

    places: np.ndarray  # (d, k), from the query
    heights: np.ndarray  # (k,), above a plane

    @classmethod
    def empty(cls, d, k):
        """Arrays to be filled."""
        rows = np.empty((d + 1, k))
        return cls(rows[:d], rows[d])


class NearPlanes(NamedTuple):
    """Work arrays for at most k planes of neighbors, any of which may be that of the query."""

    heights: np.ndarray  # (k,), of the query above them, inf where they do not reach it; then costs
    doubt: np.ndarray  # (k,), square degrees by which angles to the query's normal exceed chance
    places: np.ndarray  # (2, k), of their points from the query, along two tangents of its plane
    leans: np.ndarray  # (2, k), of their normals along the same tangents: sines of angles


class QuadricArrays(NamedTuple):
    """Work arrays for the quadric of k members at most; see `work_arrays`."""

    local: np.ndarray  # (3, k), their coordinates from the query
    heights: np.ndarray  # (k,), over the query's plane
    lower: np.ndarray  # the normal equations, as a lower triangle
    right: np.ndarray
    solution: np.ndarray
    pivot: float  # as of `QuadricLimits`


class DoubtArrays(NamedTuple):
    """What `doubted_errors` works with."""

    tangents: np.ndarray  # (m, d - 1, d), of the queries' planes
    patch: Patch
    near_planes: NearPlanes
    quadric: QuadricArrays


class Surfaces(NamedTuple):
    """What is known of the surfaces of m points before any plane is lent."""

    planes: Planes
    forms: np.ndarray  # int8 (m,): ROUGH, FLAT or BENT
    noise: np.ndarray  # (m,), what the surface, flat or curved, leaves of the neighborhood
    left: np.ndarray  # (m,), what it leaves of the members of its plane

    def take(self, rows):
        """Those of a slice of the points, as views, which can be filled."""
        return Surfaces(
            planes=self.planes.take(rows),
            forms=self.forms[rows],
            noise=self.noise[rows],
            left=self.left[rows],
        )

    def put(self, rows, part):
        """Overwrite those of some of the points; of a slice these may be views of them."""
        self.planes.put(rows, part.planes)
        for values, new in zip(self[1:], part[1:], strict=True):
            values[rows] = new


class SurfacePlanes:
    """Finds planes of the surfaces of a cloud's points, by an estimator that `mends_planes`."""

    def __init__(self, estimator, model):
        self.model, self.tangents = model, estimator.tangents
        self.lends = estimator.neighbor_planes

    def fit(self, X, n_jobs):
        """Planes of the fitted points X (n, d), the rows of X (n,) whose planes they are, and the
        `FittedSurfaces`, which answer for other points. The members' planes are used up."""
        index, (m, d) = self.model.index, self.model.index.points.shape
        planes = Planes.empty(m, d)
        members = Surfaces(planes, np.empty(m, np.int8), np.empty(m), np.empty(m))
        chunk, lenders, errors = self.model.chunk(), np.full(m, -1, dtype=np.int32), np.empty(m)

        def keep_whole(rows, whole, fit):
            planes.put(rows, whole)
            members.forms[rows] = np.where(fit.ordinary, FLAT, BENT)
            members.noise[rows], members.left[rows] = fit.deviation, fit.left

        def find_rough(rows):
            surfaces = members.take(rows)
            self._find_rough(index.points[rows], index.query_own(rows), surfaces)
            members.put(rows, surfaces)

        def bend(rows):
            surfaces = members.take(rows)
            bent, forms, _, left = surfaces
            around = index.query_own(rows)
            self._bend(index.points[rows], bent, forms, left, around, members.noise)
            left[:] = np.where(forms == BENT, left, bent.scale)
            members.put(rows, surfaces)

        def finish(rows):
            last = planes.take(rows if isinstance(rows, np.ndarray) else np.r_[rows])  # a copy
            forms, around = members.forms[rows], index.query_own(rows)
            lenders[rows] = self._finish(index.points[rows], last, forms, around, members)
            errors[rows] = last.normal_error

        # Step 1: planes of all members, and robust ones where a quadric leaves more than these.
        with progress_part(0.0, 0.8, "normals"):
            with progress_part(0.0, 0.7):
                self.model.agree(n_jobs, keep=keep_whole, hops=2)
            with progress_part(0.7, 1.0):
                index.each_asked(2, chunk, find_rough, n_jobs)
        # Step 2: forms by what is usual, and tangent planes; then lenders and errors, while no
        # plane is lent yet.
        with progress_part(0.8, 1.0, "normals next to edges"):
            with progress_part(0.0, 0.5):
                index.each_asked(1, chunk, bend, n_jobs)
            with progress_part(0.5, 1.0):
                index.each_asked(0, chunk, finish, n_jobs)
        # Step 3: lend planes.
        borrowing = np.flatnonzero(lenders >= 0)
        before, undoubted = planes.take(borrowing), planes.normal_error.copy()
        lend(planes, borrowing, planes, lenders[borrowing])
        planes.normal_error[:] = errors
        planes, lenders = _moved(planes, index.places), lenders[index.places]
        fitted = FittedSurfaces(
            surfaces=self,
            members=members._replace(planes=Planes.empty(0, d)),
            planes=planes,
            borrowing=borrowing,
            before=before,
            errors=undoubted,
        )
        return planes, np.where(lenders >= 0, index.rows[lenders], np.arange(len(X))), fitted

    def evaluate_neighborhoods(self, points, around, members):
        """Planes of queries (m, d) whose neighborhoods are given, by the members' `Surfaces`."""
        planes, (deviation, left, ordinary) = self.model.whole_planes(points, around)
        forms = np.where(ordinary, FLAT, BENT).astype(np.int8)
        self._find_rough(points, around, Surfaces(planes, forms, deviation, left))
        self._bend(points, planes, forms, left, around, members.noise)
        self._finish(points, planes, forms, around, members)
        return planes

    def _finish(self, points, planes, forms, around, members):
        """Lend planes where these are needed, and add to errors of normals the doubt which plane is
        right, in place. Returns the lenders (m,), -1 where a point keeps its plane."""
        lenders, noisy = np.full(len(points), -1), members.planes._replace(scale=members.left)
        if self.lends:
            rough = np.flatnonzero((forms == ROUGH) & (planes.scale > 0))
            lenders[rough] = self._lenders(points, planes, rough, around.take(rough), noisy)
            borrowing = np.flatnonzero(lenders >= 0)
            lend(planes, borrowing, members.planes, lenders[borrowing])
        # Of many planes of few members some have little noise by chance. Their errors grow by how
        # much noisier half of the planes around are.
        noisier = ratio(quantile_around(noisy.scale, around, 0.5), planes.scale)
        errors = np.where(planes.scale > 0, np.maximum(noisier, 1.0), 1.0) * planes.normal_error
        planes.normal_error[:] = np.minimum(errors, 90.0)
        queries = np.ascontiguousarray(points, dtype=np.float64)
        planes.normal_error[:] = doubted_errors(
            self.model.index.points, queries, around, planes, noisy, forms != ROUGH
        )
        return lenders

    def _robust(self, points, around):
        """Robust planes of neighborhoods whose radii are known."""
        precision = np.finfo(points.dtype).eps
        points = np.ascontiguousarray(points, dtype=np.float64)
        return self.model.evaluate_neighborhoods(points, around, precision, measured=False)[0]

    def _find_rough(self, points, around, surfaces):
        """Give neighborhoods that are not smooth their robust planes, in place.

        The `surfaces` have planes of all members, FLAT where these are ordinary, else BENT; their
        noise is what that plane leaves, and becomes that of the surface, flat or curved.
        """
        planes, forms, noise, left = surfaces
        asked = np.flatnonzero(forms != FLAT)
        if len(asked):
            robust = self._robust(points[asked], around.take(asked))
            rough = ~is_smooth(left[asked], robust.scale)
            rough |= _bends_too_much(noise[asked], left[asked], planes.take(asked))
            # Planes of many directions fit a row, and that of its rays to the sensor without noise.
            rough &= are_rows(planes.eigenvalues[asked]) | ~are_rows(robust.eigenvalues)
            forms[asked[rough]] = ROUGH
            planes.put(asked[rough], robust.take(rough))
        least = self.model.least_scales(planes.centroids)
        left[:] = np.maximum(np.minimum(noise, left), least)
        noise[:] = np.where(forms == ROUGH, planes.scale, left)

    def _bend(self, points, planes, forms, left, around, noise):
        """Correct the forms of neighborhoods by what is usual around, and give those that bend the
        tangent planes of their quadrics, in place.

        Where a quadric leaves more, a surface may be folded: a curved one is as curved next to a
        point as at it.
        """
        creased = ~(left <= most_noise_around(noise, around, around.sizes, MendLimits().quiet))
        self._smooth(points, planes, forms, np.flatnonzero(~creased & (forms == ROUGH)), around)
        self._unfold(points, planes, forms, np.flatnonzero(creased & (forms != ROUGH)), around)
        rows = np.flatnonzero(forms == BENT)
        if self.tangents and len(rows):
            whole = planes.take(rows)
            queries = np.ascontiguousarray(points[rows], dtype=np.float64)
            normals, centroids, errors = quadric_normals(
                self.model.index.points, queries, around.take(rows), whole, left[rows]
            )
            planes.put(
                rows, whole._replace(normals=normals, centroids=centroids, normal_error=errors)
            )

    def _smooth(self, points, planes, forms, rows, around):
        """Give rough neighborhoods whose quadrics leave no more than usual all members back."""
        if len(rows):
            near = around.take(rows)
            whole, fit = self.model.whole_planes(points[rows], near)
            smooth = ~_bends_too_much(fit.deviation, fit.left, whole)
            planes.put(rows[smooth], whole.take(smooth))
            forms[rows[smooth]] = BENT

    def _unfold(self, points, planes, forms, rows, around):
        """Give neighborhoods that are folded their robust planes back, in place."""
        if len(rows):
            near = around.take(rows)
            faces = self._robust(points[rows], near)
            folded = forms[rows] == FLAT  # one plane across the faces, with noise of their heights
            bent = np.flatnonzero(~folded)
            folded[bent] = are_folded(
                self.model.index.points, near.take(bent), planes.take(rows[bent]), faces.take(bent)
            )
            planes.put(rows[folded], faces.take(folded))
            forms[rows[folded]] = ROUGH

    def _lenders(self, points, planes, rough, around, members):
        """The members whose planes the rows `rough` borrow, -1 for none; their scales are noise."""
        lenders = np.full(len(rough), -1)
        queries = np.ascontiguousarray(points[rough], dtype=np.float64)
        rough_planes, limits = planes.take(rough), MendLimits()
        most = most_noise_around(members.scale, around, around.sizes, limits.quiet)
        asking = np.flatnonzero(
            (1 - rough_planes.kept > limits.removed) | (rough_planes.scale > most)
        )
        best = find_lenders(
            self.model.index.points, queries[asking], around.take(asking), members, most[asking]
        )
        asking, best = asking[best >= 0], best[best >= 0]
        angle = angles(rough_planes.normals[asking], members.normals[best])
        # A plane that leans by less is the least noisy of many by chance, and no better. Normals
        # whose tilts are E each (root mean square) differ by E in either direction: of the angles
        # a share `chance` is larger than E sqrt(-2 ln(chance)), by Rayleigh's distribution.
        leans = angle > np.sqrt(-2 * np.log(QuadricLimits().chance)) * members.normal_error[best]
        lenders[asking[leans]] = best[leans]
        return lenders


class FittedSurfaces(NamedTuple):
    """The planes of a fitted cloud, from which those of other points follow."""

    surfaces: SurfacePlanes
    members: Surfaces  # of the index's points, but for their planes
    planes: Planes  # of the rows of X
    borrowing: np.ndarray  # those of the index's points that borrow a plane
    before: Planes  # that these had of their own
    errors: np.ndarray  # of the normals of all of the index's points, before any doubt

    def evaluate(self, queries, n_jobs):
        """Planes of any queries (m, d)."""
        m, d = queries.shape
        model, planes = self.surfaces.model, Planes.empty(m, d)
        unlent = self.planes.take(model.index.rows)
        unlent.put(self.borrowing, self.before)
        unlent = unlent._replace(normal_error=self.errors)
        members = self.members._replace(planes=unlent)

        def task(part):
            points = queries[part]
            around = model.index.query(np.ascontiguousarray(points, dtype=np.float64))
            planes.put(part, self.surfaces.evaluate_neighborhoods(points, around, members))

        each_chunk(queries, model.chunk(), task, n_jobs)
        return planes


def lend(planes, rows, members, lenders):
    """Replace rows of planes, in place, by those of lenders.

    Kept shares and radii stay the rows' own. A borrowed normal is no better known than the own was.
    """
    borrowers, lent = planes.take(rows), members.take(lenders)
    error = np.maximum(borrowers.normal_error, lent.normal_error)
    lent = lent._replace(kept=borrowers.kept, radius=borrowers.radius, normal_error=error)
    planes.put(rows, lent)


def _moved(planes, places):
    """Planes in another order; without copies in place, a column at a time, to save memory."""
    if len(places) > len(planes.scale):
        return planes.take(places)
    for values in planes:
        for column in np.atleast_2d(values.T) if len(values) else ():
            column[:] = column[places]
    return planes


def _bends_too_much(deviation, left, planes):
    """Whether neighborhoods bend more than half a ball, apart from noise: what a plane leaves has
    the bend and the noise, whose squares add up, and the width is that of their narrower side."""
    return (
        np.square(deviation)
        > np.square(left) + MendLimits().half_ball ** 2 * planes.eigenvalues[:, 1]
    )


def find_lenders(points, queries, around, planes, most):
    """The neighbors whose planes are the most likely ones of patches.

    By Bayes' rule this is the plane with the least sum of ``log S + (r / S)^2 / 2 - log f``, where
    r is a point's distance to the plane, S the plane's standard deviation and f the share of its
    neighborhood that it keeps, the prior probability. The query weighs as much as all other points
    of the patch. The weights of these fall by the same step from each to the next farther one.

    Planes that are not noisier than `most` (m,) and explain the query come first. A plane reaches
    as far from its centroid as its neighborhood does from its point. Points and queries are
    float64, and `around` has rows of both `points` and `planes`. Returns rows of `planes`, int64
    (m,), -1 where none reaches the query.
    """
    lenders, limits = np.empty(len(queries), dtype=np.int64), PatchLimits(ExplainLimits().explained)
    patch = Patch.empty(queries.shape[1], around.indices.shape[1])
    find = compiled_function("normals._surface_planes_numba", "find_lenders")
    find(points, queries, around, planes, most, limits, patch, lenders)
    return lenders


def doubted_errors(points, queries, around, planes, members, smooth):
    """Standard errors of normals (m,) in degrees, with the doubt which surface is the right one.

    It is the error of a mixture, within and between its planes:
    ``E^2 + sum of w_j max(0, a_j^2 - 2 (E^2 + E_j^2))``. Here a_j are the angles to the normal of
    the planes j of neighbors, and w_j their probabilities by the costs of `find_lenders`.

    Next to an edge they are those of the nearest third of the neighborhood, of which any could be
    the query's. In a `smooth` neighborhood, bool (m,), they are those of the farthest third, which
    have the least members in common with it. The angles count only as far as they are also beyond
    chance when what the quadric of the neighborhood turns by to their places is subtracted, whose
    variance is then chance as well. At a crease that a quadric rounds, and on a fillet, surfaces
    turn less than that. The sum counts d - 1 times, since a crease turns in one direction, and the
    planes lie around in all.

    `planes` are those that the queries have in the end, `members` those of the points before any is
    lent, whose scale is noise: of those that bend, what the quadric leaves.
    """
    errors, (d, k) = np.empty(len(queries)), (queries.shape[1], around.indices.shape[1])
    local, (lower, right, solution) = work_arrays(4, k)
    rows = np.empty((6, k))
    work = DoubtArrays(
        tangents=tangents_of(planes.normals),
        patch=Patch.empty(d, k),
        near_planes=NearPlanes(heights=rows[0], doubt=rows[1], places=rows[2:4], leans=rows[4:]),
        quadric=QuadricArrays(
            local=local[:3],
            heights=local[3],
            lower=lower,
            right=right,
            solution=solution,
            pivot=QuadricLimits().pivot,
        ),
    )
    find = compiled_function("normals._surface_planes_numba", "doubted_errors")
    limits = PatchLimits(ExplainLimits().explained)
    find(points, queries, around, planes, members, smooth, limits, work, errors)
    return errors
