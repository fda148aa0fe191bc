"""MCMDOutlierDetector: outliers of the planes of local neighborhoods."""

from numbers import Integral, Real
from typing import ClassVar

import numpy as np

from sklearn_mcmd._sklearn import Interval, StrOptions, fit_context
from sklearn_mcmd._validation import FittedScoresMixin
from sklearn_mcmd.outliers._calibration import calibrated_cutoff
from sklearn_mcmd.outliers._iteration import IteratedPlanes
from sklearn_mcmd.planes._base import BasePlaneOutliers
from sklearn_mcmd.planes._progress import listen_to_progress, progress_part

__all__ = ["MCMDOutlierDetector"]

# Of the least of several distances and the greatest of two criteria.
JOINT_CUTOFF = 3.0


class MCMDOutlierDetector(FittedScoresMixin, BasePlaneOutliers):
    """Outliers by maximum consistency with minimum distance (MCMD).

    The detector finds the plane that most neighbors of a point agree on. It draws planes through
    random minimal subsets of the neighbors, and takes the ``h`` neighbors nearest to each. The
    set with the smallest least eigenvalue is the *maximum consistent set*. A point is an outlier
    if it is farther from that plane than the plane's own robust scale explains. Unlike a plane
    of least squares, this plane does not follow outliers while they are fewer than half of the
    neighbors.

    Parameters
    ----------
    n_neighbors : int or None, default=50
        Size of a neighborhood (k), at least ``n_features + 1``. A point of the fitted cloud
        is its own first neighbor. None means one neighborhood of all points (section 5.1 of
        the paper). Take None for data that are one plane.

    method : {"mcmd_z", "mcmd_md"}, default="mcmd_z"
        How the distance of a point is measured. "mcmd_z" takes the robust z-score of its
        orthogonal distance to the plane (Algorithm 2). "mcmd_md" takes the robust Mahalanobis
        distance (Algorithm 3), which also flags points far from the center within the plane.

    support_fraction : float in (0, 1] or "auto", default=0.5
        Share of a neighborhood that forms the consistent set, ``h = ceil(support_fraction *
        k)``. "auto" is ``1 - outlier_rate``. A value below 0.5 withstands more than half of
        outliers if these are not consistent with a plane themselves.

    outlier_rate : float in [0, 1) or "auto", default=0.5
        The largest share of outliers that a neighborhood must survive (epsilon in Eq. 13). It
        sets the number of trials, not how many points are removed. Too small a rate risks
        planes through outliers. "auto" withstands 0.5. In three dimensions it makes all trials,
        since compiled code screens them at once. From four dimensions on it makes fewer where
        the neighborhood itself shows that they suffice.

    success_probability : float in (0, 1), default=0.9999
        Probability that at least one minimal subset has no outlier (P_r). It sets the number of
        trials, together with `outlier_rate`.

    cutoff : float, default=None
        Robust distance beyond which a point is an outlier. None means 3, or with
        ``noise_scale="own"`` 2.5 for "mcmd_z" and the root of the 0.975 quantile of chi-squared
        with ``n_features`` degrees of freedom for "mcmd_md" (3.0575 in 3D).

    false_positive_rate : float in (0, 0.5), default=None
        Share of the points of a clean plane with Gaussian noise that may be flagged, at least
        1e-4 in 3D and 1e-3 otherwise. A simulation with the same settings and about the noise
        of X finds the cutoff. `cutoff` must then be None. The rate holds far from edges, and
        for no deviation but noise.

    refine : {"reweight"} or None, default="reweight"
        "reweight" refits plane and scale twice to the neighbors within 2.5 robust standard
        deviations. It keeps regular points that "mcmd_md" would lose, gives more accurate
        planes, and needs no knowledge of the outlier rate. None is the paper's form.

    max_iter : int, default=3
        Largest number of passes over the cloud. The first pass judges points by the whole cloud
        and retains the seeds, which are sure to be on a surface. Each later pass fits planes
        among the retained points and judges all points again, so the retained set grows back
        along the surfaces. The passes end when that set settles. 1 is one pass over all points.

    noise_scale : {"local", "own", "pooled"} or float, default="local"
        The standard deviation by which the distance to a plane is measured:

        - "local": that of the plane itself if the plane is credible, otherwise the usual one
          among the neighbors. For any cloud, curved, sparse or with foliage;
        - "own": that of the point's own neighborhood in any case, as in the paper;
        - "pooled": one for all points, the median of the retained points' planes. It is the
          most sensitive, but only for clouds of one noise and flat faces: it flags curvature,
          foliage and coarse spacing;
        - a number: the scanner's standard deviation, in units of X; otherwise as "pooled". It
          is the same thing as `sigma0` of `BaardaPlaneDetector`, the geodesists' name for it.

        All but "own" also flag points that stand apart: their neighbors are, on average, more
        than 2.4 times as far as is usual among these neighbors. They do not retain points that
        are sparser than the surfaces around them, or that form small groups.

    borrow : bool, default=True
        Whether a point beyond the cutoff of its own plane is measured by the nearest credible
        plane of its neighbors instead. Next to an edge, most of its own neighborhood may lie on
        the other face.

    keep_groups : bool or "auto", default="auto"
        Whether groups of points that no plane explains are kept if they are nearly as dense as
        the surfaces and not small: foliage, thin objects, small faces. Thin and flat groups may
        be sparser. Groups far from explained points must be denser. "auto" keeps groups with
        ``noise_scale="local"`` only.

    random_state : int, RandomState instance or None, default=None
        Seed of the one table of trials that all neighborhoods use.

    n_jobs : int, default=None
        Number of threads. None means 1 unless in a :obj:`joblib.parallel_config` context, and
        -1 means all processors. Results do not depend on it.

    Attributes
    ----------
    offset_ : float
        Negative of the cutoff: ``decision_function = score_samples - offset_``.

    scores_ : ndarray of shape (n_samples,)
        ``score_samples`` of the fitted points.

    n_neighbors_ : int
        Size of a neighborhood: `n_neighbors`, or the number of samples if that is smaller.

    n_support_ : int
        Points in a consistent set (h).

    n_trials_ : int
        Minimal subsets tried in each neighborhood (I_t), 69 with the defaults in 3D. The
        number doubles with each dimension; beyond 3D it is limited to 300, with a warning.

    n_iter_ : int
        Passes made.

    noise_scale_ : float
        The one standard deviation of the noise, in units of X. It is estimated if `noise_scale`
        is "pooled", or as given. Absent if each neighborhood has its own.

    plane_index_ : ndarray of int of shape (n_samples,)
        The row whose plane measured each fitted point: the point's own row, or that of the
        neighbor that lent its plane.

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
    `predict` scores new points against the fitted cloud, by the plane of the query's
    `n_neighbors` nearest points of the cloud. So ``fit_predict(X)`` equals
    ``fit(X).predict(X)``.

    ``MCMDOutlierDetector(refine=None, max_iter=1, noise_scale="own", borrow=False)`` is the
    paper's form. It is weak on whole clouds. The neighbors of an isolated outlier come from far
    apart, so the scale is large and the outlier passes. Outliers that lie together are planes to
    each other. The default asks more: a point is an inlier if a credible plane explains it, its
    own or a neighbor's, or if it lies in a dense group of such points. With ``n_neighbors=None``
    there is one pass and one plane. Only a number as `noise_scale` replaces the plane's scale.

    A neighborhood of exactly coplanar points has no scale. The rounding error of the coordinates
    is taken instead, and any point visibly off the plane is an outlier with a very large but
    finite distance. If the coordinates are rounded to a step, as in a file in centimeters, half
    a step is the least scale, so one step is no outlier. Copies of a point count once in a
    neighborhood. Points on one line or at one location are inliers among themselves, and a query
    away from them is an outlier. If the cloud holds fewer than `n_neighbors` distinct points, all
    of them are used, with a warning.

    The time grows as ``n_samples * n_trials_ * n_neighbors`` and as ``n_samples *
    log(n_samples)`` for the search, in each pass for the neighborhoods that have changed. In
    `fit` the memory beyond the cloud is about ``290 + 4 * n_neighbors`` bytes a point, 490 MB
    for a million; with ``noise_scale="own"`` in one pass it is bounded. In 3D and from
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
    0 of 40 wall points swamped, 4 of 4 car points found
    """

    _parameter_constraints: ClassVar[dict] = {
        **BasePlaneOutliers._parameter_constraints,
        "method": [StrOptions({"mcmd_z", "mcmd_md"})],
        "max_iter": [Interval(Integral, 1, None, closed="left")],
        "noise_scale": [
            StrOptions({"own", "local", "pooled"}),
            Interval(Real, 0, None, closed="neither"),
        ],
        "borrow": ["boolean"],
        "false_positive_rate": [Interval(Real, 0, 0.5, closed="neither"), None],
        "keep_groups": ["boolean", StrOptions({"auto"})],
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
        false_positive_rate=None,
        refine="reweight",
        max_iter=3,
        noise_scale="local",
        borrow=True,
        keep_groups="auto",
        random_state=None,
        n_jobs=None,
    ):
        self.n_neighbors = n_neighbors
        self.method = method
        self.support_fraction = support_fraction
        self.outlier_rate = outlier_rate
        self.success_probability = success_probability
        self.cutoff = cutoff
        self.false_positive_rate = false_positive_rate
        self.refine = refine
        self.max_iter = max_iter
        self.noise_scale = noise_scale
        self.borrow = borrow
        self.keep_groups = keep_groups
        self.random_state = random_state
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X, y=None):
        """Judge the points of a cloud, and keep what new points are scored against.

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
            If X has NaN, infinite or too few values, or `n_neighbors` is too small; if
            `cutoff` and `false_positive_rate` are both given, or the rate is out of reach.
        """
        if self.cutoff is not None and self.false_positive_rate is not None:
            raise ValueError(
                f"cutoff={self.cutoff} and false_positive_rate={self.false_positive_rate} exclude "
                "each other: leave one of them None."
            )
        X = self._fit_planes(X)
        cutoff = self._cutoff
        own_ruler = self.noise_scale == "own" or (
            self.n_neighbors is None and self.noise_scale == "local"
        )
        if self.cutoff is None and not own_ruler:
            cutoff = JOINT_CUTOFF
        keep_groups = self.keep_groups
        if keep_groups == "auto":
            keep_groups = self.noise_scale == "local"
        settings = {
            "noise_scale": self.noise_scale,
            "borrow": self.borrow,
            "keep_groups": keep_groups,
            "cutoff": cutoff,
            "max_iter": self.max_iter,
            "n_jobs": self.n_jobs,
        }
        begin = 0.0
        if self.false_positive_rate is not None:
            begin = 0.5  # for the display of progress
            with progress_part(0.0, begin, "cutoff by simulation"), listen_to_progress(None):
                cutoff = calibrated_cutoff(self._model, settings, self.false_positive_rate)
        self._cloud = IteratedPlanes(self._model, verdict=cutoff, **settings)
        with progress_part(begin, 1.0, "outliers"):
            self._cloud.fit(X.astype(np.float64, copy=False))
        self.n_iter_ = self._cloud.n_iter
        if self._cloud.noise_scale_found is not None:
            self.noise_scale_ = self._cloud.noise_scale_found
        self.plane_index_ = self._cloud.plane_index
        self.scores_ = -self._cloud.scores
        self.offset_ = -cutoff
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
        return super().score_samples(X)

    def _score(self, X):
        return self._cloud.score(X)
