"""PCA: the plane of least squares. Every outlier pulls it."""

from dataclasses import dataclass
from numbers import Real
from typing import ClassVar

import numpy as np

from sklearn_mcmd._sklearn import Interval
from sklearn_mcmd.baselines._fits import Method, Verdict, WhitenedModel, plane_scale
from sklearn_mcmd.planes._principal_planes import fit_planes


@dataclass(frozen=True)
class Pca(Method):
    """Distances to the plane of all members over their standard deviation (Eq. 1).

    Parameters
    ----------
    cutoff : float, default=2.5
        Score from which on a member counts as an outlier. The plane is fitted to all members,
        whatever their scores are.
    """

    _parameter_constraints: ClassVar[dict] = {"cutoff": [Interval(Real, 0, None, closed="neither")]}
    cutoff: float = 2.5

    def usual_cutoff(self, n: int, d: int) -> float:
        return self.cutoff

    def table_shape(self, size: int, d: int) -> tuple[int, int]:
        return 0, 0

    def _fit(self, points, table, floor):
        centers, _, axes = fit_planes(points)
        members = np.ones(points.shape[:2], dtype=bool)
        scale = np.maximum(plane_scale(points, members, centers, axes[..., 0]), floor)
        model = WhitenedModel(centers, axes[..., :1] / scale[:, None, None])
        scores = model.score(points)
        return Verdict(
            model=model,
            scores=scores,
            inliers=scores < self.cutoff,
            cutoff=self.cutoff,
            scale=scale,
            support=members,
        )
