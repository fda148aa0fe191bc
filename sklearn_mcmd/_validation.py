"""Labels from scores, and checks of clouds, for all estimators."""

from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import OutlierMixin
from sklearn.utils import check_array
from sklearn.utils.validation import validate_data

from sklearn_mcmd._errors import ParameterError, warn

# Float64 holds the fourth powers (of areas, squared) of coordinates up to this. All finite float32
# coordinates are smaller.
LARGEST = 1e70
SMALLEST = 1e-70  # and of differences down to this
USUAL = 50  # the usual number of neighbors
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


def validate_points(estimator, X, *, dtype=(np.float64, np.float32), **params):
    """`validate_data` of points, which names the first row that is not finite."""
    try:
        return validate_data(estimator, X, dtype=dtype, **params)
    except ValueError:
        points = validate_data(estimator, X, dtype=dtype, ensure_all_finite=False, **params)
    row = np.flatnonzero(~np.isfinite(points).all(axis=1))[0]
    kind = "NaN" if np.isnan(points[row]).any() else "infinity"
    raise ParameterError(
        f"$X has {kind} in $row: {points[row].tolist()}. Remove points without a measured position "
        "first.",
        row=row,
    )


def check_inliers(name, detector, labels, least=1):
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
