"""qSp: the distance to the nearest point of one small random sample."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sklearn_mcmd.baselines._fits import Found, Method, check, flag_share

__all__ = ["Qsp"]


@dataclass(frozen=True)
class Qsp(Method):
    """Distance to the nearest point of one random sample (Eq. 12; Sugiyama and Borgwardt).

    Parameters
    ----------
    contamination : float in [0, 0.5], default=None
        Share of each neighborhood that is removed: the members with the highest scores. The
        method has no cut-off of its own. None removes nothing.
    sample_size : int, default=20
        Members of the sample. 20 is the authors' default. A smaller neighborhood takes all but one.
    exclude_self : bool, default=True
        Whether the score of a member of the sample is its distance to the others. If not, the
        score is zero, and the member is never an outlier.

    References
    ----------
    .. [1] M. Sugiyama, K. Borgwardt, "Rapid distance-based outlier detection via sampling",
       NIPS 26 (2013) 467-475.
    """

    has_cutoff: ClassVar[bool] = False
    contamination: float | None = None
    sample_size: int = 20
    exclude_self: bool = True

    def __post_init__(self):
        check(self, "contamination", 0, 0.5, closed="both", none=True)
        check(self, "sample_size", 2, np.inf, closed="left", integer=True)

    def table_shape(self, size: int, d: int) -> tuple[int, int]:
        return 1, min(self.sample_size, size - 1)

    def _fit(self, group):
        points = group.points
        # In smaller neighborhoods the sample repeats members.
        chosen = np.resize(group.table[0], self.sample_size)
        n_sets = len(points)
        model = SampleModel(points[:, chosen], np.full(n_sets, float(self.exclude_self)))
        scores = model.score(points)
        inliers, cutoff = flag_share(scores, self.contamination)
        return Found(model, scores, inliers, cutoff)


@dataclass(frozen=True)
class SampleModel:
    """Distance to the nearest of a sample (B, s, d), or to the nearest one at another place."""

    sample: np.ndarray
    exclude_self: np.ndarray

    def score(self, points):
        n_sets, m, _ = points.shape
        nearest = np.full((n_sets, m), np.inf)
        for position in range(self.sample.shape[1]):
            gaps = points - self.sample[:, None, position]
            distances = np.sqrt(np.einsum("bmd,bmd->bm", gaps, gaps))
            distances[(distances == 0) & (self.exclude_self[:, None] > 0)] = np.inf
            nearest = np.minimum(nearest, distances)
        # If all the sample is at the place of the query, the distance is zero.
        return np.where(np.isfinite(nearest), nearest, 0.0)
