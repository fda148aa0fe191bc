"""CloudChange: what has moved between two clouds of one place, and how surely."""

from numbers import Integral, Real
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from joblib import effective_n_jobs
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.special import erfc, ndtri
from scipy.stats import false_discovery_control
from sklearn.base import BaseEstimator
from sklearn.utils import check_array
from sklearn.utils.validation import check_is_fitted

from sklearn_mcmd._choices import ChangeCorrection, choices_of
from sklearn_mcmd._errors import ParameterError, warn_caller
from sklearn_mcmd._sklearn import DocLinkMixin, Interval, StrOptions, fit_context
from sklearn_mcmd._validation import check_extent, check_sizes, validate_points
from sklearn_mcmd.change._bodies import Bodies, moved_bodies, moves_of
from sklearn_mcmd.change._distances import Surfaces, alike_ratio, on_known_sides
from sklearn_mcmd.normals._estimator import RobustNormalEstimator
from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._explaining import ExplainLimits

FEWEST = 15  # neighbors, of which a plane and its noise are told
WIDEST = 4  # times as many neighbors of a denser second cloud, at most
ALIKE = 0.1  # of the density, within which those of two clouds are equal
SAMPLE = 1_000  # points that tell how wide neighborhoods are
REASONS = ("compared", "nothing within reach", "no surface", "another surface")


class ChangeLimits(NamedTuple):
    """What can be compared."""

    reach: float = 10.0  # usual radii of a neighborhood, within which a surface is looked for
    turned: float = 45.0  # degrees between normals of one surface, at most


class Changes(NamedTuple):
    """What has moved, a row for each core point, as of `CloudChange.compare`.

    Attributes
    ----------
    distance : ndarray of shape (n_core,)
        From the first surface to the second along the first one's normal, in units of X; not a
        number where nothing can be compared.
    distance_error : ndarray of shape (n_core,)
        Its standard error.
    level_of_detection : ndarray of shape (n_core,)
        Beyond which one distance alone is significant.
    pvalue : ndarray of shape (n_core,)
        After the `correction`.
    significant : ndarray of bool of shape (n_core,)
        Whether that is below `alpha`.
    reason : ndarray of uint8 of shape (n_core,)
        0 compared; 1 nothing within reach; 2 no surface, as in leaves; 3 another surface, whose
        normal is turned by more than 45 degrees.
    alike : float
        By how much noise that is alike nearby multiplies variances, 1 at least; not a number where
        the first cloud is too small to tell.
    bodies : Bodies or None
        With ``registration="auto"`` those of :func:`~sklearn_mcmd.change.moved_bodies`.
    """

    distance: NDArray[np.float64]
    distance_error: NDArray[np.float64]
    level_of_detection: NDArray[np.float64]
    pvalue: NDArray[np.float64]
    significant: NDArray[np.bool_]
    reason: NDArray[np.uint8]
    alike: float
    bodies: Bodies | None


class CloudChange(DocLinkMixin, BaseEstimator):
    """Distances between two clouds of one place, with a level of detection that holds.

    `fit` takes the first cloud and `compare` the second. For each point of the first, the distance
    is that between the robust planes of both clouds, along the normal of the first. These planes
    hold neither outliers nor points across an edge.

    `compare` is no `transform`: scikit-learn's rows depend on nothing but themselves and what was
    fitted, and a row here depends on all points of the second cloud around it.

    Parameters
    ----------
    n_neighbors : int, default=50
        Size of the neighborhoods of the first cloud, as of :class:`RobustNormalEstimator`, 15 at
        least. Those of the second have as many points as make them as wide.

    registration : float, array-like of shape (6, 6), "auto" or None, default=None
        How well both clouds are registered: a standard error in units of X; or the covariance of
        three shifts, in units of X, and three turns, in radians, about the mean of the first
        cloud; or "auto", by the motion that most flat surfaces of both clouds have in common (see
        :func:`~sklearn_mcmd.change.moved_bodies`), as far as it is from none. None takes them for
        exact.

    alpha : float in (0, 1), default=0.05
        Level of the tests.

    correction : {"fdr", "sidak", "none"}, default="fdr"
        What `alpha` is: of the points that are called moved, the share that is not, on average
        (Benjamini and Hochberg); the chance that any point is called moved though none is; or the
        share of unmoved points that is called moved.

    reach : float, default=None
        Largest distance from a core point to the second cloud, in units of X. None means ten times
        the usual radius of a neighborhood.

    random_state : int, RandomState instance or None, default=None
        Seed of the trials of both clouds.

    n_jobs : int, default=None
        Number of threads. None means 1 unless in a :obj:`joblib.parallel_config` context, and
        -1 means all processors. Results do not depend on it.

    Attributes
    ----------
    normals_ : ndarray of shape (n_samples, n_features)
        Unit normals of the first cloud, along which distances are positive: up; of what is steeper
        than 80 degrees to +y, or to +x if that goes within 10 degrees along y.

    n_features_in_ : int
        Number of features seen during `fit`.

    feature_names_in_ : ndarray of shape (`n_features_in_`,)
        Names of features seen during `fit`, when X has names that are all strings.

    See Also
    --------
    sklearn_mcmd.change.moved_bodies : Which flat surfaces moved, each as a whole.
    sklearn_mcmd.adjustment.compare_planes : Two planes, by their points.

    Notes
    -----
    The variance of a distance is that of both planes at the core point: of their means, and of
    their tilts beside their middles. Noise that is alike nearby, as in a scanner's rows, is in
    neither. It is found where distances of places that share no points differ by more than that,
    and multiplies all variances by `alike`. What moves as a body differs by nothing, so a movement
    is not taken for noise. What is alike over more than eight radii of a neighborhood, and the
    registration, look like a movement: give `registration`.

    Distances follow M3C2 [1]_, whose level of detection takes noise for independent and whose
    cylinders take what is in them. ``correction="fdr"`` is that of [2]_.

    References
    ----------
    .. [1] D. Lague, N. Brodu, J. Leroux, "Accurate 3D comparison of complex topography with
       terrestrial laser scanner", ISPRS Journal of Photogrammetry and Remote Sensing 82 (2013)
       10-26.
    .. [2] Y. Benjamini, Y. Hochberg, "Controlling the false discovery rate", Journal of the Royal
       Statistical Society B 57 (1995) 289-300.

    Examples
    --------
    A wall is scanned twice, and one half has moved by 4 mm in between:

    >>> import numpy as np
    >>> from sklearn_mcmd.change import CloudChange
    >>> rng = np.random.default_rng(0)
    >>> before, after = rng.uniform(0, 1, (2, 3000, 3)) * [4, 2, 0]
    >>> before, after = (xyz + rng.normal(0, 0.002, (3000, 3)) for xyz in (before, after))
    >>> after[after[:, 0] > 2, 2] += 0.004
    >>> changes = CloudChange(random_state=0).fit(before).compare(after)
    >>> moved, stayed = before[:, 0] > 2.2, before[:, 0] < 1.8
    >>> print(f"{changes.significant[moved].mean():.2f} {changes.significant[stayed].mean():.2f}")
    1.00 0.04
    >>> print(f"{1000 * np.nanmedian(changes.distance[moved]):.1f} mm")
    4.0 mm
    """

    _parameter_constraints: ClassVar[dict] = {
        "n_neighbors": [Interval(Integral, FEWEST, None, closed="left")],
        "registration": [
            Interval(Real, 0, None, closed="left"),
            "array-like",
            StrOptions({"auto"}),
            None,
        ],
        "alpha": [Interval(Real, 0, 1, closed="neither")],
        "correction": [StrOptions(choices_of(ChangeCorrection))],
        "reach": [Interval(Real, 0, None, closed="neither"), None],
        "random_state": ["random_state"],
        "n_jobs": [Integral, None],
    }

    def __init__(
        self,
        n_neighbors: int = 50,
        *,
        registration: 'float | ArrayLike | Literal["auto"] | None' = None,
        alpha: float = 0.05,
        correction: ChangeCorrection = "fdr",
        reach: float | None = None,
        random_state: int | np.random.RandomState | None = None,
        n_jobs: int | None = None,
    ) -> None:
        self.n_neighbors = n_neighbors
        self.registration = registration
        self.alpha = alpha
        self.correction = correction
        self.reach = reach
        self.random_state = random_state
        self.n_jobs = n_jobs

    @fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: "ArrayLike", y: object = None) -> Self:
        """Find the surfaces of the first cloud.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Coordinates in any unit.
        y : Ignored

        Returns
        -------
        self : object
        """
        xyz = validate_points(self, X, ensure_min_features=2)
        check_sizes(len(xyz), xyz.shape[1], self.n_neighbors)
        check_extent(xyz)
        self._check_registration(xyz.shape[1])
        self._before = self._surfaces_of(xyz, self.n_neighbors)
        self.normals_ = self._before.normals
        return self

    def compare(self, X: "ArrayLike", core: "ArrayLike | None" = None) -> Changes:
        """Compare the first cloud with a second one.

        Parameters
        ----------
        X : array-like of shape (n_points, n_features)
            The second cloud, in the coordinate system and the unit of the first.
        core : array-like of shape (n_core, n_features), default=None
            Where the clouds are compared, near the first. None takes its points.

        Returns
        -------
        changes : Changes
            A named tuple of arrays.

        Raises
        ------
        ValueError
            If the clouds lie nowhere within reach of each other.

        Warns
        -----
        UserWarning
            If the clouds are equal, if one is far sparser, or if most points have nothing in reach.
        """
        check_is_fitted(self)
        covariance = self._check_registration(self.n_features_in_)
        after = validate_points(self, X, reset=False)
        check_sizes(len(after), after.shape[1], self.n_neighbors)
        check_extent(after)
        places = None
        if core is not None:
            places = check_array(core, dtype=np.float64, input_name="core")
            if places.shape[1] != self.n_features_in_:
                raise ValueError(
                    f"core has {places.shape[1]} columns, the clouds {self.n_features_in_}."
                )
        usual = float(np.median(self._before.planes.radius))
        reach = ChangeLimits().reach * usual if self.reach is None else self.reach
        n_jobs = effective_n_jobs(self.n_jobs)
        _check_overlap(self._before.xyz, after, reach)
        second = self._surfaces_of(after, _as_wide(after, usual, self.n_neighbors, n_jobs))
        _warn_of_pair(self._before, second, usual)
        whole = self._measure(self._before.xyz, second, reach, n_jobs)
        # A point off its own surface is no place of it.
        planes = self._before.planes
        is_off = np.abs(whole.height) > ExplainLimits().explained * planes.scale
        whole.reason[is_off & (whole.reason == 0) & (planes.scale > 0)] = 2
        whole.distance[whole.reason > 0] = np.nan
        alike = alike_ratio(
            self._before.xyz, self.normals_, planes.radius, whole.distance, whole.variance
        )
        if places is None:
            places, measured = self._before.xyz, whole
        else:
            measured = self._measure(places, second, reach, n_jobs)
        if np.mean(measured.reason == 1) > 0.5:
            warn_caller(
                f"{np.mean(measured.reason == 1):.0%} of the core points have nothing of both "
                f"clouds within a reach of {reach:.3g}: do both cover one place, in one unit?"
            )
        bodies = None
        if isinstance(covariance, str):
            bodies = moved_bodies(
                self._before.xyz,
                after,
                alpha=self.alpha,
                random_state=self.random_state,
                n_jobs=self.n_jobs,
            )
            covariance = np.outer(bodies.motion, bodies.motion) + bodies.motion_covariance
        variance = measured.variance * (1.0 if np.isnan(alike) else alike)
        variance += self._registered(covariance, places, measured.normals)
        error = np.where(measured.reason == 0, np.sqrt(variance), np.nan)
        pvalue = self._pvalues(measured.distance, error)
        return Changes(
            distance=measured.distance,
            distance_error=error,
            level_of_detection=-ndtri(self.alpha / 2) * error,
            pvalue=pvalue,
            significant=pvalue < self.alpha,
            reason=measured.reason,
            alike=alike,
            bodies=bodies,
        )

    def _measure(self, places, second, reach, n_jobs):
        """The `_Measured` at places, by the planes of both clouds alone."""
        before = self._before
        rows, is_near = np.arange(len(places)), np.ones(len(places), bool)
        if places is not before.xyz:
            rows, is_near = before.nearest(places, reach, n_jobs)
        others, are_near = second.nearest(places, reach, n_jobs)
        normals = before.normals[rows]
        reason = _reasons(before, rows, second, others, places, is_near & are_near)
        near, own = before.heights(rows, places, normals)
        far, theirs = second.heights(others, places, normals)
        return _Measured(
            distance=np.where(reason == 0, far - near, np.nan),
            variance=own + theirs,
            height=near,
            normals=normals,
            reason=reason,
        )

    def _check_registration(self, d):
        """The parameter as a number, a covariance (6, 6) or "auto"."""
        if self.registration is None or isinstance(self.registration, str | Real):
            if self.registration == "auto" and d != 3:
                raise ParameterError(
                    f"$registration='auto' is for points in space; X has {d} columns."
                )
            return self.registration or 0.0
        covariance = check_array(self.registration, dtype=np.float64, input_name="registration")
        is_one = covariance.shape == (6, 6) and np.allclose(covariance, covariance.T)
        if d != 3 or not is_one or np.linalg.eigvalsh(covariance)[0] < -1e-9 * np.trace(covariance):
            raise ParameterError(
                "$registration must be a standard error, or in space a covariance of three shifts "
                "and three turns, of shape (6, 6), symmetric and without negative variances."
            )
        return covariance

    def _registered(self, covariance, places, normals):
        """Variances of distances by the registration."""
        if np.ndim(covariance) == 0:
            return covariance**2
        moves = moves_of(places, normals, self._before.xyz.mean(axis=0))
        return np.einsum("ij,jk,ik->i", moves, covariance, moves)

    def _surfaces_of(self, xyz, n_neighbors):
        """The `Surfaces` of a cloud. Its planes are those of all members where a surface bends:
        they are known better than tangents, and bend alike in neighborhoods of one width."""
        estimator = _KeepingPlanes(
            n_neighbors, tangents=False, random_state=self.random_state, n_jobs=self.n_jobs
        ).fit(xyz)
        return Surfaces(
            xyz=xyz.astype(np.float64, copy=False),
            normals=on_known_sides(estimator.normals_),
            planes=estimator.planes_,
            n_neighbors=min(n_neighbors, len(xyz)),
        )

    def _pvalues(self, distance, error):
        """Two-sided, after the correction."""
        pvalue, compared = np.full(len(distance), np.nan), np.isfinite(distance)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.abs(distance[compared]) / error[compared]
        # Exact points have neither distance nor error.
        alone = erfc(np.nan_to_num(ratio, nan=0.0, posinf=np.inf) / np.sqrt(2))
        if self.correction == "fdr" and len(alone):
            alone = false_discovery_control(alone)
        elif self.correction == "sidak":
            with np.errstate(divide="ignore"):
                alone = -np.expm1(len(alone) * np.log1p(-alone))
        pvalue[compared] = alone
        return pvalue


class _KeepingPlanes(RobustNormalEstimator):
    """Normals, and the planes that they are of."""

    def _fill(self, planes, X):
        super()._fill(planes, X)
        self.planes_ = planes


class _Measured(NamedTuple):
    """What planes tell at places (m,)."""

    distance: np.ndarray  # not a number where nothing is compared
    variance: np.ndarray  # of the distance, by independent noise
    height: np.ndarray  # of the first plane over the place
    normals: np.ndarray  # (m, d), of the first cloud
    reason: np.ndarray


def _as_wide(xyz, radius, n_neighbors, n_jobs):
    """As many neighbors as make the usual neighborhood of a cloud about as wide as this radius:
    where a surface bends, planes of wider ones lie deeper."""
    rows = np.lexsort(xyz.T)[:: len(xyz) // SAMPLE + 1]  # whatever the order of rows
    k = min(n_neighbors, len(xyz))
    far, _ = cKDTree(xyz).query(xyz[rows], [k], workers=n_jobs)
    ratio = (radius / max(float(np.median(far)), np.finfo(float).tiny)) ** 2
    if abs(ratio - 1) < ALIKE:
        return n_neighbors
    return int(np.clip(np.rint(n_neighbors * ratio), FEWEST, WIDEST * n_neighbors))


def _reasons(before, rows, second, others, places, is_near):
    """Why places cannot be compared, as rows of `REASONS`."""
    limits, reason = ChangeLimits(), np.zeros(len(places), np.uint8)
    normals, radius = before.normals[rows], before.planes.radius[rows]
    # The second cloud goes on beside a place, not above or below it: so beside what hid it.
    aside = second.xyz[others] - places
    aside -= np.einsum("ij,ij->i", aside, normals)[:, None] * normals
    cosine = np.abs(np.einsum("ij,ij->i", normals, second.normals[others]))
    reason[cosine < np.cos(np.radians(limits.turned))] = 3
    reason[_is_rough(before.planes, rows) | _is_rough(second.planes, others)] = 2
    reason[~is_near | (np.linalg.norm(aside, axis=1) > radius)] = 1
    return reason


def _is_rough(planes, rows):
    """Whether neighborhoods are no surface, by the detector's limit."""
    scale = planes.scale[rows]
    return ~((scale >= 0) & (scale <= SurfaceLimits().flat * planes.radius[rows]))


def _check_overlap(before, after, reach):
    """Raise if the bounds of two clouds are farther apart than the reach."""
    bounds = [(xyz.min(axis=0), xyz.max(axis=0)) for xyz in (before, after)]
    (low, high), (other_low, other_high) = bounds
    if np.maximum(low - other_high, other_low - high).max() > reach:
        first, second = (
            f"from {np.array2string(a, precision=6)} to {np.array2string(b, precision=6)}"
            for a, b in bounds
        )
        raise ParameterError(
            f"The clouds lie nowhere within a $reach of {reach:.3g} of each other: the first goes "
            f"{first}, the second {second}. Are both in one coordinate system and unit?"
        )


def _warn_of_pair(before, second, usual):
    """Warn of clouds that are equal, or of very different density."""
    if before.xyz.shape == second.xyz.shape and not cKDTree(second.xyz).query(before.xyz)[0].any():
        warn_caller("Both clouds are equal: copies of one file have no distance.")
    ratio = float(np.median(second.planes.radius)) / (usual or 1.0)
    if not 1 / 3 <= ratio <= 3:
        which = "second" if ratio > 1 else "first"
        warn_caller(
            f"The {which} cloud is far sparser: its neighborhoods are {max(ratio, 1 / ratio):.1f} "
            "times as wide, and what is smaller has no distance of its own."
        )
