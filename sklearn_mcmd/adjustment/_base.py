"""Base class of both plane tests: input, scale, predictions."""

from numbers import Integral, Real
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_array, check_is_fitted

from sklearn_mcmd._choices import Correction, Loss, Surface, Test, choices_of
from sklearn_mcmd._errors import ParameterError, warn, warn_caller
from sklearn_mcmd._sklearn import (
    CallbackSupportMixin,
    DocLinkMixin,
    Interval,
    StrOptions,
    validate_params,
)
from sklearn_mcmd._validation import OffsetOutlierMixin, validate_points
from sklearn_mcmd.adjustment._determinacy import (
    AS_THICK_AS_WIDE,
    check_distinct,
    check_rank,
    normal_pvalue,
)
from sklearn_mcmd.adjustment._least_squares import adjust_plane
from sklearn_mcmd.adjustment._power import POWER, coupled_level
from sklearn_mcmd.adjustment._precision import PlanePrecision, precision_of, quantile
from sklearn_mcmd.adjustment._reliability import PlaneReliability, reliability_of
from sklearn_mcmd.adjustment._robust import WEIGHT_FUNCTIONS, m_estimate
from sklearn_mcmd.adjustment._rounding import residual_rounding, rounding_errors
from sklearn_mcmd.adjustment._tests import global_test_pvalue, local_level

__all__ = ["N_WORST", "PlaneDetector", "check_points", "sigma0_is_rounding"]

N_WORST = {"n_worst": [Interval(Integral, 0, None, closed="left")]}  # what it may be
# From this tilt on vertical residuals are at least twice as long as sigma0, if the noise is equal
# in all directions. A test that rejects a larger share is then taken for such a mistake.
STEEP_TILT = 60.0
STEEP_SHARE = 0.05
# Largest thickness over width of a sheet of points.
FLATNESS = 0.1


class PlaneDetector(DocLinkMixin, OffsetOutlierMixin, CallbackSupportMixin, BaseEstimator):
    """Base class of plane tests; a subclass has `fit` and `score_samples`."""

    _parameter_constraints: ClassVar[dict] = {
        "alpha": [Interval(Real, 0, 1, closed="neither")],
        "test": [StrOptions(choices_of(Test))],
        "sigma0": [Interval(Real, 0, None, closed="neither"), StrOptions({"auto"})],
        "correction": [StrOptions(choices_of(Correction))],
        "loss": [StrOptions(choices_of(Loss))],
        "contamination": [StrOptions({"auto"}), Interval(Real, 0, 0.5, closed="right")],
        "surface": [StrOptions(choices_of(Surface))],
    }

    def fit_predict(
        self, X: ArrayLike, y: object = None, weights: ArrayLike | None = None
    ) -> NDArray[np.int_]:
        """Fit and return the labels of the training points.

        Parameters
        ----------
        X, y, weights
            As of `fit`. The labels depend on the weights too, and `predict` does not know them.

        Returns
        -------
        ndarray of int of shape (n_samples,)
            -1 for outliers, 1 for inliers.
        """
        return self.fit(X, weights=weights).labels_

    def _stages(self):
        return ()

    def residuals(self, X: ArrayLike) -> NDArray[np.float64]:
        """Observed minus adjusted, along the last axis or the normal.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)

        Returns
        -------
        ndarray of shape (n_samples,)
            In units of X. For an orthogonal surface they are positive on the side of `normal_`.
        """
        return self._plane.evaluate(self._check_query(X))[0]

    def precision(self, variance: Literal["posterior", "prior"] = "posterior") -> PlanePrecision:
        """Covariance and standard errors of normal, distance, slopes, tilt and its direction.

        Parameters
        ----------
        variance : {"posterior", "prior"}, default="posterior"
            The scale: that of the residuals of the plane, with `dof_` degrees of freedom, or the
            known `sigma0`. If `sigma0` was estimated, "prior" raises a ValueError.

        Returns
        -------
        PlanePrecision
        """
        check_is_fitted(self)
        return precision_of(self._plane, *self._scale_by(variance))

    def band(
        self,
        X: ArrayLike,
        level: float = 0.95,
        variance: Literal["posterior", "prior"] = "posterior",
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Half widths of the confidence band of the plane and the prediction band of a point.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Places. A coordinate along the residuals does not matter.
        level : float in (0, 1), default=0.95
            Probability that the plane, or a new point of weight 1, is inside at one place. If it is
            no probability, a ValueError is raised.
        variance : {"posterior", "prior"}, default="posterior"
            See `precision`.

        Returns
        -------
        of_plane, of_point : ndarray of shape (n_samples,)
            Around the adjusted plane, along the last axis or the normal, in units of X.
        """
        X = self._check_query(X)
        if not 0 < level < 1:
            raise ValueError(f"level={level!r} is no probability: take one such as 0.95.")
        scale, dof = self._scale_by(variance)
        spread, factor = self._plane.evaluate(X)[2], scale * quantile(level, dof)
        return factor * np.sqrt(spread), factor * np.sqrt(1 + spread)

    @validate_params(N_WORST, prefer_skip_nested_validation=True)
    def reliability(
        self, X: ArrayLike, power: float = POWER, *, n_worst: int = 10
    ) -> PlaneReliability:
        """Errors that the tests can find, errors that they found, and what the others do.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            The training points.
        power : float in (0, 1), default=0.8
            Probability of detection, above the level of one point.
        n_worst : int, default=10
            Number of points of the largest statistics whose tests are compared with others.

        Returns
        -------
        PlaneReliability

        Raises
        ------
        ValueError
            If X are others, the power is below the level, or `loss` is not "squared_error".
        """
        X = check_points(self, X)
        if self.loss != "squared_error":
            raise ValueError(
                f"loss={self.loss!r} has no minimal detectable biases, which are those of least "
                "squares: take loss='squared_error'."
            )
        scale = self.sigma0_ if self.test_ == "w" else self._scale
        return reliability_of(
            self._plane, X, self._weights, self.support_, self.redundancy_, self.test_statistic_,
            (self.test_, scale), self._level_of_one(), power, n_worst,
        )  # fmt: skip

    def _level_of_one(self):
        """Level of the last tests of single points."""
        return local_level(self.alpha, self._plane.n_observations, self.correction)

    def _scale_by(self, variance):
        """Standard deviation of unit weight and its degrees of freedom."""
        if variance == "posterior":
            return self._scale, self.dof_
        if variance != "prior":
            raise ValueError(f"variance={variance!r} is unknown: take 'posterior' or 'prior'.")
        if self.sigma0 == "auto" and self.test_ != "w":
            raise ParameterError(
                "variance='prior' needs a known $sigma0, but it was estimated: take 'posterior'."
            )
        return self.sigma0_, np.inf

    def _check_training(
        self, X: ArrayLike, weights: ArrayLike | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, NDArray[np.bool_]]:
        """Validated points, weights (None where all are 1) and which of them count."""
        points = validate_points(self, X, dtype=np.float64, order="C", ensure_min_features=2)
        p = self._check_weights(points, weights)
        used = np.ones(len(points), dtype=np.bool_) if p is None else p > 0
        counted = points if used.all() else points[used]
        check_distinct(counted, len(points))
        self._rounding_errors = rounding_errors(counted)
        self._weights = p
        return points, p, used

    def _check_weights(self, X, weights):
        if weights is None:
            return None
        shape = np.asarray(weights).shape
        if shape != (len(X),):
            raise ValueError(
                f"weights has shape {shape}; it needs one precision "
                f"sigma0^2 / sigma_i^2 for each of the {len(X)} points of X."
            )
        weights = check_array(weights, ensure_2d=False, dtype=np.float64, input_name="weights")
        if weights.min() < 0:
            raise ValueError(
                f"weights has negative values (least: {weights.min()}); precisions are positive, "
                "or 0 for a point that takes no part."
            )
        if not weights.any():
            raise ValueError("weights is zero for all points; leave some weight.")
        return None if np.all(weights == 1) else weights

    def _check_query(self, X: ArrayLike) -> NDArray[np.float64]:
        check_is_fitted(self)
        return validate_points(self, X, dtype=np.float64, order="C", reset=False)

    def _known_sigma(self):
        """sigma0 if the user knows it and the test uses it, else None."""
        known = self.test == "w" and self.sigma0 != "auto"
        return float(self.sigma0) if known else None

    def _first_plane(self, X, weights, initial):
        """The plane of least squares and the given sigma0, or a robust plane and its scale."""
        if self.sigma0 != "auto":
            return initial, float(self.sigma0)
        plane, _, sigma = m_estimate(X, weights, loss="huber", surface=self.surface)
        return plane, sigma

    def _set_sigma0(self, sigma, plane):
        """Set `sigma0_` to sigma, or to the rounding of a residual from this plane if larger."""
        rounding = self._rounding_of(plane.direction)
        self.sigma0_ = max(sigma, rounding)
        self._sigma0_is_rounding = sigma <= rounding
        if self._sigma0_is_rounding and self.test == "w" and self.sigma0 != "auto":
            warn(
                f"$sigma0={self.sigma0!r} is less than what float64 may add to a residual at these "
                f"coordinates, {rounding:.2g}, which is taken in its place. Subtract an offset "
                "from $X before its digits are lost, or give the noise of the points as $sigma0.",
            )

    def _rounding_of(self, direction):
        """Largest rounding error of float64 in a residual of this direction."""
        return residual_rounding(self._rounding_errors, direction)

    def _deviation_of(self, plane):
        """Estimated standard deviation of unit weight, no less than rounding."""
        return max(np.sqrt(plane.variance_factor), self._rounding_of(plane.direction))

    def _global_test(self, plane):
        """p of the global test; nan where sigma0 comes from the same points, and fits them."""
        if self.sigma0 == "auto":
            return np.nan
        return global_test_pvalue(plane.sum_of_squares, self.sigma0_, plane.dof)

    def _adjust(self, X, weights):
        """Plane by the chosen loss, and the weights W of a robust one."""
        if self.loss == "squared_error":
            return adjust_plane(X, weights, surface=self.surface), None
        plane, robust_weights, self._loss_scale = m_estimate(
            X, weights, loss=self.loss, sigma0=self._known_sigma(), surface=self.surface
        )
        return plane, robust_weights

    def _robust_weights_at(self, residuals, weights=None):
        """W of given residuals, by the same rule for training points and new ones."""
        floor = self._rounding_of(self._plane.direction)
        standardized = residuals / max(self._loss_scale, floor)
        if weights is not None:
            standardized *= np.sqrt(weights)
        return WEIGHT_FUNCTIONS[self.loss](standardized)

    def _set_plane(self, X, plane, initial):
        """Set the attributes of the final plane, and of the plane before any test."""
        check_rank(plane, X.shape[1], "$X that the tests leave")
        self._plane = plane
        self.coef_, self.intercept_ = plane.coef, plane.intercept
        self.normal_ = plane.normal
        self.distance_ = float(plane.center @ self.normal_)
        self.rank_, self.dof_ = plane.rank, plane.dof
        self.variance_factor_ = plane.variance_factor
        self.variance_factor_initial_ = initial.variance_factor
        self._scale = self._deviation_of(plane)
        if self.sigma0 == "auto" and self.test_ != "w":
            self._set_sigma0(np.sqrt(plane.variance_factor), plane)
        self.global_test_pvalue_initial_ = self._global_test(initial)
        self.global_test_pvalue_ = self._global_test(plane)
        self.global_test_level_ = self.alpha
        if self.correction == "b-method" and self.alpha < POWER:
            self.global_test_level_ = coupled_level(self.alpha, max(plane.dof, 1))
        if plane.surface == "orthogonal" and normal_pvalue(plane) > self.alpha:
            warn_caller(
                f"{AS_THICK_AS_WIDE}, which determines no normal: normal_ points anywhere across "
                "them. Add points beside that line, or look for what is thick.",
            )

    def _warn_of_too_few(self, rejected):
        warn(
            f"The tests reject {np.count_nonzero(rejected)} of {len(rejected)} points, "
            "which leaves too few for a plane, or points on a line; the last estimable plane "
            "was kept. Check "
            f"$sigma0={self.sigma0!r} against the noise, or the share of outliers.",
        )

    def _warn_if_steep(self, X, weights, vertical):
        """Warn if vertical residuals of a wall reject good points, or miss the wall.

        Columns may be other things than coordinates, so a wall can only be guessed. The points
        are a wall if they are a thin and steep sheet, and if many of them fail the test or the
        sheet is much nearer to them than the `vertical` plane.
        """
        if self.surface == "orthogonal":
            return
        plane = adjust_plane(X, weights, surface="orthogonal")
        tilt = np.degrees(np.arccos(min(abs(plane.normal[-1]), 1.0)))
        if tilt < STEEP_TILT:
            return
        rejected = np.mean(self.labels_ == -1)
        thickness = np.sqrt(plane.sum_of_squares)
        narrowest = 1 / np.linalg.norm(plane.axes, axis=0).max(initial=np.finfo(float).tiny)
        missed = np.sqrt(vertical.sum_of_squares) * abs(vertical.normal[-1]) > 2 * thickness
        is_sheet = plane.rank >= 3 and thickness < FLATNESS * narrowest
        if is_sheet and (missed or rejected > STEEP_SHARE):
            warn(
                f"The points lie along a plane tilted by {tilt:.0f} degrees, of which "
                f"$surface='vertical' rejects {100 * rejected:.0f} %. If all columns are "
                "coordinates of like precision, as in the scan of a wall, use "
                "$surface='orthogonal'.",
            )

    def _choose_offset(self, scores, used, auto):
        """Limit of the scores: by the test, or the percentile that the user asked for."""
        if self.contamination == "auto":
            return auto
        return float(np.percentile(scores[used], 100.0 * self.contamination))


def check_points(detector: PlaneDetector, X: ArrayLike) -> NDArray[np.float64]:
    check_is_fitted(detector)
    points = check_array(X, dtype=np.float64, order="C")
    if points.shape != (len(detector.labels_), detector.n_features_in_):
        raise ValueError(
            f"X has shape {points.shape}, but the detector was fitted to "
            f"{(len(detector.labels_), detector.n_features_in_)}; pass the training points."
        )
    return points


def sigma0_is_rounding(detector):
    """Whether the standard deviation of a fitted detector is no more than rounding."""
    return detector._sigma0_is_rounding
