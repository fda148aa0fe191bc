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
from sklearn_mcmd.planes._resolution import with_depths
from sklearn_mcmd.runtime._chunks import each_slice
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


class ScaleFinder:
    """Finds the size of the neighborhood of each point of a cloud.

    The index is one of ``SizeLimits().around`` neighbors, in 2D or 3D, of coordinates with `Steps`.
    """

    def __init__(self, index, steps, n_jobs):
        self.index, self.n_jobs, self.limits, self.steps = index, n_jobs, SizeLimits(), steps
        self.n, self._done = len(index.points), 0.0

    def sizes(self):
        """Members of the neighborhoods of the index's points: ndarray of int of shape (n,)."""
        everyone, limits = np.ones(self.n, dtype=bool), self.limits
        by_noise = self._quiet(self._by_noise(), everyone)
        across = self._quiet(self._across_rows(), everyone, 1 - limits.quiet)
        sizes = np.rint(np.maximum(by_noise, across).clip(max=limits.most)).astype(np.int64)
        return sizes.clip(max=self.n)

    def _by_noise(self):
        """How many neighbors (n,) it takes for the noise to tilt normals by no more than it may.

        One size is tried after the other, each twice as large as the one before.
        """
        limits, d = self.limits, self.index.points.shape[1]
        k, wanted, fits = min(limits.least, self.n), np.full(self.n, np.inf), None
        while k <= min(limits.most // 2, self.n):
            self._even(wanted)
            todo = wanted == np.inf
            if not todo.any():
                return wanted
            errors, normals = fits or self._fit(k, np.ones(self.n, bool))
            error, sizes = wanted_by(self._quiet(errors, todo), k, d, limits)
            settled = sizes <= 2 * k  # larger sizes follow from the next, twice as large
            if not settled.all():
                fits = self._fit(2 * k, self._reached(todo))
                turns = self._quiet(angles(normals, fits[1]), todo)
                bent = ~settled & are_turned(turns, error)
                sizes[bent] = k
                settled |= bent
            wanted[todo] = np.where(settled, np.maximum(sizes, limits.least), np.inf)
            k *= 2
        self._even(wanted)
        return np.where(wanted == np.inf, limits.most, wanted)

    def _even(self, wanted):
        """Let points want what those around want, in place, where it is inf."""
        todo = wanted == np.inf
        if not todo.all():
            wanted[todo] = self._quiet(wanted, todo)

    def _across_rows(self):
        """How many neighbors (n,) it takes for rows to be less than faces; 0 where none are.

        In rows that are D apart, a point's n = 2 D / s nearest are of its own, s apart.
        """
        k, needed = self.limits.least // 2, np.zeros(self.n)
        rows = needed == 0

        def task(part, around):
            rows[part] = are_rows(whole_planes(self.index.points, around)[0].eigenvalues)

        while rows.any() and k < self.limits.most:
            self._each(rows.copy(), k, task)
            needed[rows] = across_rows(k)
            k *= 2
        return needed

    def _reached(self, rows):
        """Whether each point is around any of some points: bool (n,)."""
        reached = np.full(self.n, rows.all())

        def task(part, around):
            reached[around.indices] = True

        if not rows.all():
            self._each(rows, self.limits.around, task)
        return reached

    def _fit(self, k, rows):
        """Errors in degrees (n,) and normals (n, d) of planes of the k nearest of some points."""
        errors, normals = np.full(self.n, 90.0), np.zeros((self.n, self.index.points.shape[1]))

        def task(part, around):
            planes, _, fit = whole_planes(self.index.points, around)
            determined = np.isfinite(fit.left)  # the members determine a quadric
            noise = np.where(determined, fit.left, 0.0)
            planes.normal_error[:] = normal_errors(noise, planes.eigenvalues, around.sizes)
            tilts = with_depths(planes, self.steps).normal_error
            errors[part], normals[part] = np.where(determined, tilts, 90.0), planes.normals

        self._each(rows, k, task)
        return errors, normals

    def _quiet(self, values, rows, share=None):
        """The value that the share `quiet` of those around do not exceed, of some points."""
        quantiles, share = np.empty(self.n), self.limits.quiet if share is None else share

        def task(part, around):
            quantiles[part] = quantile_around(values, around, share)

        self._each(rows, self.limits.around, task)
        return quantiles[rows]

    def _each(self, wanted, k, work):
        """Call ``work(rows, around)`` with points that are wanted and their k nearest."""
        k, index = min(k, self.n), self.index

        def task(part):
            rows = np.flatnonzero(wanted[part])
            if len(rows):
                around = index.query_own(part, k, keep=k <= index.n_neighbors)
                work(part.start + rows, around.take(rows))

        done, self._done = self._done, self._done + (1 - self._done) * SHARE
        with progress_part(done, self._done):
            each_slice(self.n, index.chunk, task, self.n_jobs)


def sized_index(xyz, steps, radius, n_jobs):
    """The `NeighborIndex` whose neighborhoods have the sizes that their noise requires."""
    index = NeighborIndex(xyz, SizeLimits().around)  # which the next one shares
    sizes = ScaleFinder(index, steps, n_jobs).sizes()
    return NeighborIndex(xyz, int(sizes.max()), radius, sizes)


def across_rows(n):
    """So many neighbors that a row of the n nearest is a face's share f of them, at most: of k in a
    disk it has the share ``sqrt(2 n / (pi k))``, which is f where ``k = 2 n / (pi f^2)``."""
    return 2 / (pi * AgreementLimits().face ** 2) * n


def wanted_by(quiet, k, d, limits):
    """The usual error (m,) of planes of k points, and how many points (m,) would have `tilt`.

    `quiet` is the error that this share of those around do not exceed.
    """
    error = quiet / noise_quantiles(limits.quiet, np.array([k]), d)
    # The error falls as the spread of the k points along the surface, k ** (1 / (d - 1)), and as
    # their mean, k ** (1 / 2).
    return error, k * (error / limits.tilt) ** (1 / (1 / 2 + 1 / (d - 1)))


def are_turned(turns, error):
    """Whether planes of twice as many points turn by more than their errors do by chance."""
    return turns > ndtri(1 - QuadricLimits().chance) * error


def angles(first, second):
    """Angles (m,) between normals of either sign, in degrees."""
    cosine = np.abs(np.einsum("md,md->m", first, second))
    return np.degrees(np.arccos(np.minimum(cosine, 1.0)))
