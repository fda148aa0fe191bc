"""What the estimators share, and the one place that touches scikit-learn's private API.

``_fit_context`` and ``_param_validation`` are private though every mature satellite
package uses them; if they move, only this file changes.
"""

import warnings
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.base import _fit_context as fit_context
from sklearn.utils._param_validation import (
    Hidden,
    Interval,
    InvalidParameterError,
    Options,
    StrOptions,
    validate_params,
)
from sklearn.utils.validation import _check_feature_names_in as check_feature_names_in
from sklearn.utils.validation import validate_data

from sklearn_mcmd._consistent_set import draw_trials, n_support_points, n_trials_needed
from sklearn_mcmd._local_planes import LocalPlaneModel
from sklearn_mcmd._neighborhoods import NeighborIndex
from sklearn_mcmd._resolution import coordinate_step
from sklearn_mcmd._rules import METHODS

__all__ = [
    "BaseLocalPlanes",
    "Hidden",
    "Integral",
    "Interval",
    "InvalidParameterError",
    "Options",
    "Real",
    "StrOptions",
    "check_feature_names_in",
    "fit_context",
    "validate_params",
]

# float32 coordinates are too coarse once their rounding exceeds this share of the radius of a
# typical neighborhood.
COARSE_ROUNDING = 0.01
# Eq. 13 doubles with every dimension: 69 trials in 3D are 10 million in 20D.
MAX_TRIALS = 10_000
MAX_TRIALS_BEYOND_SPACE = 300


class BaseLocalPlanes(BaseEstimator):
    """Parameters and fitting of everything that fits a plane to each neighborhood.

    Subclasses store the parameters named in `_parameter_constraints` and call `_fit_planes`.
    """

    _parameter_constraints: ClassVar[dict] = {
        "n_neighbors": [Interval(Integral, 2, None, closed="left"), None],
        "method": [StrOptions(set(METHODS))],
        "support_fraction": [Interval(Real, 0, 1, closed="right"), StrOptions({"auto"})],
        "outlier_rate": [Interval(Real, 0, 1, closed="left")],
        "success_probability": [Interval(Real, 0, 1, closed="neither")],
        "cutoff": [Interval(Real, 0, None, closed="neither"), None],
        "refine": [StrOptions({"reweight"}), None],
        "random_state": ["random_state"],
        "n_jobs": [Integral, None],
    }

    def _fit_planes(self, X, radius=None):
        """Validate X, settle what depends on it and return the model of its local planes."""
        X = validate_data(self, X, dtype=[np.float64, np.float32], ensure_min_features=2)
        n, d = X.shape
        if n < d + 1:
            raise ValueError(
                f"n_samples={n} is too few for planes in {d}D: at least {d + 1} are needed."
            )
        self.n_neighbors_ = self._settle_n_neighbors(n, d)
        fraction = self.support_fraction
        fraction = 1.0 - self.outlier_rate if fraction == "auto" else fraction
        self.n_support_ = int(n_support_points(fraction, self.n_neighbors_, d))
        self.n_trials_ = self._settle_n_trials(d)
        rule = METHODS[self.method]
        self._cutoff = rule.default_cutoff(d) if self.cutoff is None else float(self.cutoff)

        k = None if self.n_neighbors is None else self.n_neighbors_
        index = NeighborIndex(X.astype(np.float64, copy=False), k, radius)
        if X.dtype == np.float32:
            _warn_if_coarse(X, index)
        n_trials = self.n_trials_ if rule.needs_consistent_set else 0
        self._model = LocalPlaneModel(
            index,
            draw_trials(n_trials, self.n_neighbors_, self.random_state),
            method=self.method,
            support_fraction=fraction,
            cutoff=self._cutoff,
            reweight=self.refine == "reweight",
            precision=np.finfo(X.dtype).eps,
            step=coordinate_step(X),
        )
        return X

    def _settle_n_trials(self, d):
        needed = n_trials_needed(self.outlier_rate, self.success_probability, d)
        most = MAX_TRIALS if d <= 3 else MAX_TRIALS_BEYOND_SPACE
        if needed > most and METHODS[self.method].needs_consistent_set:
            warnings.warn(
                f"outlier_rate={self.outlier_rate} in {d}D asks for {needed} trials; {most} are "
                "made. Lower outlier_rate, or reduce the dimension first.",
                stacklevel=4,
            )
        return min(needed, most)

    def _settle_n_neighbors(self, n, d):
        k = self.n_neighbors
        if k is None:
            return n
        if k < d + 1:
            raise ValueError(
                f"n_neighbors={k} is too few for planes in {d}D: at least {d + 1} are needed."
            )
        if k > n:
            warnings.warn(
                f"n_neighbors={k} is more than n_samples={n}: neighborhoods of all {n} points "
                "are used.",
                stacklevel=4,
            )
            return n
        return k


def _warn_if_coarse(X, index):
    """Warn where float32 rounds coordinates to a visible share of a neighborhood."""
    rounding = float(np.spacing(np.abs(X).max()))
    if index.n_neighbors is None:
        radius = float(np.linalg.norm(np.ptp(index.points, axis=0))) / 2
    else:
        sample = index.points[:: max(1, len(index.points) // 1000)]
        indices, sizes = index.query(sample)
        last = index.points[indices[np.arange(len(sample)), sizes - 1]]
        radius = float(np.median(np.linalg.norm(last - sample, axis=1)))
    if rounding > COARSE_ROUNDING * radius:
        warnings.warn(
            f"float32 rounds coordinates as large as {np.abs(X).max():.6g} to steps of "
            f"{rounding:.2g}, too coarse for neighborhoods of radius {radius:.2g}. Pass X as "
            "float64, or subtract an offset before converting it to float32.",
            stacklevel=4,
        )
