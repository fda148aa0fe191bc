"""Trials until the outlier share seen in a neighborhood needs no more (Eq. 13).

``outlier_rate="auto"`` makes the first 32 trials of the table. It makes the others only where the
plane found so far does not *settle* its neighborhood: see `settled`. A plane across two surfaces
must not settle one, or a neighborhood with half outliers would get a wrong plane. Three tests
together prevent this.

Estimators use it from four dimensions on. In three dimensions they make all trials, since compiled
code screens them at once: with fewer trials the fit took 0.94 to 1.09 of the time.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from scipy.special import ndtri

from sklearn_mcmd.planes._consistent_set import (
    DISTANCE_STEP,
    localize,
    maximum_consistent_sets,
    n_trials_needed,
)
from sklearn_mcmd.planes._plane import fit_planes, orthogonal_distances

__all__ = ["StopRule", "adaptive_consistent_sets", "settled"]

# At a success probability of 0.9999, 32 trials suffice for 37 % of outliers in 3D. One check
# after 16 saves no more time, since 16 trials do not fill the processor, and costs the others.
CHECKPOINTS = (32,)
# Members of a neighborhood that may stop early. Smaller ones tell too little about their outlier
# share. In larger ones the pairs of the third test take as long as the trials.
SMALLEST, LARGEST = 20, 200
CONFIDENCE = 0.95  # of the one-sided bound on the outlier share
INLIER_CUTOFF = 2.5
# Thickness of the thickest plane that may settle a neighborhood: the standard deviation along the
# normal over that along the shorter axis within the plane.
FLATNESS = 0.15
# The third test looks at pairs of points whose squared distance is below this share of the mean
# variance within the plane. Noise alone leaves their residuals independent.
REACH = 0.5
COHERENCE = 0.5
# Planes thinner than this, in median radii, are perfect: their residuals are rounding errors.
PERFECT = 16 * DISTANCE_STEP


@dataclass(frozen=True)
class StopRule:
    """When to stop, by the size of a neighborhood.

    checkpoints : ndarray of int of shape (C,)
        Numbers of trials, ascending, at most half of the length of the table.
    least_inliers : ndarray of int of shape (C, k + 1)
        Inliers that a neighborhood of each size needs, so that this number of trials covers
        its outlier share. The count is larger than the size where it must not stop.
    scale_factor : ndarray of shape (k + 1,)
        Factor from the deviation of a consistent set to that of the noise, by size.
    """

    checkpoints: np.ndarray
    least_inliers: np.ndarray
    scale_factor: np.ndarray

    @classmethod
    def of(cls, n_trials, n_support, success_probability, d):
        """The rule for a table of n_trials; `n_support` holds h of each size 0 ... k."""
        sizes = np.arange(len(n_support))
        checkpoints = np.array([n for n in CHECKPOINTS if 2 * n <= n_trials], dtype=np.int64)
        least = np.tile(sizes + 1, (len(checkpoints), 1))
        factor = np.ones(len(sizes))
        for size in sizes[SMALLEST : LARGEST + 1]:
            factor[size] = _scale_factor(n_support[size], size, d)
            for check, n in enumerate(checkpoints):
                least[check, size] = _least_inliers(n, size, success_probability, d)
        return cls(checkpoints, least, factor)

    @classmethod
    def never(cls):
        """The rule of a fixed number of trials."""
        return cls(np.empty(0, np.int64), np.empty((0, 0), np.int64), np.empty(0))


def _least_inliers(n_trials, size, success_probability, d):
    for count in range(size + 1):
        share = 1.0 - _lower_bound(count, size)
        if n_trials_needed(min(share, 1.0), success_probability, d) <= n_trials:
            return count
    return size + 1


def _lower_bound(count, size):
    """Wilson's lower bound of a share that was observed as `count` of `size`."""
    z = float(ndtri(CONFIDENCE))
    share, correction = count / size, z * z / size
    spread = z * sqrt(share * (1 - share) / size + correction / size / 4)
    return (share + correction / 2 - spread) / (1 + correction)


def _scale_factor(h, size, d):
    """Noise over the deviation of the middle part of a normal sample, with the small-sample
    factor of least median of squares (Rousseeuw and Leroy, 1987, chapter 5)."""
    share = h / size
    if share >= 1.0:
        variance = 1.0
    else:
        cut = float(ndtri((1 + share) / 2))
        variance = 1.0 - 2 * cut * np.exp(-(cut**2) / 2) / (np.sqrt(2 * np.pi) * share)
    return (1 + 5 / max(size - d, 1)) / sqrt(variance)


def adaptive_consistent_sets(neighborhoods, trials, n_support, rule, sizes=None):
    """Find the maximum consistent set of each neighborhood with no more trials than it needs.

    Parameters
    ----------
    neighborhoods, trials, n_support, sizes
        See `maximum_consistent_sets`.
    rule : StopRule

    Returns
    -------
    support, least_eigenvalue, degenerate
        What `maximum_consistent_sets` finds in the first `n_used` trials of the table.
    n_used : ndarray of int of shape (B,)
        Number of trials made.
    """
    n_sets, k, _ = neighborhoods.shape
    sizes = np.full(n_sets, k) if sizes is None else np.asarray(sizes)
    n_support = np.broadcast_to(n_support, n_sets)
    support = np.zeros((n_sets, k), dtype=bool)
    least, degenerate = np.zeros(n_sets), np.zeros(n_sets, dtype=bool)
    n_used = np.full(n_sets, len(trials))
    if len(rule.checkpoints) == 0:
        return *maximum_consistent_sets(neighborhoods, trials, n_support, sizes), n_used
    local, _ = localize(neighborhoods, sizes)
    left = np.arange(n_sets)
    for check, n_trials in enumerate(rule.checkpoints):
        # Neighborhoods that cannot stop wait for the whole table.
        able = left[rule.least_inliers[check, sizes[left]] <= sizes[left]]
        if able.size == 0:
            continue
        found = maximum_consistent_sets(
            neighborhoods[able], trials[:n_trials], n_support[able], sizes[able]
        )
        size = sizes[able]
        done = ~found[2] & settled(
            local[able],
            size,
            found[0],
            rule.scale_factor[size],
            rule.least_inliers[check, size],
        )
        rows = able[done]
        support[rows], least[rows], degenerate[rows] = (part[done] for part in found)
        n_used[rows] = n_trials
        left = np.setdiff1d(left, rows)
    if left.size:
        support[left], least[left], degenerate[left] = maximum_consistent_sets(
            neighborhoods[left], trials, n_support[left], sizes[left]
        )
    return support, least, degenerate, n_used


def settled(local, sizes, support, scale_factor, least_inliers):
    """Whether the planes of consistent sets make further trials unnecessary.

    Parameters
    ----------
    local : ndarray of shape (B, k, d)
        Neighborhoods, by `localize`.
    sizes : ndarray of int of shape (B,)
    support : ndarray of bool of shape (B, k)
    scale_factor, least_inliers : ndarray of shape (B,)
        From `StopRule`.

    Returns
    -------
    ndarray of bool of shape (B,)

    Notes
    -----
    A plane settles its neighborhood if

    1. it has enough inliers, within 2.5 times the scale of its set. Enough means that the upper
       bound of the outlier share (Wilson, 95 %) needs no more trials by Eq. 13;
    2. it is flat: the inliers' deviation along the normal is at most 0.15 of the lesser one
       within the plane. A plane through most of two surfaces is thick, unless the two surfaces
       are nearly one;
    3. the residuals of inliers next to each other are independent. On a ramp over a step
       or across an edge they have the same sign over whole regions. The weight w_ij falls
       linearly in the squared distance and is zero at the reach. The sum of w_ij r_i r_j over
       all pairs may be at most half of the root of the sum of (w_ij r_i r_j)^2, which would be
       its standard deviation if all signs were random.
    """
    valid = np.arange(local.shape[1]) < sizes[:, None]
    centers, _, axes = fit_planes(local, support)
    distances = np.abs(orthogonal_distances(local, centers, axes[..., 0]))
    variance = (np.square(distances) * support).sum(axis=1) / support.sum(axis=1)
    limit = np.maximum(INLIER_CUTOFF * scale_factor * np.sqrt(variance), PERFECT)
    inliers = valid & (distances <= limit[:, None])
    done = inliers.sum(axis=1) >= least_inliers
    rows = np.flatnonzero(done)

    centers, values, axes = fit_planes(local[rows], inliers[rows])
    normals, members = axes[..., 0], inliers[rows]
    residuals = orthogonal_distances(local[rows], centers, normals) * members
    variance = np.square(residuals).sum(axis=1) / members.sum(axis=1)
    perfect = variance <= PERFECT**2
    flat = variance <= FLATNESS**2 * values[:, 1]
    done[rows] = flat
    tested = flat & ~perfect
    rows = rows[tested]
    reach = REACH * values[tested, 1:].mean(axis=1)
    done[rows] = _incoherent(
        local[rows], centers[tested], normals[tested], residuals[tested], reach
    )
    return done


def _incoherent(local, centers, normals, residuals, reach):
    """The third test; `reach` is a squared distance, residuals of outliers are zero."""
    projected = local - centers[:, None] - residuals[..., None] * normals[:, None]
    projected[residuals == 0] = 0.0  # far outliers would make the others' distances less accurate
    squares = np.square(projected).sum(axis=-1)
    squared = squares[:, :, None] + squares[:, None] - 2 * projected @ projected.swapaxes(1, 2)
    products = np.maximum(1.0 - squared / reach[:, None, None], 0.0)
    products *= residuals[:, :, None] * residuals[:, None]
    diagonal = np.arange(local.shape[1])
    products[:, diagonal, diagonal] = 0.0
    together, spread = products.sum(axis=(1, 2)) / 2, np.square(products).sum(axis=(1, 2)) / 2
    return (spread > 0.0) & (together <= COHERENCE * np.sqrt(spread))
