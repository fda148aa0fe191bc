"""Base class of both plane tests: input, scale, predictions."""

from numbers import Real
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_array, check_is_fitted

from sklearn_mcmd._choices import Correction, Surface, Test, choices_of
from sklearn_mcmd._errors import ParameterError, warn, warn_caller
from sklearn_mcmd._sklearn import DocLinkMixin, Interval, StrOptions, checked, fit_context
from sklearn_mcmd._validation import OffsetOutlierMixin, validate_points
from sklearn_mcmd.adjustment._determinacy import (
    AS_THICK_AS_WIDE,
    check_distinct,
    check_rank,
    normal_pvalue,
)
from sklearn_mcmd.adjustment._least_squares import (
    PlaneAdjustment,
    Training,
    adjust_plane,
    rounding_of,
)
from sklearn_mcmd.adjustment._precision import PlanePrecision, pointed_up, precision_of, quantile
from sklearn_mcmd.adjustment._reliability import PlaneReliability, reliability_of
from sklearn_mcmd.adjustment._robust import NORMAL_QUARTILE, m_estimate
from sklearn_mcmd.adjustment._tests import POWER, global_test_pvalue, local_level, statistic
from sklearn_mcmd.planes._form import form_of
from sklearn_mcmd.planes._resolution import rounding_in_common

FAR = 100  # times by which a known sigma0 is more or less than the residuals tell, warned of
Variance = Literal["posterior", "independent", "prior"]


class SteepLimits(NamedTuple):
    """When vertical residuals are taken for a mistake, which is warned of."""

    tilt: float = 60.0  # degrees; vertical residuals are then at least twice as long as sigma0
    share: float = 0.05  # of good points of a steep plane that the tests reject
    thickness: float = 0.1  # of a sheet of points over its width, at most
    nearness: float = 2.0  # by which the sheet is nearer to its points than the vertical plane


class FittedPlane(NamedTuple):
    """What a fitted detector knows beside its public attributes."""

    plane: PlaneAdjustment
    scale: float  # standard deviation of unit weight by the plane's residuals
    rounding: float  # of a residual by float64, at most
    least_scale: float  # which the rounding of a file may enlarge
    step: float  # of a residual by this rounding, 0 if there is none
    is_rounding: bool  # whether sigma0 is no more than the rounding of float64
    weights: NDArray[np.float64] | None
    middle: NDArray[np.float64]  # of the extent of the points


class PlaneDetector(DocLinkMixin, OffsetOutlierMixin, BaseEstimator):
    """Base class of plane tests; a subclass has `_fit`, which returns whether it has warned of the
    result, and `score_samples`."""

    _parameter_constraints: ClassVar[dict] = {
        "alpha": [Interval(Real, 0, 1, closed="neither")],
        "test": [StrOptions(choices_of(Test))],
        "sigma0": [Interval(Real, 0, None, closed="neither"), StrOptions({"auto"})],
        "correction": [StrOptions(choices_of(Correction))],
        "surface": [StrOptions(choices_of(Surface))],
        "toward": ["array-like", None],
    }

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: "ArrayLike", y: object = None, weights: "ArrayLike | None" = None) -> Self:
        """Adjust the plane and test its points.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Points; the last column depends on the others.
        y : Ignored
            Present for API consistency.
        weights : array-like of shape (n_samples,), default=None
            Precisions ``p_i = sigma0^2 / sigma_i^2``. They differ from scikit-learn's
            `sample_weight`, which means repetition. A point of weight 0 takes no part and
            is never an outlier: nothing is known about its precision. In a Pipeline, pass
            ``name__weights=``, or request them by ``set_fit_request(weights=True)``.

        Raises
        ------
        ValueError
            If the points of positive weight leave no redundancy (no more distinct points than
            columns), or lie on one line or at one place, so that many planes contain them. For a
            vertical surface the regressors alone count.

        Warns
        -----
        UserWarning
            If the tests would leave too few points for a plane with redundancy; if vertical
            residuals reject points of a steep plane; if the points of an orthogonal surface are
            as thick as they are wide; if half of the points are on one line, which is no robust
            start; or if `sigma0` is less than the rounding of float64, or a hundred times more or
            less than the residuals tell.
        """
        training = self._check_training(X, weights)
        self._place_of_side()
        if not self._fit(training):
            self._warn_if_far(training)
        return self

    def fit_predict(
        self, X: "ArrayLike", y: object = None, weights: "ArrayLike | None" = None
    ) -> NDArray[np.int_]:
        """Fit, and return the labels of the training points, which depend on their weights too."""
        return self.fit(X, weights=weights).labels_

    def residuals(self, X: "ArrayLike") -> NDArray[np.float64]:
        """Observed minus adjusted (n_samples,), along the last axis, or along `normal_` and
        positive on its side."""
        return self._fitted.plane.evaluate(self._check_query(X))[0]

    @checked()
    def precision(self, variance: Variance = "posterior") -> PlanePrecision:
        """Covariance and standard errors of normal, distance, slopes, tilt and its direction.

        Noise that is alike nearby tilts and moves a plane as much as it bows it, and noise that is
        alike along rows or columns of a scan as much as these differ. If the points show such noise
        (`form_`), the scale is that of their bows or strips, with its few degrees of freedom. What
        is smooth over the whole plane, registration and calibration are in no residual, and in no
        error.

        Parameters
        ----------
        variance : {"posterior", "independent", "prior"}, default="posterior"
            "independent": the scale is that of the residuals, with `dof_` degrees of freedom, even
            if noise is alike nearby. "prior": it is the known `sigma0`; if `sigma0` was estimated,
            a ValueError is raised.
        """
        check_is_fitted(self)
        scale, dof = self._scale_by(variance)
        alike = scale / self._fitted.scale if variance == "posterior" else 1.0
        return precision_of(self._fitted.plane, scale, dof, alike)

    @checked()
    def band(
        self, X: "ArrayLike", level: float = 0.95, variance: Variance = "posterior"
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Half widths of the confidence band of the plane and the prediction band of a point.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Places. A coordinate along the residuals does not matter.
        level : float in (0, 1), default=0.95
            Probability that the plane, or a new point of weight 1, is inside at one place. If it is
            no probability, a ValueError is raised.
        variance : {"posterior", "independent", "prior"}, default="posterior"
            See `precision`. A point's own noise is independent of its neighbors' in all three.

        Returns
        -------
        of_plane, of_point : ndarray of shape (n_samples,)
            Around the adjusted plane, along the last axis or the normal, in units of X.
        """
        X = self._check_query(X)
        if not 0 < level < 1:
            raise ValueError(f"level={level!r} is no probability: take one such as 0.95.")
        plane = self._fitted.plane
        scale, dof = self._scale_by(variance)
        design = plane.design(plane.whiten(X)[0]) * plane.deviations
        of_plane = scale * quantile(level, dof) * np.sqrt(np.einsum("ij,ij->i", design, design))
        scale, dof = self._scale_by("prior" if variance == "prior" else "independent")
        return of_plane, np.hypot(of_plane, scale * quantile(level, dof))

    def reliability(self, X: "ArrayLike", power: float = POWER) -> PlaneReliability:
        """Errors that the tests can find, errors that they found, and what the others do.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            The training points.
        power : float in (0, 1), default=0.8
            Probability of detection, above the level of one point.

        Raises
        ------
        ValueError
            If X are others, or the power is below the level.
        """
        return reliability_of(self, check_points(self, X), power)

    def _test_scale(self):
        """The scale that the test of one point takes, and its degrees of freedom."""
        if self.test_ == "w":
            return self.sigma0_, np.inf
        return self._fitted.scale, max(self.dof_ - 1, 1)

    def _statistic(self, standardized):
        return statistic(standardized, self.test_, self.sigma0_, self._fitted.scale, self.dof_)

    def _level_of_one(self):
        """Level of the last tests of single points."""
        return local_level(self.alpha, self._fitted.plane.n_observations, self.correction)

    def _scale_by(self, variance):
        """Standard deviation of unit weight and its degrees of freedom."""
        if variance == "posterior" and self.form_.is_alike(self._fitted.scale):
            return self.form_.alike_deviation, self.form_.alike_dof
        if variance != "prior":
            return self._fitted.scale, self.dof_
        if self.sigma0 == "auto" and self.test_ != "w":
            raise ParameterError(
                "variance='prior' needs a known $sigma0, but it was estimated: take 'posterior'."
            )
        return self.sigma0_, np.inf

    def _check_training(self, X: "ArrayLike", weights: "ArrayLike | None") -> Training:
        points = validate_points(self, X, dtype=np.float64, order="C", ensure_min_features=2)
        p = self._check_weights(points, weights)
        used = np.ones(len(points), dtype=np.bool_) if p is None else p > 0
        counted = points if used.all() else points[used]
        check_distinct(counted, len(points))
        return Training(points, p, used, rounding_of(counted, self.surface))

    def _place_of_side(self):
        """`toward`, checked, or None."""
        if self.toward is None:
            return None
        if self.surface == "vertical":
            raise ParameterError(
                "$toward is for $surface='orthogonal': the normal of a vertical surface points up."
            )
        return place_of(self.toward, self.n_features_in_, "$toward")

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

    def _check_query(self, X: "ArrayLike") -> NDArray[np.float64]:
        check_is_fitted(self)
        return validate_points(self, X, dtype=np.float64, order="C", reset=False)

    def _known_sigma(self):
        """sigma0 if the user knows it and the test uses it, else None."""
        return float(self.sigma0) if self.test == "w" and self.sigma0 != "auto" else None

    def _first_plane(self, training, initial):
        """The plane of least squares and the given sigma0, or a robust plane and its scale."""
        if self.sigma0 != "auto":
            return initial, float(self.sigma0)
        plane, _, sigma = self._m_estimate(training)
        return plane, sigma

    def _m_estimate(self, training):
        X, weights, _, rounding = training
        return m_estimate(X, weights, surface=self.surface, rounding=rounding)

    def _noise(self, sigma, plane, training):
        """sigma, or what rounding makes of a residual from this plane, if larger; and whether that
        is float64's."""
        least = training.rounding.least_deviation(plane.direction)
        step = training.rounding.step_of(plane.direction)
        is_rounding = least <= training.rounding.error_of_float64(plane.direction)
        if sigma <= least and self.test == "w" and self.sigma0 != "auto":
            rounding = f"coordinates in steps of {step:.2g} add"
            remedy = "give the noise of the points as $sigma0"
            if is_rounding:
                rounding = "float64 may add"
                remedy = f"subtract an offset from $X before its digits are lost, or {remedy}"
            warn(
                f"$sigma0={self.sigma0!r} is less than what {rounding} to a residual, {least:.2g}, "
                f"which is taken in its place; {remedy}."
            )
        return max(sigma, least), sigma <= least and is_rounding

    def _global_test(self, plane):
        """p of the global test; nan where sigma0 comes from the same points, and fits them."""
        if self.sigma0 == "auto":
            return np.nan
        return global_test_pvalue(plane.sum_of_squares, self.sigma0_, plane.dof)

    def _set_plane(self, training, plane, initial, noise, support):
        """Set the attributes of the final plane, of the support, and of the first plane."""
        check_rank(plane, training.X.shape[1], "$X that the tests leave")
        if self.sigma0 == "auto" and self.test_ != "w":
            noise = self._noise(np.sqrt(plane.variance_factor), plane, training)
        if self.toward is not None:
            plane = plane.toward(self._place_of_side())
        self.sigma0_, is_rounding = noise
        (X, weights), axes = training[:2], plane.directions
        if not support.all():
            X, weights = X[support], weights if weights is None else weights[support]
        places, residuals = (X - plane.center) @ axes, (X - plane.center) @ plane.direction
        self.form_ = form_of(places, residuals, weights, rises=axes[-1])
        if training.rounding.steps.any():
            common = rounding_in_common(X.std(axis=0), plane.direction, training.rounding.steps)
            self.form_ = self.form_.at_least(common * np.sqrt(plane.sum_weights))
        scale = training.deviation_of(plane)
        if self.toward is None and self.surface == "orthogonal":
            plane = pointed_up(plane, max(scale, self.form_.alike_deviation))
        middle = plane.center + axes @ (places.min(axis=0) + places.max(axis=0)) / 2
        if self.surface == "vertical":
            middle[-1] -= plane.evaluate(middle[None])[0][0]
        self._fitted = FittedPlane(
            plane=plane,
            scale=scale,
            rounding=training.rounding.error_of_float64(plane.direction),
            least_scale=training.rounding.least_deviation(plane.direction),
            step=training.rounding.step_of(plane.direction),
            is_rounding=is_rounding,
            weights=training.weights,
            middle=middle,
        )
        self.coef_, self.intercept_ = plane.coef, plane.intercept
        self.normal_ = plane.normal
        self.distance_ = float(plane.center @ self.normal_)
        self.rank_, self.dof_ = plane.rank, plane.dof
        self.variance_factor_ = plane.variance_factor
        self.variance_factor_initial_ = initial.variance_factor
        self.global_test_pvalue_initial_ = self._global_test(initial)
        self.global_test_pvalue_ = self._global_test(plane)
        if plane.surface == "orthogonal" and normal_pvalue(plane) > self.alpha:
            warn_caller(
                f"{AS_THICK_AS_WIDE}, which determines no normal: normal_ points anywhere across "
                "them. Add points beside that line, or look for what is thick."
            )

    def _warn_if_far(self, training):
        """Warn if a known sigma0 is of another magnitude than the residuals, outliers aside."""
        if self._known_sigma() is None:
            return
        deviation = np.median(self.test_statistic_[training.used]) / NORMAL_QUARTILE * self.sigma0_
        if deviation >= FAR * self.sigma0_:  # unless outliers have taken the plane
            deviation = self._m_estimate(training)[2]
        far = not self.sigma0_ / FAR < deviation < self.sigma0_ * FAR
        if far and deviation > self._fitted.least_scale:
            where = "above" if deviation < self.sigma0_ else "below"
            warn(
                f"$sigma0={self.sigma0!r} is far {where} the deviation of the points from the "
                f"plane, {deviation:.2g} in units of $X. Give the noise of a point as $sigma0, or "
                "'auto', which estimates it."
            )

    def _warn_of_too_few(self, rejected):
        warn(
            f"The tests reject {np.count_nonzero(rejected)} of {len(rejected)} points, "
            "which leaves too few for a plane, or points on a line; the last estimable plane "
            "was kept. Check "
            f"$sigma0={self.sigma0!r} against the noise, or the share of outliers."
        )

    def _warn_if_steep(self, training, vertical):
        """Warn if vertical residuals of a wall reject good points, or miss the wall.

        Columns may be other things than coordinates. The points are taken for a wall if they are a
        thin and steep sheet that fails the test, or is much nearer than the `vertical` plane.
        """
        if self.surface == "orthogonal":
            return
        limits = SteepLimits()
        plane = adjust_plane(training.X, training.weights, surface="orthogonal")
        tilt = np.degrees(np.arccos(min(abs(plane.normal[-1]), 1.0)))
        if tilt < limits.tilt:
            return
        rejected = np.mean(self.labels_ == -1)
        thickness = np.sqrt(plane.sum_of_squares)
        narrowest = 1 / np.linalg.norm(plane.axes, axis=0).max(initial=np.finfo(float).tiny)
        missed = np.sqrt(vertical.sum_of_squares) * abs(vertical.normal[-1])
        is_missed = missed > limits.nearness * thickness
        is_sheet = plane.rank >= 3 and thickness < limits.thickness * narrowest
        if is_sheet and (is_missed or rejected > limits.share):
            warn(
                f"The points lie along a plane tilted by {tilt:.0f} degrees, of which "
                f"$surface='vertical' rejects {100 * rejected:.0f} %. If all columns are "
                "coordinates of like precision, as in the scan of a wall, use "
                "$surface='orthogonal'."
            )
            return True


def check_points(detector: PlaneDetector, X: "ArrayLike") -> NDArray[np.float64]:
    check_is_fitted(detector)
    points = check_array(X, dtype=np.float64, order="C")
    if points.shape != (len(detector.labels_), detector.n_features_in_):
        raise ValueError(
            f"X has shape {points.shape}, but the detector was fitted to "
            f"{(len(detector.labels_), detector.n_features_in_)}; pass the training points."
        )
    return points


def place_of(values, n, name):
    """A place of n finite coordinates, or an error that names the parameter."""
    try:
        place = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        place = np.empty(0)
    if place.shape != (n,) or not np.isfinite(place).all():
        raise ParameterError(f"{name}={values!r} is no place: give {n} coordinates.")
    return place
