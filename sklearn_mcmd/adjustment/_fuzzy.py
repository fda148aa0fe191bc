"""Outliers of a least-squares plane by fuzzy sets."""

from numbers import Real
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._choices import Correction, Surface, Test
from sklearn_mcmd._sklearn import Interval, StrOptions
from sklearn_mcmd.adjustment._base import PlaneDetector
from sklearn_mcmd.adjustment._determinacy import check_rank
from sklearn_mcmd.adjustment._effects import bounding_points, effects_of, largest_effects
from sklearn_mcmd.adjustment._least_squares import adjust_plane, weighed
from sklearn_mcmd.adjustment._memberships import (
    abnormal_residual_membership,
    defuzzification_complement,
    normal_error_complement,
    normal_residual_membership,
)
from sklearn_mcmd.adjustment._start import points_of_noise
from sklearn_mcmd.adjustment._tests import (
    critical_value,
    normal_equivalent,
    standardized_residuals,
    t_to_tau,
)


class Effects(NamedTuple):
    """What errors of the training points do, to judge new ones."""

    vertices: NDArray[np.float64]  # points that bound the effects of all normal ones
    largest_leverage: float
    largest: float  # element of the redundancy matrix


class FuzzyPlaneDetector(PlaneDetector):
    """Points that are no part of a plane, found at once by a limit of two groups (Eqs 9-21).

    The detector fits ``z = a x + b y + c`` once (any number of regressors; the last column of X
    is the dependent one). The test statistic of a residual makes it more or less *abnormal*. The
    redundancy matrix shows which observation's error acts on which residuals. A weighted mean of
    the resulting memberships is the limit. If outliers and good points form two groups, the limit
    falls between them. So one adjustment rejects far fewer good points than a test that removes
    all rejected points at once.

    Parameters
    ----------
    sigma0 : float > 0 or "auto", default=1.0
        Standard deviation of an observation of weight 1, in the units of the dependent
        column, which `MCMDOutlierDetector` calls `noise_scale`. **Set it**, or take "auto", the
        deviation of the points that are no farther from a robust plane than noise is. w is then
        the one that is as rare as the t of this deviation.
    alpha : float in (0, 1), default=0.05
        Level of the critical value ``N_{1 - alpha/2}``.
    surface : {"vertical", "orthogonal"}, default="vertical"
        "vertical" takes residuals along the last axis, "orthogonal" along the normal (for walls).
    toward : array-like of shape (n_features,), default=None
        A place to whose side the normal points; see `BaardaPlaneDetector`.
    test : {"w", "tau", "t"}, default="w"
        Statistic of the residuals; see `BaardaPlaneDetector`.
    correction : {"none", "sidak", "bonferroni"}, default="none"
        "none" is the paper: alpha is the level of the critical value, where a residual begins to be
        abnormal. Then about one of 300 good points is flagged, so half of the clean planes of 200
        points have one. With the others a residual is half abnormal at the critical value of the
        local level of `BaardaPlaneDetector`: so with "sidak" one clean plane in twenty has a
        flagged point.
    width : float > 0, default=1.0
        Distance beyond the critical value, over the root of the redundancy number, at which
        a residual is half abnormal: the "alpha" of Eq. 11. The paper's tables need 1 to 1.5
        and are exact at 1.25. They are not exact with the significance level.
    weighting : {"ratio", "cut"}, default="ratio"
        Weights of the limit. "ratio" is the paper's Eq. 20, ``1 / m_N - r~n``. "cut" is
        ``1 - r~n``. "ratio" has no bound: one huge outlier can take the limit for itself and mask
        the others. Take "cut" if sizes differ by more than a factor of 5.

    Attributes
    ----------
    labels_ : ndarray of int of shape (n_samples,)
        -1 for outliers, 1 for inliers.
    membership_ : ndarray of shape (n_samples,)
        m_H, Eq. 18: the observation as an outlier. Below the critical value it is leverage
        and nothing else; to rank points take `test_statistic_`.
    membership_residual_ : ndarray of shape (n_samples,)
        m_M, Eq. 11: the residual as abnormal.
    defuzzification_limit_ : float
        C_H, Eq. 19; nan if no residual is abnormal, since nothing is compared then.
    defuzzification_complement_ : float
        ``1 - C_H`` with all its digits.
    test_ : {"w", "tau", "t"}
        The test that was done: `test`, or "t" in place of "w" where `sigma0` is estimated.
    test_statistic_, redundancy_, leverage_ : ndarray of shape (n_samples,)
        As of `BaardaPlaneDetector`, of the one plane; redundancy numbers sum to `dof_`.
    critical_value_ : float
        ``N_{1 - alpha/2}``, or that of tau or t.
    coef_, intercept_, normal_, distance_, sigma0_, dof_, rank_, form_
        As of `BaardaPlaneDetector`.
    support_ : ndarray of bool of shape (n_samples,)
        Points of positive weight: all of them make the plane.
    variance_factor_initial_, variance_factor_ : float
        v'Pv / f of all points, and after the outliers are left out and the plane is adjusted
        again, as in the paper's Table 4.
    global_test_pvalue_, global_test_pvalue_initial_ : float
        As of `BaardaPlaneDetector`, without the outliers and of all points.
    offset_, n_features_in_, feature_names_in_
        As of `BaardaPlaneDetector`.

    See Also
    --------
    BaardaPlaneDetector : Data snooping; at equal critical value it is the stronger test.
    sklearn.linear_model.RANSACRegressor : For more outliers, as Open3D's ``segment_plane``.

    Notes
    -----
    **One formula is left** of Eqs 11-21, because m_H is always m_B (see
    `normal_error_complement`): with ``G_i = 1 - m_H = r~n_i m_N(v_i)`` a point is an outlier where
    ``G_i <= 1 - C_H``. It needs two guards that the paper lacks. Without any abnormal
    residual there is no outlier: Eqs 19-21 would flag a quarter of a clean cloud, by
    leverage alone. Without any normal one, all are.

    **The redundancy matrix is never formed.** Its elements off the diagonal,
    ``r_ki = -p_i a_k'N^-1 a_i``, are affine in the regressors of k, so the largest is at a
    vertex of the convex hull: n points with m abnormal ones cost about ``n + m log n``.

    :ref:`misprints` has what departs from the paper, and why. If no training residual is abnormal,
    a new point is one if its G is below a quarter of the largest a normal point can have, and below
    that of all training points.

    References
    ----------
    .. [1] R. Arabsheibani, A. Abedini, Y. Kanani Sadat, "Comparison of outlier detection at
       the edges of point clouds using statistical approach and fuzzy methodology", Geodesy
       and Cartography 41(3), 2015, Eqs 9-21.
    .. [2] Y. Sisman, A. Dilaver, S. Bektas, "Outlier detection in 3D coordinate
       transformation with fuzzy logic", Acta Montanistica Slovaca 17(1), 2012.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import FuzzyPlaneDetector
    >>> rng = np.random.default_rng(0)
    >>> xy = rng.uniform(0, 10, size=(500, 2))
    >>> z = xy @ [0.1, -0.2] + 3 + rng.normal(scale=0.001, size=500)
    >>> z[:100] += 0.06  # one point in five
    >>> detector = FuzzyPlaneDetector(0.15, sigma0=0.01, width=1.25)
    >>> found = detector.fit_predict(np.column_stack([xy, z])) == -1
    >>> print(f"{found[:100].sum()} of 100 outliers, {found[100:].sum()} of 400 good points")
    100 of 100 outliers, 0 of 400 good points
    """

    _parameter_constraints: ClassVar[dict] = {
        **PlaneDetector._parameter_constraints,
        "width": [Interval(Real, 0, None, closed="neither")],
        "weighting": [StrOptions({"ratio", "cut"})],
    }

    def __init__(
        self,
        alpha: float = 0.05,
        *,
        test: Test = "w",
        sigma0: float | Literal["auto"] = 1.0,
        correction: Correction = "none",
        width: float = 1.0,
        weighting: Literal["ratio", "cut"] = "ratio",
        surface: Surface = "vertical",
        toward: "ArrayLike | None" = None,
    ) -> None:
        self.alpha = alpha
        self.test = test
        self.sigma0 = sigma0
        self.correction = correction
        self.width = width
        self.weighting = weighting
        self.surface = surface
        self.toward = toward

    def _fit(self, training):
        """Adjust the plane once and divide its residuals."""
        # Step 1: the plane, and sigma0 where it is estimated.
        X, weights, used, _ = training
        plane = adjust_plane(X, weights, surface=self.surface)
        check_rank(plane, X.shape[1])
        self.test_, self._dof_of_scale = self.test, np.inf
        first, sigma = self._first_plane(training, plane)
        estimated = self.sigma0 == "auto" and self.test == "w"
        if estimated:
            inside = points_of_noise(training, first, sigma, self.alpha)
            first = adjust_plane(X, weighed(inside, weights), surface=self.surface)
            sigma, self._dof_of_scale = training.deviation_of(first), max(first.dof, 1)
        noise = self._noise(sigma, first, training)
        self._set_plane(training, plane, plane, noise, used)
        self.test_ = "t" if estimated else self.test
        self.support_ = used
        self.critical_value_ = critical_value(self.test, self._level_of_one(), self.dof_)

        # Step 2: statistics and memberships of residuals (Eqs 9-12).
        residuals, cofactors = plane.evaluate(X)
        self.redundancy_ = 1 - weighed(cofactors, weights)
        self.test_statistic_ = self._statistic(
            standardized_residuals(residuals, weights, self.redundancy_)
        )
        self.leverage_ = 1 - self.redundancy_
        of_residuals = self._of_memberships(self.test_statistic_, self.redundancy_)
        self.membership_residual_ = abnormal_residual_membership(**of_residuals)
        normal = normal_residual_membership(**of_residuals)
        abnormal = self.membership_residual_ >= 0.5
        # Step 3: effects of errors (Eqs 13-18), the limit (Eqs 19, 20) and labels (Eq. 21).
        effect, self._effects = self._find_effects(training, cofactors, abnormal)
        complement = normal_error_complement(effect, normal)
        self.membership_ = 1 - complement
        self.defuzzification_complement_ = np.nan
        if abnormal.any():
            self.defuzzification_complement_ = defuzzification_complement(
                complement[used], effect[used], normal[used], self.weighting
            )
        self.defuzzification_limit_ = 1 - self.defuzzification_complement_
        # `decision_function` is negative for outliers, and a tie is one (Eq. 21).
        self.offset_ = float(np.nextafter(self.defuzzification_complement_, np.inf))
        if not abnormal.any():
            # The largest effect times G is at least (1 - h) / 2 for a normal point, and at most
            # h / 2 for an abnormal one: 1 / 4 parts them where h = 1 / 2.
            self.offset_ = float(min(0.25 / self._effects.largest, complement[used].min()))
        self.labels_ = np.where(complement - self.offset_ < 0, -1, 1)
        self.labels_[~used] = 1
        too_few = self._set_variance_after(X, weights)
        return self._warn_if_steep(training, plane) or too_few

    def score_samples(self, X: "ArrayLike") -> NDArray[np.float64]:
        """``G = 1 - m_H`` of each point, an observation of weight 1: lower is more abnormal.

        A point with no more leverage than the training points counts as one of the adjusted
        observations. A point with more leverage counts as an added one: its residual has the
        larger deviation ``sqrt(1 + h)`` and the redundancy number ``1 / (1 + h)``.
        """
        X = self._check_query(X)
        plane, effects = self._fitted.plane, self._effects
        residuals, cofactors = plane.evaluate(X)
        # The same point in another batch may differ by rounding.
        adjusted = cofactors <= effects.largest_leverage * (1 + 1e-9)
        added = ~adjusted
        redundancy = np.where(adjusted, 1 - cofactors, 1 / (1 + cofactors))
        standardized = standardized_residuals(residuals, None, redundancy)
        # |v| / sqrt(r) = |v| sqrt(1 + h) becomes |v| / sqrt(1 + h), as r = 1 / (1 + h).
        standardized[added] *= redundancy[added]
        tests = self._statistic(standardized)
        if self.test != "w" and added.any():
            t = standardized[added] / self._fitted.scale
            tests[added] = t if self.test == "t" else t_to_tau(t, self.dof_ + 1)
        normal = normal_residual_membership(**self._of_memberships(tests, redundancy))
        effect = largest_effects(plane, X, effects.vertices)
        alone = np.flatnonzero(adjusted & (cofactors > 0.5))
        same = (X[alone, None] == effects.vertices).all(axis=2)
        effect[alone] = largest_effects(plane, X[alone], effects.vertices, same)
        np.maximum(effect, redundancy, out=effect, where=normal > 0.5)
        return normal_error_complement(effect / effects.largest, normal)

    def _test_scale(self):
        if self.test_ == self.test:
            return super()._test_scale()
        return self.sigma0_, self._dof_of_scale

    def _statistic(self, standardized):
        if self.test_ == self.test:
            return super()._statistic(standardized)
        return normal_equivalent(standardized / self.sigma0_, self._dof_of_scale)

    def _of_memberships(self, tests, redundancy):
        """The arguments of the memberships of residuals (Eqs 11 and 12)."""
        critical, width = self.critical_value_, float(self.width)
        if self.correction != "none":
            # So that a residual is half abnormal at the critical value, and not beyond it.
            critical = critical - width * np.sqrt(np.maximum(redundancy, 0.0))
        return {"statistic": tests, "redundancy": redundancy, "critical": critical, "width": width}

    def _find_effects(self, training, cofactors, abnormal):
        """r~n of every observation (Eqs 13, 17), without the redundancy matrix.

        With equal weights a normal point with ``h <= 1/2`` acts most on itself, because ``|r_ki| <=
        sqrt(r_ii h_i) <= r_ii``. So only abnormal points need a search. The largest element of the
        matrix needs none if n >= 2u: it is then the largest r_ii.
        """
        X, weights, used, _ = training
        plane, n = self._fitted.plane, len(X)
        leverage = weighed(cofactors, weights)
        diagonal = np.maximum(1 - leverage, 0.0)
        alone = leverage > 0.5  # at most 2u points: leverages sum to u

        normal = used & ~abnormal
        vertices = bounding_points(plane, X, np.flatnonzero(normal), alone)
        sought = np.flatnonzero(used if weights is not None else used & (abnormal | alone))
        effect = np.zeros(n)
        effect[sought] = effects_of(plane, X, sought, vertices, weights, alone)
        np.maximum(effect, diagonal, out=effect, where=normal)

        largest = diagonal.max(where=used, initial=0.0)
        if weights is not None or n < 2 * plane.rank:
            everyone = np.flatnonzero(used)
            bounds = bounding_points(plane, X, everyone, alone)
            largest = max(largest, effects_of(plane, X, everyone, bounds, weights, alone).max())
        largest = float(largest) or 1.0
        effect /= largest
        effect[~used] = 1.0
        effects = Effects(
            vertices=X[vertices],
            largest_leverage=float(cofactors.max(where=used, initial=0.0)),
            largest=largest,
        )
        return effect, effects

    def _set_variance_after(self, X, weights):
        """Set variance factor and global test of the points left; whether these are too few."""
        left = (self.labels_ == 1) & self.support_
        plane = self._fitted.plane
        if too_few := np.count_nonzero(left) <= plane.rank:
            self._warn_of_too_few(self.labels_ == -1)
        elif not left.all():
            plane = adjust_plane(X, weighed(left, weights), surface=self.surface)
            self.variance_factor_ = plane.variance_factor
            self.global_test_pvalue_ = self._global_test(plane)
        return too_few
