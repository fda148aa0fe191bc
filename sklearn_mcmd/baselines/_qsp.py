"""qSp: the distance to the nearest point of one small random sample."""

from dataclasses import dataclass
from numbers import Integral
from typing import ClassVar

import numpy as np

from sklearn_mcmd._sklearn import Interval
from sklearn_mcmd.baselines._fits import SHARE, Method, Verdict, flag_share


@dataclass(frozen=True)
class Qsp(Method):
    """Distance to the nearest point of one random sample (Eq. 12; Sugiyama and Borgwardt).

    The score of a member of the sample is its distance to the others.

    Parameters
    ----------
    contamination : float in [0, 0.5], default=None
        Share of each neighborhood that is removed: the members with the highest scores. The
        method has no cut-off of its own. None removes nothing.
    sample_size : int, default=20
        Members of the sample. 20 is the authors' default. A smaller neighborhood takes all but one.

    References
    ----------
    .. [1] M. Sugiyama, K. Borgwardt, "Rapid distance-based outlier detection via sampling",
       NIPS 26 (2013) 467-475.
    """

    has_cutoff: ClassVar[bool] = False
    _parameter_constraints: ClassVar[dict] = SHARE | {
        "sample_size": [Interval(Integral, 2, None, closed="left")]
    }
    contamination: float | None = None
    sample_size: int = 20

    def table_shape(self, size: int, d: int) -> tuple[int, int]:
        return 1, min(self.sample_size, size - 1)

    def _fit(self, points, table, floor):
        # In smaller neighborhoods the sample repeats members.
        chosen = np.resize(table[0], self.sample_size)
        model = SampleModel(points[:, chosen])
        scores = model.score(points)
        inliers, cutoff = flag_share(scores, self.contamination)
        return Verdict(model, scores, inliers, cutoff)


@dataclass(frozen=True)
class SampleModel:
    """Distance to the nearest of a sample (B, s, d) at another place."""

    sample: np.ndarray

    def score(self, points):
        n_sets, m, _ = points.shape
        nearest = np.full((n_sets, m), np.inf)
        for position in range(self.sample.shape[1]):
            gaps = points - self.sample[:, None, position]
            distances = np.sqrt(np.einsum("bmd,bmd->bm", gaps, gaps))
            distances[distances == 0] = np.inf
            nearest = np.minimum(nearest, distances)
        # If all the sample is at the place of the query, the distance is zero.
        return np.where(np.isfinite(nearest), nearest, 0.0)
