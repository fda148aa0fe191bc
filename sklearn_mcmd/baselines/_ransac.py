"""RANSAC and MSAC: the plane of the minimal subset that most members agree with."""

from dataclasses import dataclass
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from scipy.special import chdtri

from sklearn_mcmd._sklearn import Interval
from sklearn_mcmd.baselines._fits import CHUNK_ENTRIES, Method, Verdict, WhitenedModel
from sklearn_mcmd.planes._consistent_set import n_trials_needed, planes_through
from sklearn_mcmd.planes._principal_planes import fit_planes, orthogonal_distances
from sklearn_mcmd.planes._rules import MAD_TO_SD

TRIALS_AT_ONCE = 16  # at first; more where few neighborhoods still seek


@dataclass(frozen=True)
class Ransac(Method):
    """Random sample consensus: the trial plane with the most members within a threshold.

    Parameters
    ----------
    noise_scale : float, default=None
        Standard deviation of the noise along the normal, in units of the points. None
        estimates it in each neighborhood by least median of squares, which needs a majority
        of regular members.
    quantile : float in (0, 1), default=0.99
        Share of the regular members that should lie within the threshold. The threshold is
        ``noise_scale * sqrt(q)``, where q is this quantile of chi-squared.
    degrees_of_freedom : int, default=1
        Degrees of freedom of chi-squared. Distances to a plane have one; the first paper used
        three.
    max_trials : int, default=1000
        Largest number of minimal subsets tried in a neighborhood.
    stop_probability : float in (0, 1), default=0.9999
        Trials end when one of them was free of outliers with this probability. The share of
        outliers is taken from the largest consensus so far.
    n_refits : int, default=1
        Number of times that the plane is fitted again to its consensus before it judges the
        members. With 0 the plane of the best minimal subset judges them. The final plane is
        always that of the inliers.

    References
    ----------
    .. [1] M. Fischler, R. Bolles, "Random sample consensus", Communications of the ACM 24
       (1981) 381-395.
    .. [2] P. Torr, A. Zisserman, "MLESAC: a new robust estimator with application to
       estimating image geometry", Computer Vision and Image Understanding 78 (2000) 138-156.
    .. [3] P. Rousseeuw, A. Leroy, "Robust Regression and Outlier Detection" (1987), chapter
       5, for the estimated scale.
    """

    _parameter_constraints: ClassVar[dict] = {
        "noise_scale": [Interval(Real, 0, None, closed="neither"), None],
        "quantile": [Interval(Real, 0, 1, closed="neither")],
        "degrees_of_freedom": [Interval(Integral, 1, None, closed="left")],
        "max_trials": [Interval(Integral, 1, None, closed="left")],
        "stop_probability": [Interval(Real, 0, 1, closed="neither")],
        "n_refits": [Interval(Integral, 0, None, closed="left")],
    }
    noise_scale: float | None = None
    quantile: float = 0.99
    degrees_of_freedom: int = 1
    max_trials: int = 1000
    stop_probability: float = 0.9999
    n_refits: int = 1

    truncated_loss = False  # whether the loss is a sum of truncated squares, not a count

    @property
    def cutoff(self):
        """Threshold in standard deviations."""
        return float(np.sqrt(chdtri(self.degrees_of_freedom, 1.0 - self.quantile)))

    def usual_cutoff(self, n: int, d: int) -> float:
        return self.cutoff

    def table_shape(self, size: int, d: int) -> tuple[int, int]:
        return self.max_trials, d

    def _fit(self, points, table, floor):
        n_sets, n, d = points.shape
        # Step 1: the noise, if it is not stated, by the least median of distances.
        if self.noise_scale is None:
            enough = min(len(table), n_trials_needed(0.5, self.stop_probability, d))
            # With the small-sample factor of Rousseeuw and Leroy.
            scale = MAD_TO_SD * (1.0 + 5.0 / max(n - d, 1)) * least_medians(points, table[:enough])
        else:
            scale = np.full(n_sets, float(self.noise_scale))
        has_plane = np.isfinite(scale)
        scale = np.maximum(np.where(has_plane, scale, 0.0), floor)
        # Step 2: the plane with the largest consensus, or the least loss.
        stops = trials_to_stop(n, d, self.stop_probability)
        limit = self.cutoff * scale
        centers, normals = best_planes(points, table, limit, stops, self.truncated_loss)
        has_plane &= np.isfinite(normals[:, 0])
        # Step 3: refits to its members.
        for _ in range(self.n_refits):
            distances = np.abs(orthogonal_distances(points, centers, normals))
            members = distances < limit[:, None]
            centers, _, axes = fit_planes(points, members)
            normals = axes[..., 0]
        # Without a plane all distances are zero, so that no member is judged.
        whitening = np.where(has_plane[:, None], normals / scale[:, None], 0.0)[..., None]
        model = WhitenedModel(np.where(has_plane[:, None], centers, 0.0), whitening)
        scores = model.score(points)
        scale = np.where(has_plane, scale, -1.0)
        return Verdict(
            model=model,
            scores=scores,
            inliers=scores < self.cutoff,
            cutoff=self.cutoff,
            scale=scale,
        )


@dataclass(frozen=True)
class Msac(Ransac):
    """M-estimator sample consensus: RANSAC by squared distances, cut at the threshold (Eq. 5).

    Of two planes with equally many members, the one nearer to its members wins. Parameters and
    references are those of `Ransac`.
    """

    truncated_loss = True


def trials_to_stop(n, d, probability):
    """Trials after which one subset is probably free of outliers, by consensus size 0..n.

    Subsets are drawn without replacement, so their probability is a ratio of binomials.
    """
    # (c choose d) / (n choose d) as a product of d quotients.
    sizes = np.arange(n + 1.0)[:, None] - np.arange(d)
    clean = np.prod(np.maximum(sizes, 0.0) / (n - np.arange(d)), axis=1)
    with np.errstate(divide="ignore"):
        needed = np.log1p(-probability) / np.log1p(-clean)
    return np.maximum(np.ceil(needed), 1.0)


def best_planes(points, table, threshold, stops, truncated_loss):
    """Centers and normals (B, d) of the best trial of each neighborhood; NaN without a plane.

    `stops` is from `trials_to_stop`. With a truncated loss, that of a plane is the sum of
    min(e^2, t^2) over t^2 (Torr and Zisserman's cost), else the number of members beyond t.
    """
    n_sets, n, d = points.shape
    best, consensus = np.full(n_sets, np.inf), np.zeros(n_sets, dtype=int)
    centers, normals = np.full((2, n_sets, d), np.nan)
    rows, start = np.arange(n_sets), 0
    while rows.size and start < len(table):
        # More trials at once later on: most neighborhoods stop early, the others need many.
        at_once = max(1, min(TRIALS_AT_ONCE * (1 + start // 64), CHUNK_ENTRIES // (len(rows) * n)))
        part = table[start : start + at_once]
        anchors, axes, spans, distances = _trial_planes(points[rows], part)
        ratio = distances / threshold[rows, None, None]
        inside = ratio < 1.0
        counts = inside.sum(axis=-1)
        loss = n - counts
        if truncated_loss:
            loss = np.where(inside, ratio**2, 1.0).sum(axis=-1)
        loss = np.where(spans, loss, np.inf)
        # As with one trial after another: a neighborhood that has stopped sees no more trials.
        for t in range(len(part)):
            better = loss[:, t] < best[rows]
            better &= start + t < stops[consensus[rows]]
            won = rows[better]
            best[won], consensus[won] = loss[better, t], counts[better, t]
            centers[won], normals[won] = anchors[better, t], axes[better, t]
        start += len(part)
        rows = rows[start < stops[consensus[rows]]]
    return centers, normals


def least_medians(points, table):
    """Least median of distances to trial planes (B,); infinite where no trial spans a plane."""
    n_sets, n, _ = points.shape
    least = np.full(n_sets, np.inf)
    at_once = max(1, CHUNK_ENTRIES // max(n_sets * n, 1))
    for start in range(0, len(table), at_once):
        _, _, spans, distances = _trial_planes(points, table[start : start + at_once])
        medians = np.median(distances, axis=-1)
        least = np.minimum(least, np.where(spans, medians, np.inf).min(axis=1))
    return least


def _trial_planes(points, table):
    """Anchors and unit normals (B, T, d) of minimal subsets, whether they span a plane, and
    distances (B, T, n) of all members."""
    normals, offsets, degenerate = planes_through(points[:, table])
    distances = np.abs(normals @ np.swapaxes(points, 1, 2) + offsets[..., None])
    return points[:, table[:, 0]], normals, ~degenerate, distances
