"""CloudChange: what has moved between two clouds of one place, and how surely."""

from numbers import Integral, Real
from typing import ClassVar, Literal, Self

import numpy as np
from joblib import effective_n_jobs
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator
from sklearn.utils import check_array
from sklearn.utils.validation import check_is_fitted

from sklearn_mcmd._choices import ChangeCorrection, choices_of
from sklearn_mcmd._errors import ParameterError, warn_caller
from sklearn_mcmd._sklearn import DocLinkMixin, Interval, StrOptions, fit_context
from sklearn_mcmd._validation import check_extent, check_sizes, is_auto, validate_points
from sklearn_mcmd.change._bodies import moved_bodies
from sklearn_mcmd.change._comparison import (
    FEWEST,
    NOTHING,
    SAMPLE,
    Changes,
    Correction,
    Scale,
    judged,
    measure,
    radii_in,
)
from sklearn_mcmd.change._distances import (
    AlikeLimits,
    Surfaces,
    alike_of,
    alike_pairs,
    sampled,
    tree_of,
)
from sklearn_mcmd.normals import RobustNormalEstimator


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
    The variance of a distance is that of both planes at the core point, `alike` times, as noise
    that is alike nearby is in no residual, and that of the registration: see :doc:`/change`.

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
    0.99 0.04
    >>> print(f"{1000 * np.nanmedian(changes.distance[moved]):.1f} mm")
    4.0 mm
    """

    _work: ClassVar = RobustNormalEstimator._work
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
        registration_of(self.registration, xyz.shape[1])
        before = self._surfaces_of(xyz, tree_of(xyz), self.n_neighbors)
        self._before = before._replace(tree=None)  # which is no number that a file may hold
        self.normals_ = before.normals
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
        covariance = registration_of(self.registration, self.n_features_in_)
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
        n_jobs, tree = effective_n_jobs(self.n_jobs), tree_of(after)
        before = self._before._replace(tree=tree_of(self._before.xyz))
        radii, others = (
            radii_in(xyz, of, self.n_neighbors, SAMPLE / len(xyz), n_jobs)
            for xyz, of in ((before.xyz, before.tree), (after.astype(float, copy=False), tree))
        )
        scale = Scale.of(radii, others, self.n_neighbors, self.reach)
        check_overlap(bounds_of(before.xyz), bounds_of(after), scale.reach)
        warn_of_pair(scale, are_equal(before.xyz, after))
        second = self._surfaces_of(after, tree, scale.n_neighbors)
        measured = measure(before, second, scale, n_jobs)
        chosen = sampled(before.xyz, AlikeLimits().pairs / len(before.xyz))
        alike = alike_of(alike_pairs(before, measured.distance, measured.variance, chosen))
        if places is None:
            places = before.xyz
        else:
            measured = measure(before, second, scale, n_jobs, places)
        warn_of_nothing(np.mean(measured.reason == NOTHING), scale.reach)
        bodies, center = None, before.xyz.mean(axis=0)
        if isinstance(covariance, str):
            bodies = moved_bodies(
                before.xyz,
                after,
                alpha=self.alpha,
                random_state=self.random_state,
                n_jobs=self.n_jobs,
            )
            covariance = bodies.registration
        variance = measured.variance * np.nan_to_num(alike, nan=1.0)
        variance += measured.registered(covariance, places, center)
        told = judged(measured.distance, variance, measured.reason, self.alpha, self._adjust)
        return told._replace(alike=alike, bodies=bodies)

    def _adjust(self, pvalues):
        """P-values after the correction, by all that are told."""
        known = np.unique(pvalues[np.isfinite(pvalues)], return_counts=True)
        return Correction.of(*known, self.correction).adjust(pvalues)

    def _surfaces_of(self, xyz, tree, n_neighbors):
        return Surfaces.of(xyz, tree, n_neighbors, self.random_state, self.n_jobs)


def registration_of(given, d):
    """The parameter as a variance, a covariance (6, 6) or "auto", for points in d dimensions."""
    if is_auto(given):
        if d == 3:
            return given
        raise ParameterError(f"$registration='auto' is for points in space; X has {d} columns.")
    if given is None or isinstance(given, Real):
        return (given or 0.0) ** 2
    covariance = check_array(given, dtype=np.float64, input_name="registration")
    is_one = covariance.shape == (6, 6) and np.allclose(covariance, covariance.T)
    if d != 3 or not is_one or np.linalg.eigvalsh(covariance)[0] < -1e-9 * np.trace(covariance):
        raise ParameterError(
            "$registration must be a standard error, or in space a covariance of three shifts and "
            "three turns, of shape (6, 6), symmetric and without negative variances."
        )
    return covariance


def bounds_of(xyz):
    return xyz.min(axis=0), xyz.max(axis=0)


def are_equal(first, second):
    """Whether two clouds have the same points, in whatever order."""
    return (
        first.shape == second.shape
        and np.array_equal(bounds_of(first), bounds_of(second))
        and np.array_equal(np.sort(first, axis=0), np.sort(second, axis=0))
    )


def warn_of_pair(scale, equal):
    """Warn of clouds that are equal, or of very different density."""
    if equal:
        warn_caller("Both clouds are equal: copies of one file have no distance.")
    if not 1 / 3 <= scale.width <= 3:
        which, width = ("second", 1 / scale.width) if scale.width < 1 else ("first", scale.width)
        warn_caller(
            f"The {which} cloud is far sparser: its neighborhoods are {width:.2g} times as wide, "
            "and what is smaller has no distance of its own."
        )


def warn_of_nothing(share, reach):
    """Warn if a share of the places has nothing within reach."""
    if share > 0.5:
        warn_caller(
            f"{share:.0%} of the core points have nothing of both clouds within a reach of "
            f"{reach:.3g}: do both cover one place, in one unit?"
        )


def check_overlap(first, second, reach):
    """Raise if the bounds of two clouds are farther apart than the reach."""
    (low, high), (other_low, other_high) = first, second
    if np.maximum(low - other_high, other_low - high).max() > reach:
        one, other = (
            "from " + " to ".join(", ".join(f"{x:.10g}" for x in end) for end in bounds)
            for bounds in (first, second)
        )
        raise ParameterError(
            f"The clouds lie nowhere within a $reach of {reach:.3g} of each other: the first goes "
            f"{one}, the second {other}. Are both in one coordinate system and unit?"
        )
