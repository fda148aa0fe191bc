"""MCMDOutlierDetector: outliers of the planes of local neighborhoods."""

from numbers import Real
from typing import ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._choices import OutlierMethod, Strictness, choices_of
from sklearn_mcmd._errors import ParameterError, warn_caller
from sklearn_mcmd._sklearn import Interval, StrOptions, fit_context
from sklearn_mcmd._validation import check_sensor_origin, is_auto
from sklearn_mcmd.outliers._calibration import calibrated_cutoff
from sklearn_mcmd.outliers._intensity import ranks_of_intensity
from sklearn_mcmd.outliers._model import JudgeSettings, Sensed, judge, n_by_rays
from sklearn_mcmd.outliers._off_surface import OffSurfaceLimits
from sklearn_mcmd.planes._base import BasePlaneOutliers
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._whole import whole_cloud
from sklearn_mcmd.runtime._progress import heard_by, progress_part
from sklearn_mcmd.sensors._recognition import origin_if_seen

# Score, in standard deviations, that measured noise never reaches, only the rounding of floats.
EXACT_PLANE_SCORE = 1e6
MANY_EXACT = 0.01  # share of points with more than that score, which is warned of
MANY_OF_A_PLAN = 0.2  # share of outliers in 2D, which is warned of; profiles have fewer
EXACTLY = "are outliers only because most of their neighbors lie exactly in one plane"


class MCMDOutlierDetector(BasePlaneOutliers):
    """Outliers of a point cloud: points that lie on no surface and keep no company (MCMD).

    The detector finds the plane that most neighbors of a point agree on. It draws planes through
    random minimal subsets of the neighbors, and takes the ``h`` neighbors nearest to each. The
    set with the smallest least eigenvalue is the *maximum consistent set*. A point is an outlier
    if it is farther from that plane than the plane's own robust scale explains. Unlike a plane
    of least squares, this plane does not follow outliers while they are fewer than half of the
    neighbors. By default neighbors then :ref:`agree on planes <agreement>`, so that little is left
    to chance.

    The paper judges each point by that plane alone. On whole clouds this is weak: what lies in
    foliage, on a wire or next to an edge has no good plane of its own, and outliers that lie
    together have one. The default therefore asks three questions:

    1. **Is the point on a surface?** A surface is a large connected set of points whose flat
       planes explain each other. Its density plays no part. The distance to the nearest such
       plane is measured in standard deviations of its noise.
    2. **Is the point isolated?** The points that no surface explains are the rest: foliage,
       wires, small things, and errors. A point of the rest is isolated by its distance to
       its neighbors, in usual spacings of the surfaces around.
    3. **Does its group stand off?** Points of the rest near each other form groups. A small group
       stands off by its gap to everything real, in sizes of its own. :ref:`steps` says what a group
       is, also of wires, of many points and of things in pieces.

    The score is the least of the answers that excuses the point, so 3 means: three standard
    deviations off the surfaces, and three of its own sizes away from anything that is real.

    Parameters
    ----------
    n_neighbors : int or None, default=50
        Size of a neighborhood (k), at least ``n_features + 1``. A point of the fitted cloud
        is its own first neighbor. None means one neighborhood of all points (section 5.1 of
        the paper). Take None for data that are one plane. Fewer than 20 say little about the
        noise: at 10, ``strictness="surfaces"`` takes 1 to 4 % of a clean plane.

    strictness : {"isolated", "groups", "surfaces"} or None, default="groups"
        What is taken for an outlier:

        - "isolated": single points, and a few together, that stand off from everything;
        - "groups": small groups that stand off as well, such as ghosts of a few dozen points,
          birds or dust. Foliage, wires and small things that touch others are kept;
        - "surfaces": everything that lies on no surface. For streets, facades and rooms of which
          only the faces are wanted. Foliage, thin posts and half of the wires go;
        - None: as in the paper, every point by the plane of its own neighborhood alone.

        Of the first three, each flags all that the one before flags. With ``n_neighbors=None``
        there is one plane, and no such question.

    cutoff : float, default=None
        Score beyond which a point is an outlier. It changes no score. None means 3; with
        ``strictness=None`` or ``n_neighbors=None`` 2.5 for "mcmd_z" and 3.06 in 3D for "mcmd_md",
        see :ref:`the defaults <cutoffs>`. 10 asks for gross errors only: ten standard deviations
        off the surfaces, and ten usual spacings from any company.

    contamination : float in (0, 0.5] or "auto", default=None
        Share of the fitted points to flag: those of the worst scores. At most one of `cutoff`,
        `false_positive_rate` and `contamination` may be given. "auto", as other detectors have it,
        is None: the cutoff tells.

    false_positive_rate : float in (0, 0.5), default=None
        Share of the points on surfaces that noise may flag, at least 1e-4 in 3D and 1e-3
        otherwise. The cutoff is that of a simulated plane with the noise of X. Thin and sparse
        things may lose more. See :ref:`false_positive_rate`.

    sensor_origin : array-like of shape (n_features,), "origin", "auto" or None, default=None
        Where the sensor stood, in units of X. "origin" is the origin of the coordinates, where
        a turn of a spinning scanner or a depth image has it. "auto" takes the origin if the cloud
        shows that it was taken from there, see :ref:`recognized`, and else None. `fit` takes a
        position for each point; under "auto" that is not used where it would condemn surfaces, see
        :ref:`stated`. With it rays tell, too, see :ref:`sensor`; None goes by coordinates alone.

    noise_scale : float, default=None
        The scanner's standard deviation, in units of X, by which distances to planes are then
        measured. It is the same thing as `sigma0` of `BaardaPlaneDetector`, the geodesists' name
        for it. None measures each plane by the noise of its own neighborhood. That also
        holds where noise grows with the range, and on curved surfaces.

    max_outlier_rate : float in [0, 1), default=0.5
        The largest share of outliers that a neighborhood must survive (epsilon in Eq. 13). It
        sets the number of trials that are drawn before neighbors are asked, not how many points
        are removed. Too small a rate risks planes through outliers.

    success_probability : float in (0, 1), default=0.9999
        Probability that at least one minimal subset has no outlier (P_r). It sets the number of
        trials, together with `max_outlier_rate`.

    support_fraction : float in (0, 1], default=0.5
        Share of a neighborhood that forms the consistent set, ``h = ceil(support_fraction *
        k)``. A value below 0.5 withstands more than half of outliers if these are not
        consistent with a plane themselves. Where neighbors agree, all others may be off the plane
        that is kept.

    method : {"mcmd_z", "mcmd_md"}, default="mcmd_z"
        How a plane leaves out its outliers. "mcmd_z" takes the robust z-score of the
        orthogonal distance to the plane (Algorithm 2). "mcmd_md" takes the robust Mahalanobis
        distance (Algorithm 3), which also leaves out points far from the center within the
        plane. With ``strictness=None`` that is the verdict, too.

    reweight : bool, default=True
        Whether plane and scale are refitted twice to the neighbors within 2.5 robust standard
        deviations, and neighbors :ref:`agree on planes <agreement>`. It keeps regular points that
        "mcmd_md" would lose, gives more accurate planes, and needs no knowledge of the share of
        outliers. With ``strictness=None``, with ``n_neighbors=None`` and beyond 3D no neighbor is
        asked. False is the paper's form.

    random_state : int, RandomState instance or None, default=None
        Seed of the one table of trials that all neighborhoods use. It decides little where
        neighbors :ref:`agree on planes <agreement>`.

    n_jobs : int, default=None
        Number of threads. None means 1 unless in a :obj:`joblib.parallel_config` context, and
        -1 means all processors. Results do not depend on it.

    Attributes
    ----------
    labels_ : ndarray of int of shape (n_samples,)
        1 for the fitted points that are real, and -1 for outliers: as `fit_predict` returns.

    offset_ : float
        Negative of the cutoff: ``decision_function = score_samples - offset_``.

    scores_ : ndarray of shape (n_samples,)
        ``score_samples`` of the fitted points.

    on_surface_ : ndarray of bool of shape (n_samples,)
        Whether a surface explains each fitted point, at 3 standard deviations. The others are
        the rest, which is judged by its company.

    isolation_, separation_ : ndarray of shape (n_samples,) or None
        How far each fitted point is from others, in usual spacings, and its group from all that is
        real, in its sizes; with `sensor_origin`, as rays tell. The separation is 0 on surfaces and
        of things. None where each point is judged by one plane alone.

    group_index_ : ndarray of int of shape (n_samples,) or None
        Its group, from 0 on in the order of their first points, or -1 on surfaces. A point alone
        is a group. None where `isolation_` is.

    plane_index_ : ndarray of int of shape (n_samples,)
        The row whose plane measured each fitted point: the point's own row, or that of the
        neighbor on a surface that lent its plane.

    sensor_origin_ : ndarray of shape (n_features,) or None
        The one position of the sensor that was used, given or recognized; None where none was
        known or used, or one for each point.

    n_by_rays_ : int
        Fitted points that rays alone flag: coordinates alone would keep them.

    n_neighbors_ : int
        Size of a neighborhood: `n_neighbors`, or the number of samples if that is smaller.

    n_support_ : int
        Points in a consistent set (h).

    n_trials_ : int
        Minimal subsets tried in a neighborhood (I_t), unless it has noise alone and neighbors
        agree, 69 with the defaults in 3D. The number doubles with each dimension; beyond 3D it
        is limited to 300, with a warning.

    n_features_in_, feature_names_in_ : int and ndarray of str of shape (`n_features_in_`,)
        Number of features seen during `fit`, and their names, if all are strings.

    See Also
    --------
    RobustNormalEstimator : Normals and curvature from the same planes.
    sklearn.neighbors.LocalOutlierFactor : By density, as PDAL's ``filters.lof``. Open3D's
        ``remove_statistical_outlier`` and PDAL's ``filters.outlier`` go by mean distances.

    Notes
    -----
    ``MCMDOutlierDetector(reweight=False, strictness=None)`` is the paper's form.

    No threshold depends on the verdict. The score is a continuous function of the coordinates
    almost everywhere: moving, turning or scaling the cloud changes it by rounding errors only.

    `predict` scores new points by the surfaces and the rest of the fitted cloud, each as if it
    alone were added and measured from where the nearest of the fitted points was. A point of the
    fitted cloud keeps its score, so ``fit_predict(X)`` equals ``fit(X).predict(X)``.

    A surface has at least as many points as a neighborhood, and a thing twice as many. In clouds of
    fewer than ``10 * n_neighbors`` points a fifth of the cloud will do. Where there is no surface
    at all, or the cloud is no larger than one neighborhood, ``strictness="surfaces"`` judges by
    company, as "groups" does.

    :ref:`degenerate` says what exact planes, rounded coordinates and copies of points do. If the
    cloud holds fewer than `n_neighbors` distinct points, all of them are used, with a warning. From
    4,097 of them on so many neighbors are refused.

    The time grows as ``n_samples * n_neighbors * (n_trials_ + n_neighbors)``, since each point
    may try the planes of all its neighbors, and as ``n_samples * log(n_samples)`` for the search.
    In `fit` the memory beyond the cloud is about ``200 + 2 * n_neighbors`` bytes a point if a tenth
    of the points lie off the surfaces, 300 MB for a million.

    References
    ----------
    .. [1] A. Nurunnabi, G. West, D. Belton, "Outlier detection and robust normal-curvature
       estimation in mobile laser scanning 3D point cloud data", Pattern Recognition 48
       (2015) 1404-1419, Algorithms 1 to 3.
    .. [2] P. Rousseeuw, V. Yohai, "Robust regression by means of S-estimators", in: Robust and
       Nonlinear Time Series Analysis, Lecture Notes in Statistics 26 (1984) 256-272, for the
       planes on which neighbors agree.

    Examples
    --------
    A wall with four points that a passing car left in front of it:

    >>> import numpy as np
    >>> from sklearn_mcmd import MCMDOutlierDetector
    >>> rng = np.random.default_rng(0)
    >>> wall = rng.uniform(0, 2, (600, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (600, 3))
    >>> car = [[0.5, -0.8, 0.4], [0.6, -0.8, 0.4], [0.5, -0.8, 0.5], [0.6, -0.8, 0.5]]
    >>> detector = MCMDOutlierDetector(random_state=0)
    >>> labels = detector.fit_predict(np.vstack([wall, car]))
    >>> print(f"{np.sum(labels[:600] == -1)} of 600 wall points swamped, "
    ...       f"{np.sum(labels[600:] == -1)} of 4 car points found")
    0 of 600 wall points swamped, 4 of 4 car points found
    """

    _parameter_constraints: ClassVar[dict] = {
        **BasePlaneOutliers._parameter_constraints,
        "method": [StrOptions(choices_of(OutlierMethod))],
        "strictness": [StrOptions(choices_of(Strictness)), None],
        "noise_scale": [Interval(Real, 0, None, closed="neither"), None],
        "sensor_origin": ["array-like", StrOptions({"origin", "auto"}), None],
        "false_positive_rate": [Interval(Real, 0, 0.5, closed="neither"), None],
        "contamination": [Interval(Real, 0, 0.5, closed="right"), StrOptions({"auto"}), None],
    }

    def __init__(
        self,
        n_neighbors: int | None = 50,
        *,
        method: OutlierMethod = "mcmd_z",
        strictness: Strictness | None = "groups",
        support_fraction: float = 0.5,
        max_outlier_rate: float = 0.5,
        success_probability: float = 0.9999,
        cutoff: float | None = None,
        false_positive_rate: float | None = None,
        contamination: float | Literal["auto"] | None = None,
        reweight: bool = True,
        noise_scale: float | None = None,
        sensor_origin: 'ArrayLike | Literal["origin", "auto"] | None' = None,
        random_state: int | np.random.RandomState | None = None,
        n_jobs: int | None = None,
    ) -> None:
        self.n_neighbors = n_neighbors
        self.method = method
        self.strictness = strictness
        self.support_fraction = support_fraction
        self.max_outlier_rate = max_outlier_rate
        self.success_probability = success_probability
        self.cutoff = cutoff
        self.false_positive_rate = false_positive_rate
        self.contamination = contamination
        self.reweight = reweight
        self.noise_scale = noise_scale
        self.sensor_origin = sensor_origin
        self.random_state = random_state
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=True)
    def fit(
        self,
        X: "ArrayLike",
        y: object = None,
        sensor_origin: 'ArrayLike | Literal["origin", "auto"] | None' = None,
        intensity: "ArrayLike | None" = None,
    ) -> Self:
        """Judge the points of a cloud, and keep what new points are scored against.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Coordinates, float64 or float32, in any unit; at least two features and
            ``n_features + 1`` points.
        y : Ignored
        sensor_origin : "origin", "auto", or array-like, (n_features,) or (n_samples, n_features)
            Where the sensor stood, for each point where it moved; in place of the parameter. A
            pipeline passes it on after ``set_fit_request(sensor_origin=True)``.
        intensity : array-like of shape (n_samples,)
            How much light came back, in any unit, see :ref:`intensity`. It passes as positions do.

        Returns
        -------
        self : object

        Raises
        ------
        ValueError
            If X has NaN, infinite or too few values, or `n_neighbors` is too small; if more
            than one of `cutoff`, `false_positive_rate` and `contamination` is given, or the
            rate is out of reach; if `sensor_origin` or `intensity` has another shape or NaN, or
            there is no strictness to use it; or if the sensor stood where all points are.
        """
        self._check_choices(sensor_origin, intensity)
        xyz = self._fit_planes(X)
        self._warn_if_crowded(xyz.shape[1])
        origins, position, doubted = self._origins(xyz, sensor_origin)
        ranks = ranks_of_intensity(intensity, self._model.index, len(xyz))
        cutoff, begin = self._cutoff()
        sensed = Sensed(origins=origins, doubted=doubted, intensity=ranks)
        xyz = xyz.astype(np.float64, copy=False)
        with progress_part(begin, 1.0):
            self._cloud, judgement = judge(self._model, xyz, self._settings(), sensed)
        self.plane_index_, self.on_surface_ = judgement.plane_index, judgement.on_surface
        self.isolation_, self.separation_ = judgement.isolation, judgement.separation
        self.group_index_ = judgement.group_index
        self.scores_ = np.negative(judgement.scores, out=judgement.scores)
        self.offset_ = -cutoff
        if (share := share_to_flag(self)) is not None:
            self.offset_ = float(np.quantile(self.scores_, share))
        self.n_by_rays_ = n_by_rays(self._cloud.raised.scores, -self.offset_)
        self.sensor_origin_ = None if self._cloud.rays is None else position
        self._warn_if_plan()
        return self

    @property
    def _one_plane(self):
        """Whether each point is judged by one plane alone."""
        return self.strictness is None or self.n_neighbors is None

    def _settings(self):
        return JudgeSettings(self.strictness, self.noise_scale, self.n_jobs)

    def _check_choices(self, sensor_origin, intensity):
        """Raise where parameters exclude each other."""
        ways = {
            name: getattr(self, name)
            for name in ("cutoff", "false_positive_rate", "contamination")
            if getattr(self, name) not in (None, "auto")
        }
        if len(ways) > 1:
            raise ValueError(
                " and ".join(f"{name}={value}" for name, value in ways.items())
                + " exclude each other: leave all but one of them None."
            )
        origin = self.sensor_origin if sensor_origin is None else sensor_origin
        values = {"sensor_origin": None if is_auto(origin) else origin, "intensity": intensity}
        for name, value in values.items() if self._one_plane else ():
            if value is not None:
                lacks = ["$n_neighbors"] * (self.n_neighbors is None)
                lacks += ["a $strictness other than the paper's"] * (self.strictness is None)
                raise ParameterError(
                    f"${name} has no meaning where each point is judged by one plane alone: give "
                    f"{' and '.join(lacks)}, or leave ${name} out."
                )

    def _warn_if_crowded(self, d):
        """Warn where company is judged in so many dimensions that it is everywhere."""
        by_company = not self._one_plane and self.strictness != "surfaces"
        if by_company and share_to_flag(self) is None and d >= OffSurfaceLimits().crowded:
            warn_caller(
                f"strictness={self.strictness!r} in {d}D finds few outliers: so many "
                'dimensions leave no point alone. Give strictness="surfaces", by which distances '
                "from planes alone tell."
            )

    def _warn_if_plan(self):
        """Warn where two columns are likely to be a plan, in which walls and ground are mixed."""
        share = np.mean(self.labels_ == -1)
        chosen = self._one_plane or self.cutoff is not None or share_to_flag(self) is not None
        if self.n_features_in_ == 2 and share > MANY_OF_A_PLAN and not chosen:
            warn_caller(
                f"{100 * share:.0f} % of the points are outliers in 2D. If X is a plan, its "
                "surfaces overlap: give heights as a third column."
            )

    def _origins(self, xyz, sensor_origin):
        """Where the sensor was for each point of the index; the one position, if there is one; and
        whether it is doubted."""
        doubted = is_auto(sensor_origin) or is_auto(self.sensor_origin)
        if sensor_origin is None:
            sensor_origin = self.sensor_origin
        if is_auto(sensor_origin):
            whole = whole_cloud()
            if self._one_plane:
                sensor_origin = None
            elif whole is None:
                sensor_origin = origin_if_seen(xyz)
            else:
                sensor_origin = "origin" if whole.seen else None
        origins = check_sensor_origin(sensor_origin, xyz)
        if origins is None:
            return None, None, doubted
        rows = self._model.index.rows
        if np.shape(sensor_origin) == xyz.shape:
            return origins[rows], None, doubted
        position = origins[0].copy()
        return np.broadcast_to(position, (len(rows), len(position))), position, doubted

    def _cutoff(self):
        """The cutoff, and the share of the time after which it is known."""
        if self.false_positive_rate is not None:
            begin = 0.4  # for the display of progress
            with progress_part(0.0, begin, "cutoff by simulation"), heard_by(None):
                rate = self.false_positive_rate
                return calibrated_cutoff(self._model, self._settings(), rate), begin
        if self.cutoff is not None:
            return self.cutoff, 0.0
        return self._model.settings.cutoff if self._one_plane else ExplainLimits().explained, 0.0

    def score_samples(self, X: "ArrayLike") -> NDArray[np.float64]:
        """Opposite of how far each point is off the surfaces and stands off from all else.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Each new point counts as measured from where the nearest of the fitted points was.

        Returns
        -------
        scores : ndarray of shape (n_samples,)
            At most 0; the lower, the more abnormal. Down to -3 the point is on a surface, or
            keeps company. -10 means ten standard deviations off the surfaces and ten usual
            spacings, or sizes of its group, away from what is real; -100 is a gross error.
            With ``strictness=None`` the robust z-score (Eq. 17) or Mahalanobis distance
            (Eq. 18), negative.
        """
        return super().score_samples(X)

    def _score(self, X):
        return self._cloud.score(X)


def share_to_flag(detector: MCMDOutlierDetector) -> float | None:
    """The share of points that a detector flags, None if the cutoff tells."""
    return None if isinstance(detector.contamination, str) else detector.contamination


def judged_cloud(detector):
    """The `JudgedCloud` of a fitted detector, `OwnPlanesCloud` of one that asks no surfaces."""
    return detector._cloud
