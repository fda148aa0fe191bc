"""Labels from scores, and checks of clouds, for all estimators."""

from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from sklearn.base import OutlierMixin
from sklearn.utils import check_array
from sklearn.utils.validation import validate_data

from sklearn_mcmd._errors import ParameterError, warn, warn_caller

# Float64 holds the fourth powers (of areas, squared) of coordinates up to this. All finite float32
# coordinates are smaller.
LARGEST = 1e70
SMALLEST = 1e-70  # and of differences down to this
USUAL = 50  # the usual number of neighbors
# Surface variation of NEAR points: 0 on a plane, 0.19 in a volume. Below, columns are of surfaces.
FLAT, NEAR, LOOKED_AT = 0.1, 20, 1000  # the last is a number of points
# What the fit of a step within another fit need not say again.
SAID = "X has .* columns, and each counts as a coordinate|.* lie in one row of the scan"
MOST_STEPS = 2**24  # steps, as of `check_work`, that take no noticeable time


class OffsetOutlierMixin(OutlierMixin):
    """Labels from ``score_samples`` and ``offset_``."""

    def decision_function(self, X: "ArrayLike") -> NDArray[np.float64]:
        """Score relative to the limit: negative for outliers.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)

        Returns
        -------
        decision : ndarray of shape (n_samples,)
            ``score_samples(X) - offset_``.
        """
        return self.score_samples(X) - self.offset_

    def predict(self, X: "ArrayLike") -> NDArray[np.int64]:
        """Label points by the fitted cloud; each is judged as if it alone were added.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)

        Returns
        -------
        labels : ndarray of int of shape (n_samples,)
            1 for inliers and -1 for outliers, or edges.
        """
        return np.where(self.decision_function(X) >= 0, 1, -1)


class FittedScoresMixin(OffsetOutlierMixin):
    """Labels of the fitted cloud from ``scores_``, the ``score_samples`` that `fit` stores."""

    @property
    def labels_(self) -> NDArray[np.int64]:
        """1 for inliers and -1 for outliers of the fitted cloud, by ``offset_``."""
        return np.where(self.scores_ >= self.offset_, 1, -1)

    def fit_predict(
        self, X: "ArrayLike", y: object = None, **fit_params: "ArrayLike | None"
    ) -> NDArray[np.int64]:
        """Label the points of a cloud by itself.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
        y : Ignored
        **fit_params : array-like
            As in `fit`.

        Returns
        -------
        labels : ndarray of int of shape (n_samples,)
            1 for inliers and -1 for outliers, or edges. They equal
            ``fit(X).predict(X)``, but points are judged only once.
        """
        return self.fit(X, **fit_params).labels_


def validate_points(estimator, X, *, dtype=(np.float64, np.float32), reset=True, **params):
    """`validate_data` of points, with words for what is no table whose rows are points."""
    with_normals = getattr(estimator, "normals", "") == "precomputed"
    _check_form(X, None if reset else estimator.n_features_in_, with_normals)
    params |= {"dtype": dtype, "reset": reset}
    try:
        points = validate_data(estimator, X, **params)
    except ValueError:
        points = validate_data(estimator, X, ensure_all_finite=False, **params)
        row = np.flatnonzero(~np.isfinite(points).all(axis=1))[0]
        kind = "NaN" if np.isnan(points[row]).any() else "infinity"
        raise ParameterError(
            f"$X has {kind} in $row: {points[row].tolist()}. Remove points without a measured "
            "position first.",
            row=row,
        ) from None
    if reset and points.shape[1] > 3 and not with_normals:
        _warn_of_attributes(estimator, points)
    return points


def _check_form(X, d, with_normals):
    """Raise if X is no table of numbers, or seems to be transposed: d columns are known or None."""
    way = next((way for way in (".xyz", ".collect()") if hasattr(X, way.strip(".()"))), None)
    if hasattr(X, "__array__"):  # a dataframe may have columns of these names
        fields = getattr(getattr(X, "dtype", None), "names", None)
        way = f"[{list(fields[:3])}].tolist()" if fields else None
    if way is not None:
        kind = "structured array" if hasattr(X, "dtype") else type(X).__name__
        raise ParameterError(f"$X is a {kind}, not a table of numbers: give X{way}.")
    shape: tuple = np.shape(X) if isinstance(X, list | tuple) else getattr(X, "shape", ())
    if len(shape) != 2:
        return
    wide = 1 < shape[0] < shape[1] > 3 and not with_normals
    if wide if d is None else shape[0] == d != shape[1]:
        raise ParameterError(
            f"$X has {shape[0]} rows of {shape[1]:,} columns: transpose it? Rows are points, and "
            "a plane needs more of them than columns."
        )


def _warn_of_attributes(estimator, X):
    """Warn if columns beside x, y and z are no coordinates, by their names or as it seems."""
    names = [name.lower() for name in getattr(estimator, "feature_names_in_", ())]
    regresses = getattr(estimator, "surface", "") == "vertical"  # on columns of any kind
    others = set(names[-1:] if regresses else names) - set("wxyz")
    is_named = {"x", "y", "z"} <= set(names)
    if others if is_named else not regresses and _are_on_surfaces(X):
        warn_caller(
            f"X has {X.shape[1]} columns, and each counts as a coordinate. If these are x, y and z "
            "alone, leave the others out: fit(xyz). MCMDOutlierDetector takes the intensity apart: "
            "fit(xyz, intensity=...)."
        )


def _are_on_surfaces(X):
    """Whether the first three columns lie on surfaces. In more dimensions they fill a volume."""
    points = np.unique(X[:: len(X) // LOOKED_AT + 1, :3], axis=0).astype(np.float64)
    if len(points) < USUAL:
        return False
    points -= points[0].copy()
    points /= np.abs(points).max()  # no square overflows
    near = points[cKDTree(points).query(points, NEAR)[1]]
    near -= near.mean(axis=1, keepdims=True)
    spread = np.linalg.eigvalsh(near.swapaxes(1, 2) @ near)
    return np.median(spread[:, 0] / spread.sum(axis=1)) < FLAT


def check_inliers(name, detector, labels, least):
    """Mask of the inliers by the labels of a detector, the parameter of this name."""
    labels = np.asarray(labels)
    if not np.isin(labels, (-1, 1)).all():
        raise ValueError(
            f"{name}={detector!r} gives labels other than +1 and -1: take an outlier detector, "
            "such as MCMDOutlierDetector()."
        )
    kept = labels == 1
    check_n_kept(name, detector, np.count_nonzero(kept), len(kept), least)
    return kept


def check_n_kept(name, detector, n_kept, n, least):
    """Raise if a detector keeps less than so many points."""
    if n_kept < least:
        raise ValueError(
            f"{name}={detector!r} calls {n - n_kept} of {n} points outliers, which leaves too few: "
            "loosen its cut-off, or do without it."
        )


def check_sizes(n, d, n_neighbors):
    """Raise if there are too few points or neighbors for planes in d dimensions."""
    needed = f"is too few for planes in {d}D: at least {d + 1} are needed."
    if n < d + 1:
        raise ParameterError(f"$n_samples {needed}", n_samples=n)
    if n_neighbors is not None and n_neighbors < d + 1:
        raise ParameterError(f"$n_neighbors={n_neighbors} {needed}")


def check_work(estimator, n):
    """Warn of neighborhoods that take long; raise if they would be of all points, which are fewer.

    An estimator's `_work` is the name of their size, and the power by which the steps for one of n
    points grow with it. Clouds of which all neighborhoods of all take `MOST_STEPS` may have any.
    """
    n_neighbors, (name, power) = estimator.n_neighbors, estimator._work
    if not isinstance(n_neighbors, Integral) or n_neighbors <= MOST_STEPS ** (1 / (1 + power)):
        return
    if n_neighbors <= n:
        times = (n_neighbors / USUAL) ** power
        warn(f"${name}={n_neighbors} takes at least {times:,.0f} times as long as {USUAL}.")
    elif n * n**power > MOST_STEPS:
        raise ParameterError(
            f"${name}={n_neighbors} is more than there are points, {n:,}. Each point would get a "
            f"plane of all of them, which takes too long: give fewer, such as {USUAL}."
        )


def check_extent(X):
    """Raise if squares of coordinates would overflow, or squares of their differences vanish."""
    if X.dtype == np.float32 or len(X) == 0:
        return
    low, high = X.min(axis=0), X.max(axis=0)
    if max(-low.min(), high.max()) > LARGEST:
        row = np.flatnonzero((np.abs(X) > LARGEST).any(axis=1))[0]
        raise ParameterError(
            f"$X has a coordinate beyond {LARGEST:g} in $row: {X[row].tolist()}. Remove points "
            "without a measured position first.",
            row=row,
        )
    extent = float((high - low).max())
    if 0 < extent < SMALLEST:
        raise ParameterError(
            f"$X spans no more than {extent:g}; at least {SMALLEST:g} is needed. Scale it up."
        )
    near = X[np.abs(X[:, 0]) < SMALLEST]
    near = near[(np.abs(near) < SMALLEST).all(axis=1)]
    if (near != near[:1]).any():
        raise ParameterError(
            f"$X has {len(near)} points within {SMALLEST:g} of the origin that are not equal, but "
            "squares of their differences vanish. Set their coordinates to 0."
        )


def is_auto(sensor_origin):
    """Whether the position of the sensor is to be found from the cloud."""
    return isinstance(sensor_origin, str) and sensor_origin == "auto"


def check_sensor_origin(sensor_origin, X):
    """The sensor's position for each point of X: float64 (n, d), or None if it is not known."""
    if sensor_origin is None:
        return None
    n, d = X.shape
    if isinstance(sensor_origin, str):
        if sensor_origin != "origin":
            raise ValueError(
                f"sensor_origin={sensor_origin!r} must be 'origin', a position or one for each "
                "point; outlier detectors also take 'auto'."
            )
        position = np.zeros(d)
    else:
        position = check_array(
            sensor_origin, dtype=np.float64, ensure_2d=False, input_name="sensor_origin"
        )
    if position.shape not in ((d,), (n, d)):
        raise ValueError(
            f"sensor_origin must be 'origin', a position of shape ({d},), or one for each point, "
            f"of shape ({n}, {d}); got shape {position.shape}."
        )
    origins = np.broadcast_to(position, (n, d))
    if (origins == X).all():
        raise ParameterError("$sensor_origin is where all points are: there are no rays to them.")
    return origins
