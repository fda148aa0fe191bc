"""MCMDOutlierDetector: outliers of the planes of local neighborhoods."""

from typing import ClassVar

import numpy as np
from sklearn.base import OutlierMixin
from sklearn.utils.validation import check_is_fitted

from sklearn_mcmd._base import BaseLocalPlanes, StrOptions, fit_context

__all__ = ["MCMDOutlierDetector"]


class MCMDOutlierDetector(OutlierMixin, BaseLocalPlanes):
    """Outliers by maximum consistency with minimum distance (MCMD).

    Around each point the plane is sought that the majority of its neighbors agree on: of the
    ``h`` neighbors nearest to the planes of random minimal subsets, the set with the smallest
    least eigenvalue, the *maximum consistent set*. A point is an outlier if it is farther
    from that plane than the plane's own robust scale explains. Unlike least squares, the
    plane does not follow the outliers, as long as fewer than half of the neighbors are.

    Parameters
    ----------
    n_neighbors : int or None, default=50
        Size of a neighborhood (k), at least ``n_features + 1``. A point of the fitted cloud
        is its own first neighbor. None means one neighborhood of all points (section 5.1 of
        the paper), for data that are one plane.

    method : {"mcmd_z", "mcmd_md"}, default="mcmd_z"
        "mcmd_z" measures the orthogonal distance to the plane by a robust z-score
        (Algorithm 2); "mcmd_md" the robust Mahalanobis distance (Algorithm 3), which also
        flags points far from the center within the plane.

    support_fraction : float in (0, 1] or "auto", default=0.5
        Share of a neighborhood that forms the consistent set, ``h = ceil(support_fraction *
        k)``. "auto" is ``1 - outlier_rate``. Less than 0.5 withstands more than half of
        outliers if these are not consistent with a plane themselves.

    outlier_rate : float in [0, 1), default=0.5
        Assumed share of outliers in a neighborhood (epsilon). It sets the number of trials
        (Eq. 13); too small a rate risks masking. It is not the share that is flagged.

    success_probability : float in (0, 1), default=0.9999
        Probability that at least one minimal subset is free of outliers (P_r).

    cutoff : float, default=None
        Robust distance beyond which a point is an outlier. None means 2.5 for "mcmd_z" and
        the root of the 0.975 quantile of chi-squared with ``n_features`` degrees of freedom
        for "mcmd_md" (3.0575 in 3D).

    refine : {"reweight"} or None, default="reweight"
        "reweight" refits plane and scale twice to the neighbors within 2.5 robust standard
        deviations; it repairs the swamping of "mcmd_md", gives more accurate planes and needs
        no knowledge of the outlier rate. None is the paper to the letter.

    random_state : int, RandomState instance or None, default=None
        Seed of the one table of trials that all neighborhoods use.

    n_jobs : int, default=None
        Number of threads; None means 1 unless in a :obj:`joblib.parallel_config` context and
        -1 all processors. Results do not depend on it.

    Attributes
    ----------
    offset_ : float
        Negative of the cutoff: ``decision_function = score_samples - offset_``.

    n_neighbors_ : int
        Size of a neighborhood: `n_neighbors`, or the number of samples if that is smaller.

    n_support_ : int
        Points in a consistent set (h).

    n_trials_ : int
        Minimal subsets tried in each neighborhood (I_t), 69 with the defaults in 3D. The
        number doubles with each dimension; beyond 3D it is limited to 300, with a warning.

    n_features_in_ : int
        Number of features seen during `fit`.

    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of features seen during `fit`, when X has names that are all strings.

    See Also
    --------
    RobustNormalEstimator : Normals and curvature from the same planes.
    sklearn.neighbors.LocalOutlierFactor : Outliers by density, without planes.
    sklearn.covariance.EllipticEnvelope : One robust ellipsoid for all data.

    Notes
    -----
    Predicting scores new points against the fitted cloud: the plane is that of the query's
    `n_neighbors` nearest points of the cloud. So ``fit_predict(X)`` equals
    ``fit(X).predict(X)``.

    A neighborhood of exactly coplanar points has no scale; rounding of the coordinates takes
    its place, and any point visibly off the plane is an outlier with a very large but finite
    distance. Where coordinates are found to be rounded to a step, as in a file in centimeters,
    half of it is the least scale, so that one step is no outlier. Copies of a point count once
    in a neighborhood. Points of one line or location are inliers among themselves, and a query
    away from it is an outlier. Where the cloud holds fewer than `n_neighbors` distinct points,
    all of them are used, with a warning.

    The time grows as ``n_samples * n_trials_ * n_neighbors`` and as ``n_samples *
    log(n_samples)`` for the search; the memory beyond the cloud and the results is bounded,
    except with ``n_neighbors=None``. In 3D and from
    1,000 points on the work is done by compiled code.

    References
    ----------
    .. [1] A. Nurunnabi, G. West, D. Belton, "Outlier detection and robust normal-curvature
       estimation in mobile laser scanning 3D point cloud data", Pattern Recognition 48
       (2015) 1404-1419, Algorithms 1 to 3.

    Examples
    --------
    A wall with four points that a passing car left in front of it:

    >>> import numpy as np
    >>> from sklearn_mcmd import MCMDOutlierDetector
    >>> rng = np.random.default_rng(0)
    >>> wall = rng.uniform(0, 2, (40, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (40, 3))
    >>> car = [[0.5, -0.8, 0.4], [0.6, -0.8, 0.4], [0.5, -0.8, 0.5], [0.6, -0.8, 0.5]]
    >>> detector = MCMDOutlierDetector(n_neighbors=30, random_state=0)
    >>> labels = detector.fit_predict(np.vstack([wall, car]))
    >>> print(f"{np.sum(labels[:40] == -1)} of 40 wall points swamped, "
    ...       f"{np.sum(labels[40:] == -1)} of 4 car points found")
    1 of 40 wall points swamped, 4 of 4 car points found
    """

    _parameter_constraints: ClassVar[dict] = {
        **BaseLocalPlanes._parameter_constraints,
        "method": [StrOptions({"mcmd_z", "mcmd_md"})],
    }

    def __init__(
        self,
        n_neighbors=50,
        *,
        method="mcmd_z",
        support_fraction=0.5,
        outlier_rate=0.5,
        success_probability=0.9999,
        cutoff=None,
        refine="reweight",
        random_state=None,
        n_jobs=None,
    ):
        self.n_neighbors = n_neighbors
        self.method = method
        self.support_fraction = support_fraction
        self.outlier_rate = outlier_rate
        self.success_probability = success_probability
        self.cutoff = cutoff
        self.refine = refine
        self.random_state = random_state
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X, y=None):
        """Store the cloud that points are scored against.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Coordinates, float64 or float32, in any unit; at least two features and
            ``n_features + 1`` points.
        y : Ignored

        Returns
        -------
        self : object

        Raises
        ------
        ValueError
            If X has NaN, infinite or too few values, or `n_neighbors` is too small.
        """
        self._fit_planes(X)
        self.offset_ = -self._cutoff
        return self

    def score_samples(self, X):
        """Opposite of the robust distance of each point to the plane of its neighborhood.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)

        Returns
        -------
        scores : ndarray of shape (n_samples,)
            In standard deviations of the plane's noise; at most 0, the lower, the more
            abnormal. Robust z-score (Eq. 17) or Mahalanobis distance (Eq. 18), negative.
        """
        check_is_fitted(self)
        X = self._check_queries(X)
        return -self._model.evaluate(X, saliency=False, n_jobs=self.n_jobs).distance

    def decision_function(self, X):
        """Score relative to the cutoff: negative for outliers.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)

        Returns
        -------
        decision : ndarray of shape (n_samples,)
            ``score_samples(X) - offset_``.
        """
        return self.score_samples(X) - self.offset_

    def predict(self, X):
        """Label points as inliers or outliers of the fitted cloud.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)

        Returns
        -------
        labels : ndarray of int of shape (n_samples,)
            1 for inliers, -1 for outliers.
        """
        return np.where(self.decision_function(X) >= 0, 1, -1)
