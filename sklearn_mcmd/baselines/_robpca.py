"""ROBPCA: robust principal components by projection pursuit and the MCD."""

from dataclasses import dataclass
from numbers import Integral, Real
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.special import chdtri, ndtri

from sklearn_mcmd._sklearn import Interval, StrOptions
from sklearn_mcmd.baselines._fits import CHUNK_ENTRIES, Method, Verdict
from sklearn_mcmd.baselines._mcd import fit_mcd, mcd_support_size, moments, univariate_mcd
from sklearn_mcmd.planes._rules import MAD_TO_SD


class PursuitLimits(NamedTuple):
    """When there is projection pursuit, and along which directions."""

    members_a_dimension: int = 5  # from so many on there is none, as in rrcov and LIBRA
    directions: int = 250  # each through a pair of members
    all_pairs: int = 20  # up to this number of members all pairs are directions


@dataclass(frozen=True)
class Robpca(Method):
    """Robust principal components of Hubert, Rousseeuw and Vanden Branden.

    With projection pursuit it has three parts. First, the members of least Stahel-Donoho
    outlyingness (over directions through pairs of members) span a subspace of `n_components`.
    Second, the members near this subspace give a better one. Third, the reweighted MCD of the
    scores in that subspace gives center and axes.

    In few dimensions, as for points in space, rrcov's PcaHubert and LIBRA's robpca skip the first
    two parts: the components are those of FAST-MCD of the points. `projection` chooses. With all
    components (``n_components`` = d) the scores are robust Mahalanobis distances.

    A member has a score distance and an orthogonal distance. Its score is the larger of the two,
    each divided by its cut-off, times the cut-off of the score distance.

    Parameters
    ----------
    n_components : int, default=None
        Dimensions of the subspace, 1 to d. None means d - 1, a plane with orthogonal
        distances, if `projection` is on, and d if it is off.
    support_fraction : float in [0.5, 1], default=0.5
        Share of the members that is certainly regular. The MCD takes ``h = (n + d + 1) // 2``
        members at 0.5, projection pursuit ``max(fraction * n, (n + n_components + 1) // 2)``.
    projection : bool, default=None
        Whether to begin with projection pursuit. None means only with fewer than five members
        for each dimension.
    quantile : float in (0, 1), default=0.975
        Quantile of chi-squared for score distances, and of the normal distribution for
        orthogonal distances to the power 2/3 (Wilson and Hilferty).
    orthogonal_scale : {"mcd", "mad"}, default="mcd"
        Estimate of mean and deviation of those powers: the univariate MCD, as the authors take,
        or median and MAD, as rrcov takes.
    small_sample : bool, default=True
        Whether the MCD's small-sample factors are applied.
    consistency : {"kept", "quantile"}, default="kept"
        The covariance of the members that the MCD's reweighting keeps is corrected for their
        share. "kept" takes the share kept, as robustbase and LIBRA do; with outliers it makes
        covariances too large. "quantile" takes 0.975, the expected share of regular members,
        and reproduces the first paper.
    n_trials : int, default=500
        Number of initial subsets of the MCD.

    References
    ----------
    .. [1] M. Hubert, P. Rousseeuw, K. Vanden Branden, "ROBPCA: a new approach to robust
       principal component analysis", Technometrics 47 (2005) 64-79.
    .. [2] P. Rousseeuw, K. Van Driessen, "A fast algorithm for the minimum covariance
       determinant estimator", Technometrics 41 (1999) 212-223.
    .. [3] G. Pison, S. Van Aelst, G. Willems, "Small sample corrections for LTS and MCD",
       Metrika 55 (2002) 111-123.
    """

    _parameter_constraints: ClassVar[dict] = {
        "n_components": [Interval(Integral, 1, None, closed="left"), None],
        "support_fraction": [Interval(Real, 0.5, 1, closed="both")],
        "projection": ["boolean", None],
        "quantile": [Interval(Real, 0, 1, closed="neither")],
        "orthogonal_scale": [StrOptions({"mcd", "mad"})],
        "small_sample": ["boolean"],
        "consistency": [StrOptions({"kept", "quantile"})],
        "n_trials": [Interval(Integral, 1, None, closed="left")],
    }
    n_components: int | None = None
    support_fraction: float = 0.5
    projection: bool | None = None
    quantile: float = 0.975
    orthogonal_scale: str = "mcd"
    small_sample: bool = True
    consistency: str = "kept"
    n_trials: int = 500

    def usual_cutoff(self, n: int, d: int) -> float:
        return float(np.sqrt(chdtri(self._components(n, d)[1], 1.0 - self.quantile)))

    def table_shape(self, size: int, d: int) -> tuple[int, int]:
        return self.n_trials + PursuitLimits().directions, d + 1

    def _fit(self, points, table, floor):
        n_sets, n, d = points.shape
        # Step 1: projection pursuit leaves k dimensions, if it is asked for.
        projection, k = self._components(n, d)
        starts, pairs = table[: self.n_trials], table[self.n_trials :, :2]
        if projection and k < d:
            location, subspace, support = self._project(points, pairs, k, floor)
        else:
            location, support = np.zeros((n_sets, d)), None
            subspace = np.broadcast_to(np.eye(d), (n_sets, d, d))
        # Step 2: the MCD in these.
        k_scores = subspace.shape[2]
        scores = (points - location[:, None]) @ subspace
        mcd = fit_mcd(
            scores,
            starts[:, : k_scores + 1],
            self.support_fraction,
            floor,
            small_sample=self.small_sample,
            consistency=self.consistency,
        )
        support = mcd.kept if support is None else support
        # Step 3: its principal axes, back in the coordinates of the points.
        values, axes = np.linalg.eigh(mcd.covariances)
        values, axes = values[:, ::-1], axes[:, :, ::-1]
        deviations = np.sqrt(np.maximum(values, floor[:, None] ** 2))[:, :k]
        centers = location + np.matmul(subspace, mcd.locations[..., None])[..., 0]
        loadings = subspace @ axes[:, :, :k]
        cutoff = np.full(n_sets, self.usual_cutoff(n, d))
        limit = np.zeros(n_sets)
        if k < d:
            limit = self._orthogonal_cutoff(_orthogonal_distances(points, centers, loadings), floor)
        model = ComponentModel(
            centers=centers,
            loadings=loadings,
            precisions=1.0 / deviations,
            score_cutoff=cutoff,
            orthogonal_cutoff=limit,
        )
        # With all components the least deviation is the consistent one along the normal.
        scale = deviations[:, -1] if k == d else 0.0
        scores = model.score(points)
        return Verdict(
            model=model,
            scores=scores,
            inliers=scores <= cutoff[:, None],
            cutoff=cutoff,
            scale=scale,
            support=support,
        )

    def _components(self, n, d):
        """Whether there is projection pursuit, and the number of components."""
        projection = self.projection
        if projection is None:
            projection = n < PursuitLimits().members_a_dimension * d
        k = self.n_components
        if k is None:
            k = d - 1 if projection else d
        elif k > d:
            raise ValueError(f"n_components={k} of method 'robpca' is more than {d} features.")
        return projection, k

    def _project(self, points, pairs, k, floor):
        """Subspace of projection pursuit: center (B, d), basis (B, d, k), whom it is fitted to."""
        n_sets, n, _ = points.shape
        # At least so many that the breakdown point is the largest possible in k dimensions.
        h = min(n, max(int(self.support_fraction * n), (n + k + 1) // 2))
        if n <= PursuitLimits().all_pairs:
            pairs = np.column_stack(np.triu_indices(n, 1))
        outlyingness = stahel_donoho(points, pairs, h, floor)
        # The subspace of the h least outlying, then of all that are near it.
        order = np.argsort(outlyingness, axis=1, kind="stable")[:, :h]
        members = np.zeros((n_sets, n), dtype=bool)
        np.put_along_axis(members, order, True, axis=1)
        location, basis = _leading(points, members, k)
        distances = _orthogonal_distances(points, location, basis)
        members |= distances <= self._orthogonal_cutoff(distances, floor, h)[:, None]
        return *_leading(points, members, k), members

    def _orthogonal_cutoff(self, distances, floor, h=None):
        """Cut-off (B,) of orthogonal distances: powers 2/3 are nearly normal (Wilson, Hilferty)."""
        n = distances.shape[1]
        powers = distances ** (2 / 3)
        if self.orthogonal_scale == "mcd":
            h = mcd_support_size(self.support_fraction, n, 1) if h is None else h
            mean, deviation = univariate_mcd(powers, h)
        else:
            mean = np.median(powers, axis=1)
            deviation = MAD_TO_SD * np.median(np.abs(powers - mean[:, None]), axis=1)
        limit = np.maximum(mean + deviation * ndtri(self.quantile), 0.0) ** 1.5
        return np.maximum(limit, floor)


@dataclass(frozen=True)
class ComponentModel:
    """Score and orthogonal distances to principal components.

    centers (B, d), loadings (B, d, k), precisions (B, k), which are one over the deviations, and
    cut-offs of both distances (B,). Where its cut-off is zero, the orthogonal distance is ignored.
    """

    centers: np.ndarray
    loadings: np.ndarray
    precisions: np.ndarray
    score_cutoff: np.ndarray
    orthogonal_cutoff: np.ndarray

    def score(self, points):
        scores = (points - self.centers[:, None]) @ self.loadings
        distances = np.sqrt(np.square(scores * self.precisions[:, None]).sum(axis=-1))
        limit = self.orthogonal_cutoff
        if not limit.any():
            return distances
        # Orthogonal distances in units of the other cut-off, so that one cut-off holds for both.
        counts = limit > 0
        factor = np.where(counts, self.score_cutoff / np.where(counts, limit, 1.0), 0.0)
        across = _orthogonal_distances(points, self.centers, self.loadings)
        return np.maximum(distances, factor[:, None] * across)


def _orthogonal_distances(points, centers, loadings):
    deviations = points - centers[:, None]
    scores = deviations @ loadings
    deviations = deviations - scores @ np.swapaxes(loadings, 1, 2)
    return np.sqrt(np.square(deviations).sum(axis=-1))


def stahel_donoho(points, pairs, h, floor):
    """Outlyingness (B, n): the largest distance from the univariate MCD over directions (Eq. 4).

    The directions go through the pairs (T, 2) of members. If h members coincide on a direction, it
    has no scale, and all other members are infinitely outlying. This finds exact planes.
    """
    n_sets, n, _ = points.shape
    worst = np.zeros((n_sets, n))
    at_once = max(1, CHUNK_ENTRIES // max(n_sets * n, 1))
    for start in range(0, len(pairs), at_once):
        ends = points[:, pairs[start : start + at_once]]
        directions = ends[:, :, 1] - ends[:, :, 0]
        length = np.sqrt(np.square(directions).sum(axis=-1, keepdims=True))
        directions = np.divide(directions, length, out=np.zeros_like(directions), where=length > 0)
        projections = directions @ np.swapaxes(points, 1, 2)
        middle, deviation = univariate_mcd(projections, h)
        gaps = np.abs(projections - middle[..., None])
        gaps /= np.maximum(deviation, floor[:, None])[..., None]
        worst = np.maximum(worst, gaps.max(axis=1))
    return worst


def _leading(points, members, k):
    """Mean (B, d) of members and the k axes (B, d, k) of their largest variances."""
    mean, scatter, _ = moments(points, members)
    return mean, np.linalg.eigh(scatter)[1][:, :, ::-1][:, :, :k]
