"""How many neighbors a normal needs: as many as the noise requires, and no more.

Noise tilts the normal of a large neighborhood less than that of a small one, and a small one
follows the surface better. So each point gets the number of neighbors with which the noise tilts
its normal by 2.5 degrees. The noise is what quadrics leave of small neighborhoods around the point.
Where these are too noisy, neighborhoods of twice as many points are taken; but only as
long as the planes of twice as many points turn by no more than noise explains. Where they turn by
more, the surface bends or folds within them.

A scan may have its points in rows. Then noise alone is not what counts: a plane of one row has any
direction. So there are as many neighbors as it takes for no row to be a face of its own.
"""

from math import pi
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from sklearn_mcmd.planes._agreement import AgreementLimits
from sklearn_mcmd.planes._around import quantile_around
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._principal_planes import are_rows, normal_errors
from sklearn_mcmd.planes._quadrics import QuadricLimits, noise_quantiles, whole_planes
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._progress import progress_part

# Of the work not yet done, the share that the next step is said to be: their number is not known.
SHARE = 0.2


class SizeLimits(NamedTuple):
    """What the size of a neighborhood depends on."""

    tilt: float = 2.5  # standard error of a normal, in degrees, that the noise may cause
    least: int = 16  # fewer neighbors leave a quadric too few degrees of freedom
    most: int = 256  # more are seldom worth their time
    # A point's error is the one that this share of the neighborhoods around do not exceed. So next
    # to an edge it is the error on the faces.
    quiet: float = 0.25
    around: int = 64  # points that are around a point


def tried_sizes(m):
    """The sizes of neighborhoods that are tried one after the other, of a cloud of m points."""
    k, sizes = min(SizeLimits().least, m), []
    while k <= min(SizeLimits().most // 2, m):
        sizes.append(k)
        k *= 2
    return sizes


class ScaleFinder:
    """Finds the size of the neighborhood of each point of a cloud.

    The index is one of ``SizeLimits().around`` neighbors, in 2D or 3D. Each step asks for what the
    step before has found of neighbors. So another may find the sizes of the first `n_own` of n
    points, which have all that are around these, step by step.
    """

    def __init__(self, index, n_jobs):
        self.index, self.n_jobs, self.limits = index, n_jobs, SizeLimits()
        self.n = self.n_own = len(index.points)
        self._done = 0.0

    def sizes(self):
        """Members of the neighborhoods of the index's points: ndarray of int of shape (m,)."""
        wanted, fits = np.full(self.n, np.inf), None
        for k in tried_sizes(self.n):
            wanted, fits = self.step(k, wanted, fits)
        return self.joined(self.settled(wanted), self.across_rows())

    def step(self, k, wanted, fits):
        """How many neighbors own points want, inf where planes of k do not tell; and the fits of
        twice as many: errors (n,) and normals (n, d).

        `wanted` (n,), and the fits of k, are what the step before has found; at first inf and None.
        """
        least, d = self.limits.least, self.index.points.shape[1]
        wanted = self._evened(wanted)
        todo = wanted == np.inf
        if not todo.any():
            return wanted, None
        errors, normals = fits or self._fit(k, np.ones(self.n, bool))
        error, found = wanted_by(self._quiet(errors, todo), k, d, self.limits)
        known, larger = found <= 2 * k, None  # larger sizes follow from the next, twice as large
        if not known.all():
            larger = self._fit(2 * k, self._reached(todo))
            turns = self._quiet(angles(normals, larger[1]), todo)
            bent = ~known & are_turned(turns, error)
            found[bent] = k
            known |= bent
        wanted[todo] = np.where(known, np.maximum(found, least), np.inf)
        return wanted, larger

    def settled(self, wanted):
        """How many neighbors own points want, after the last step."""
        wanted = self._evened(wanted)
        return np.where(wanted == np.inf, self.limits.most, wanted)

    def joined(self, wanted, across):
        """The sizes (n_own,) by what all points want, and `across_rows` of all, both (n,)."""
        everyone = np.ones(self.n_own, dtype=bool)
        wanted = self._quiet(wanted, everyone)
        across = self._quiet(across, everyone, 1 - self.limits.quiet)
        sizes = np.rint(np.maximum(wanted, across).clip(max=self.limits.most)).astype(np.int64)
        return sizes.clip(max=len(self.index.points))

    def _evened(self, wanted):
        """What own points want: by those around where it is inf."""
        own = wanted[: self.n_own].copy()
        todo = own == np.inf
        if (wanted < np.inf).any():
            own[todo] = self._quiet(wanted, todo)
        return own

    def across_rows(self):
        """How many neighbors (n_own,) it takes for rows to be less than faces; 0 where none are.

        In rows that are D apart, a point's n = 2 D / s nearest are of its own, s apart. Of k in a
        disk its row has the share ``sqrt(2 n / (pi k))``.
        """
        k, needed = self.limits.least // 2, np.zeros(self.n_own)
        rows, times = needed == 0, 2 / (pi * AgreementLimits().face ** 2)

        def task(part, around):
            planes, directions = Planes.empty(len(part), d), np.empty((len(part), d))
            whole_planes(self.index.points, around, planes, directions)
            rows[part] = are_rows(planes.eigenvalues)

        d = self.index.points.shape[1]
        while rows.any() and k < self.limits.most:
            self._each(rows.copy(), k, task)
            needed[rows] = times * k
            k *= 2
        return needed

    def _reached(self, rows):
        """Whether each point is around any of some own points: bool (n,)."""
        reached = np.full(self.n, rows.all())

        def task(part, around):
            reached[self._numbers(around).indices] = True

        if not rows.all():
            self._each(rows, self.limits.around, task)
        return reached

    def _fit(self, k, rows):
        """Errors in degrees (n,) and normals (n, d) of planes of the k nearest of some points."""
        errors, normals = np.full(self.n, 90.0), np.zeros((self.n, self.index.points.shape[1]))

        def task(part, around):
            planes = Planes.empty(len(part), normals.shape[1])
            _, left, _ = whole_planes(
                self.index.points, around, planes, np.empty_like(planes.normals)
            )
            known = np.isfinite(left)  # the members determine a quadric
            found = normal_errors(np.where(known, left, 0.0), planes.eigenvalues, around.sizes)
            errors[part], normals[part] = np.where(known, found, 90.0), planes.normals

        self._each(rows, k, task)
        return errors, normals

    def _quiet(self, values, rows, share=None):
        """The value that the share `quiet` of those around do not exceed, of some own points."""
        found, share = np.empty(self.n_own), self.limits.quiet if share is None else share

        def task(part, around):
            found[part] = quantile_around(values, self._numbers(around), share)

        self._each(rows, self.limits.around, task)
        return found[rows]

    def _numbers(self, around):
        """Neighborhoods by numbers among the n points, in place of rows of the index."""
        return around

    def _each(self, wanted, k, work):
        """Call ``work(some, around)`` with points that are wanted and their k nearest."""
        done, self._done = self._done, self._done + (1 - self._done) * SHARE
        with progress_part(done, self._done):
            self.index.visit_own(wanted, min(k, len(wanted)), work, self.n_jobs)


def sized_index(xyz, radius, n_jobs):
    """The `NeighborIndex` whose neighborhoods have the sizes that their noise requires."""
    index = NeighborIndex(xyz, SizeLimits().around)  # which the next one shares
    sizes = ScaleFinder(index, n_jobs).sizes()
    return NeighborIndex(xyz, int(sizes.max()), radius, sizes)


def wanted_by(quiet, k, d, limits):
    """The usual error (m,) of planes of k points, and how many points (m,) would have `tilt`.

    `quiet` is the error that this share of those around do not exceed.
    """
    error = quiet / noise_quantiles(limits.quiet, np.array([k]), d)
    # Of k points, the spread along the surface grows as k ** (1 / (d - 1)).
    return error, k * (error / limits.tilt) ** (1 / (1 / 2 + 1 / (d - 1)))


def are_turned(turns, error):
    """Whether planes of twice as many points turn by more than their errors do by chance."""
    return turns > ndtri(1 - QuadricLimits().chance) * error


def angles(first, second):
    """Angles (m,) between normals of either sign, in degrees."""
    cosine = np.abs(np.einsum("md,md->m", first, second))
    return np.degrees(np.arccos(np.minimum(cosine, 1.0)))
