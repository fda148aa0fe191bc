"""Baarda's data snooping of a least-squares plane."""

from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._choices import Correction, EliminationRule, Surface, Test, choices_of
from sklearn_mcmd._errors import warn
from sklearn_mcmd._sklearn import StrOptions
from sklearn_mcmd.adjustment._base import PlaneDetector
from sklearn_mcmd.adjustment._determinacy import check_rank
from sklearn_mcmd.adjustment._elimination import Elimination, eliminate, eliminate_one_by_one
from sklearn_mcmd.adjustment._least_squares import adjust_plane, weighed
from sklearn_mcmd.adjustment._start import joining, points_of_noise, robust_start
from sklearn_mcmd.adjustment._tests import (
    critical_value,
    local_level,
    residual_limit,
    standardized_residuals,
    t_to_tau,
)


class BaardaPlaneDetector(PlaneDetector):
    """Points that are no part of a plane, found one by one by geodesy's tests (data snooping).

    The detector fits ``z = a x + b y + c`` by least squares (any number of regressors; the last
    column of X is the dependent one). It divides every residual by its own standard deviation.
    It removes the point with the largest quotient if this exceeds the critical value, and
    repeats. It finds single outliers among thousands of good points, because the critical value
    allows for the number of tested points.

    Parameters
    ----------
    sigma0 : float > 0 or "auto", default=1.0
        Standard deviation of an observation of weight 1, in the units of the dependent
        column (along the normal, for an orthogonal surface). It is the noise that
        `MCMDOutlierDetector` calls `noise_scale`: give a scanner's deviation to either.
        **Set it**. In a cloud in meters the default of 1 m finds no outlier among residuals of
        millimeters, which is warned of. "auto" estimates it from the points that pass, and tests by
        tau, because an estimate is not known; see Notes.
    alpha : float in (0, 1), default=0.05
        Level of the test of the whole cloud, or of each point with ``correction="none"``.
    surface : {"vertical", "orthogonal"}, default="vertical"
        "vertical" takes residuals along the last axis, "orthogonal" along the normal (total
        least squares). Take "orthogonal" for walls: of a plane tilted by 80 degrees with equal
        noise in all directions, "vertical" rejects half of the good points.
    robust_start : bool, default=False
        Whether round 1 starts from the plane of the most coplanar half of the points (the
        maximum consistent set), improved by concentration and reweighting, in place of all
        points. Points that stay outside of it are left out in round 1. Least squares follows
        outliers gathered at one edge and fails there from a share of 20 to 30 %. With this start
        a share of 45 % of outliers of 10 sigma is found, and of up to 40 % without knowing sigma
        or with an orthogonal surface.
    toward : array-like of shape (n_features,), default=None
        A place to whose side the normal of an orthogonal surface points, such as where the scanner
        stood. Without it, it points up; if its height is less than four of its standard errors,
        as that of a wall, to +y, or to +x if the wall goes along y. The normal of a vertical
        surface always points up.
    test : {"w", "tau", "t"}, default="w"
        "w" compares with a known `sigma0` (Baarda); with ``sigma0="auto"`` it is replaced by tau.
        "tau" compares with the scale estimated from all residuals (Pope), "t" with the scale
        estimated without the tested point. The last two decide alike. Alone they fail where more
        than some 5 % of the points are outliers, because outliers enlarge the scale.
    correction : {"sidak", "bonferroni", "none"}, default="sidak"
        Local level: ``1 - (1 - alpha)^(1/n)`` (Eq. 1), ``alpha / n`` or alpha itself.
    elimination : {"single", "all"}, default="single"
        "single" removes the worst point of each round, "all" every rejected point. "all"
        reproduces the paper's tables. It removes many good points with the outliers; they come
        back in `labels_`.
    random_state : int, RandomState instance or None, default=None
        Seed of the trials of the robust start. An int makes results repeatable.

    Attributes
    ----------
    labels_ : ndarray of int of shape (n_samples,)
        Verdict on each training point, -1 for outliers: its test against the final plane. A
        point that was removed in an earlier round may have come back.
    elimination_step_ : ndarray of int of shape (n_samples,)
        Round in which a point was removed, 0 for those never removed.
    test_ : {"w", "tau", "t"}
        The test that was done: `test`, or "tau" in place of "w" where `sigma0` is estimated.
    support_ : ndarray of bool of shape (n_samples,)
        Points the final plane was adjusted to.
    test_statistic_ : ndarray of shape (n_samples,)
        w, tau or t of each point in the adjustment of the support, joined by this point
        where it is not a member.
    redundancy_, leverage_ : ndarray of shape (n_samples,)
        Redundancy number r_i there, and ``1 - r_i``. Those of the support sum to `dof_`.
    critical_value_ : float
        Of the last round.
    coef_, intercept_ : ndarray of shape (n_features - 1,) and float
        Slopes, of minimum norm where a column depends on two or more others; constant term.
    normal_, distance_ : ndarray of shape (n_features,) and float
        Unit normal of the plane, and ``normal_ @ x`` of its points.
    sigma0_ : float
        `sigma0`, or its estimate from the support; no less than what float64 may add to a
        residual at these coordinates (some 1e-14 at 10, 1e-9 at 5e6), which is all the noise
        there is in points of an exact plane.
    variance_factor_, variance_factor_initial_ : float
        v'Pv / f of the support, and of all points before the first test.
    form_ : PlaneForm
        What the points of the support have in common beside the plane: lack of fit, bow, and
        whether their noise is alike nearby.
    global_test_pvalue_, global_test_pvalue_initial_ : float
        Probability of a larger v'Pv / sigma0^2 in clean data than that of the support, and of all
        points before the first test. Near 0: sigma0 is too small or outliers are left; near 1:
        sigma0 is too large. nan with ``sigma0="auto"``: an estimate from the same points would
        be tested against itself.
    dof_, rank_ : int
        Degrees of freedom f and number of estimable parameters u.
    n_iter_ : int
        Rounds of removal, 1 if there were none.
    offset_ : float
        Limit of the scores: minus the critical value for a new point.
    n_features_in_, feature_names_in_ : int and ndarray of str of shape (`n_features_in_`,)
        Number of columns seen in `fit`, and their names, if they had any.

    See Also
    --------
    FuzzyPlaneDetector : One adjustment and a limit between the two groups, no iteration.
    sklearn_mcmd.adjustment.compare_planes : Has the plane moved since?
    sklearn.linear_model.RANSACRegressor : For more outliers, as Open3D's ``segment_plane``.
    sklearn.covariance.EllipticEnvelope : Outliers of a cloud without a dependent column.

    Notes
    -----
    `score_samples` is ``-|v| / (s sqrt(1/p + a'N^-1 a))`` with plane, N and s of the
    support. This is exact: the predicted residual over its deviation equals the statistic that
    the point has after it joined the support.

    Weights are precisions, not repetitions. Two observations have two residuals and two tests.
    One observation of double weight has one.

    n points with k removals cost about ``n + k (512 + n / 256)``: sums are down-dated.

    tau and t of all points find outliers only up to a share of ``1 / (1 + c^2)`` (7 % at
    c = 3.66), no matter how large they are. Set sigma0, or take "auto" or `robust_start`: then
    points far from a robust plane are left out first. With an estimated sigma0 they come back,
    :ref:`as far as the level asks <estimated_level>`, which holds from 8 points on.

    References
    ----------
    .. [1] R. Arabsheibani, A. Abedini, Y. Kanani Sadat, "Comparison of outlier detection at
       the edges of point clouds using statistical approach and fuzzy methodology", Geodesy
       and Cartography 41(3), 2015, Eq. 1, Table 1.
    .. [2] W. Baarda, "A testing procedure for use in geodetic networks", 1968.
    .. [3] A. J. Pope, "The statistics of residuals and the detection of outliers", 1976.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector
    >>> rng = np.random.default_rng(0)
    >>> xy = rng.uniform(0, 10, size=(500, 2))
    >>> z = xy @ [0.1, -0.2] + 3 + rng.normal(scale=0.01, size=500)
    >>> z[:40] += 0.1  # ten standard deviations
    >>> X = np.column_stack([xy, z])
    >>> settings = {"sigma0": "auto", "surface": "orthogonal", "robust_start": True}  # mcmd plane
    >>> detector = BaardaPlaneDetector(**settings, random_state=0).fit(X)
    >>> found = detector.labels_ == -1
    >>> print(f"{found[:40].sum()} of 40 outliers, {found[40:].sum()} of 460 good points")
    40 of 40 outliers, 0 of 460 good points
    >>> print(detector.coef_.round(2), f"{detector.sigma0_:.4f}")
    [ 0.1 -0.2] 0.0098
    >>> precision = detector.precision()
    >>> print(f"tilt {precision.tilt:.3f} ± {precision.tilt_error:.3f} degrees")
    tilt 12.623 ± 0.009 degrees
    """

    _parameter_constraints: ClassVar[dict] = {
        **PlaneDetector._parameter_constraints,
        "elimination": [StrOptions(choices_of(EliminationRule))],
        "robust_start": ["boolean"],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        alpha: float = 0.05,
        *,
        test: Test = "w",
        sigma0: float | Literal["auto"] = 1.0,
        correction: Correction = "sidak",
        elimination: EliminationRule = "single",
        surface: Surface = "vertical",
        toward: "ArrayLike | None" = None,
        robust_start: bool = False,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.alpha = alpha
        self.test = test
        self.sigma0 = sigma0
        self.correction = correction
        self.elimination = elimination
        self.surface = surface
        self.toward = toward
        self.robust_start = robust_start
        self.random_state = random_state

    def _fit(self, training):
        """Adjust the plane and remove what its tests reject."""
        # Step 1: the plane of all points, or a robust one.
        X, weights, used, _ = training
        initial = adjust_plane(X, weights, surface=self.surface)
        check_rank(initial, X.shape[1])
        self.test_ = "tau" if self.test == "w" and self.sigma0 == "auto" else self.test
        start = None
        if self.robust_start:
            sigma0 = self._known_sigma()
            start, sigma = robust_start(
                training, initial.rank, self.surface, sigma0, self.random_state
            )
            if start is None:
                warn(
                    "$robust_start=True finds half of the points or more on one line, through "
                    "which any plane goes. All points are the start in their place, as with "
                    "$robust_start=False."
                )
        is_robust = start is not None or self.test_ != self.test
        if start is None:
            start, sigma = self._first_plane(training, initial)
        # Step 2: rounds of removal, from the points that a robust plane leaves.
        noise = self._noise(sigma if self.sigma0 == "auto" else float(self.sigma0), start, training)
        support = self._left_by_start(training, start, sigma) if is_robust else used
        left_out = used & ~support
        first = Elimination(
            step=left_out.astype(np.intp), support=support, n_rounds=int(left_out.any())
        )
        snooped = self._eliminate(training, noise[0], first)
        self._set_plane(training, snooped.plane, initial, noise, snooped.support)
        # Step 3: each point against the plane of the support (Table 1).
        self.support_, self.elimination_step_ = snooped.support, snooped.step
        self.n_iter_ = max(snooped.n_rounds, 1)
        self.critical_value_ = critical_value(self.test_, self._level_of_one(), self.dof_)
        scores = self._test_training(training, snooped)
        # A point that joins others has a t, for tau too, as their scale lacks it.
        level = local_level(self.alpha, snooped.plane.n_observations + 1, self.correction)
        limit = critical_value("w" if self.test_ == "w" else "t", level, self.dof_ + 1)
        self.offset_ = -limit
        self.labels_ = np.where(scores - self.offset_ < 0, -1, 1)
        if snooped.ran_out_of_points:
            self._warn_of_too_few(snooped.step > 0)
        return self._warn_if_steep(training, initial) or snooped.ran_out_of_points

    def score_samples(self, X: "ArrayLike") -> NDArray[np.float64]:
        """Minus the statistic that each point would have if it joined the support with weight 1:
        0 on the plane, lower is more abnormal. For tau it is the equivalent t."""
        X = self._check_query(X)
        return -joining(X, None, self._fitted.plane, self._test_scale()[0])

    def _eliminate(self, training, sigma0, first):
        """Rounds of removal from the first support on."""
        X, weights = training.X, training.weights

        def limit(n_retained, dof, variance_factor, direction):
            level = local_level(self.alpha, n_retained, self.correction)
            scale = max(np.sqrt(variance_factor), training.rounding.least_deviation(direction))
            return residual_limit(self.test_, level, dof, sigma0, scale)

        rounds = eliminate_one_by_one if self.elimination == "single" else eliminate
        return rounds(X, weights, self.surface, limit, first)

    def _left_by_start(self, training, start, sigma):
        """The points that a robust plane leaves in the support, to begin the snooping with."""
        n = int(np.count_nonzero(training.used))
        level = local_level(self.alpha, n, self.correction)
        if self.test_ != "w":
            return points_of_noise(training, start, sigma, n * level)
        limit = critical_value("w", level, n)
        support = training.used & (joining(training.X, training.weights, start, sigma) <= limit)
        # Otherwise sigma0 is far too small, which the rounds will report.
        return support if np.count_nonzero(support) > start.rank else training.used

    def _test_training(self, training, snooped):
        """Set the attributes of the training points and return their scores."""
        X, weights, _, _ = training
        support = snooped.support
        residuals, cofactors = snooped.plane.evaluate(X)
        # Points outside the support are tested as if they joined it.
        outside = joining(X, weights, snooped.plane, self._test_scale()[0])
        scores = -outside
        if self.test_ == "tau":
            outside = t_to_tau(outside, self.dof_ + 1)
        leverage = weighed(cofactors, weights)
        redundancy = np.where(support, 1 - leverage, 1 / (1 + leverage))
        standardized = standardized_residuals(residuals, weights, redundancy)
        self.test_statistic_ = np.where(support, self._statistic(standardized), outside)
        self.redundancy_, self.leverage_ = redundancy, 1 - redundancy
        return scores
