"""ROBPCA: robust principal components by the MCD."""

from dataclasses import dataclass
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from scipy.special import chdtri, ndtri

from sklearn_mcmd._sklearn import Interval, StrOptions
from sklearn_mcmd.baselines._fits import Found, Method
from sklearn_mcmd.baselines._mcd import fit_mcd
from sklearn_mcmd.planes._rules import MAD_TO_SD


@dataclass(frozen=True)
class Robpca(Method):
    """Robust principal components of Hubert, Rousseeuw and Vanden Branden.

    In few dimensions, as for points in space, rrcov's PcaHubert and LIBRA's robpca skip projection
    pursuit (Eq. 4), and so does this: the components are those of FAST-MCD of the points. With all
    of them (``n_components`` = d) the scores are robust Mahalanobis distances.

    A member has a score distance and an orthogonal distance. Its score is the larger of the two,
    each divided by its cut-off, times the cut-off of the score distance.

    Parameters
    ----------
    n_components : int, default=None
        Dimensions of the subspace, 1 to d. None means d. A plane, d - 1, has orthogonal distances.
    support_fraction : float in [0.5, 1], default=0.5
        Share of the members that is certainly regular. The MCD takes ``h = (n + d + 1) // 2``
        members at 0.5.
    quantile : float in (0, 1), default=0.975
        Quantile of chi-squared for score distances, and of the normal distribution for
        orthogonal distances to the power 2/3 (Wilson and Hilferty), by their median and MAD.
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
        "quantile": [Interval(Real, 0, 1, closed="neither")],
        "small_sample": ["boolean"],
        "consistency": [StrOptions({"kept", "quantile"})],
        "n_trials": [Interval(Integral, 1, None, closed="left")],
    }
    n_components: int | None = None
    support_fraction: float = 0.5
    quantile: float = 0.975
    small_sample: bool = True
    consistency: str = "kept"
    n_trials: int = 500

    def usual_cutoff(self, n: int, d: int) -> float:
        return float(np.sqrt(chdtri(self._components(d), 1.0 - self.quantile)))

    def table_shape(self, size: int, d: int) -> tuple[int, int]:
        return self.n_trials, d + 1

    def _fit(self, points, table, floor):
        (n_sets, n, d), k = points.shape, self._components(points.shape[-1])
        found = fit_mcd(
            points,
            table,
            self.support_fraction,
            floor,
            small_sample=self.small_sample,
            consistency=self.consistency,
        )
        values, axes = np.linalg.eigh(found.covariances)
        values, axes = values[:, ::-1], axes[:, :, ::-1]
        deviations = np.sqrt(np.maximum(values, floor[:, None] ** 2))[:, :k]
        centers, loadings = found.locations, axes[:, :, :k]
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
        return Found(
            model=model,
            scores=scores,
            inliers=scores <= cutoff[:, None],
            cutoff=cutoff,
            scale=scale,
            support=found.kept,
        )

    def _components(self, d):
        """Their number."""
        k = d if self.n_components is None else self.n_components
        if k > d:
            raise ValueError(f"n_components={k} of method 'robpca' is more than {d} features.")
        return k

    def _orthogonal_cutoff(self, distances, floor):
        """Cut-off (B,) of orthogonal distances: powers 2/3 are nearly normal (Wilson, Hilferty)."""
        powers = distances ** (2 / 3)
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
        counts = limit > 0
        factor = np.where(counts, self.score_cutoff / np.where(counts, limit, 1.0), 0.0)
        across = _orthogonal_distances(points, self.centers, self.loadings)
        return np.maximum(distances, factor[:, None] * across)


def _orthogonal_distances(points, centers, loadings):
    deviations = points - centers[:, None]
    scores = deviations @ loadings
    deviations = deviations - scores @ np.swapaxes(loadings, 1, 2)
    return np.sqrt(np.square(deviations).sum(axis=-1))
