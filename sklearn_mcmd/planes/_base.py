"""Parameters and fitting of every estimator that fits a plane to each neighborhood."""

from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from sklearn_mcmd._choices import RuleMethod, choices_of
from sklearn_mcmd._errors import warn, warn_caller
from sklearn_mcmd._sklearn import DocLinkMixin, Interval, StrOptions
from sklearn_mcmd._validation import (
    FittedScoresMixin,
    check_extent,
    check_sizes,
    check_work,
    validate_points,
)
from sklearn_mcmd.planes._consistent_set import draw_trials, n_support_points, n_trials_needed
from sklearn_mcmd.planes._local_planes import LocalPlaneModel, PlaneSettings
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._resolution import coarse_warning, coordinate_steps
from sklearn_mcmd.planes._rules import METHODS, comparator_of

MAX_TRIALS = 10_000  # in 2D and 3D
# Each further dimension doubles the trials of Eq. 13: 69 in 3D become 10 million in 20D.
MAX_TRIALS_BEYOND_SPACE = 300
LONGEST_TRIAL = 4096  # positions that a trial of one neighborhood of all points may read


class BaseLocalPlanes(DocLinkMixin, BaseEstimator):
    """Parameters and fitting of all estimators that fit a plane to each neighborhood.

    Subclasses store the parameters named in `_parameter_constraints` and call `_fit_planes`.
    """

    _parameter_constraints: ClassVar[dict] = {
        "n_neighbors": [Interval(Integral, 2, None, closed="left"), None],
        "method": [StrOptions(choices_of(RuleMethod))],
        "support_fraction": [Interval(Real, 0, 1, closed="right")],
        "max_outlier_rate": [Interval(Real, 0, 1, closed="left")],
        "success_probability": [Interval(Real, 0, 1, closed="neither")],
        "cutoff": [Interval(Real, 0, None, closed="neither"), None],
        "reweight": ["boolean"],
        "random_state": ["random_state"],
        "n_jobs": [Integral, None],
    }

    _work: ClassVar = ("n_neighbors", 1)  # for `check_work`
    _small_faces: ClassVar = False  # as of `PlaneSettings`

    def _fit_planes(self, X, radius=None, cutoff=None):
        """Validate X, find the parameters that depend on it, and fit its local planes.

        Members of a neighborhood beyond the cutoff are left out of its plane; None is the rule's.
        """
        self._comparator()  # before what takes long
        X, index = self._index_cloud(X, radius)
        d = X.shape[1]
        n_support = n_support_points(self.support_fraction, self.n_neighbors_, d)
        self.n_support_ = int(n_support) if index.sizes is None else n_support
        precision = np.finfo(X.dtype).eps
        self._model = model_of(self, index, X.shape, precision, self._steps(X), cutoff)
        return X

    def _steps(self, X):
        """The `Steps` that planes know of coordinates: levels of depths are surfaces to them."""
        return coordinate_steps(X)._replace(growth=0.0)

    def _comparator(self):
        """The registered method that `method` and `method_params` name; None for a rule."""
        params = getattr(self, "method_params", None)
        if self.method not in METHODS:
            if self.cutoff is not None:
                raise ValueError(
                    f"cutoff={self.cutoff} has no meaning for method={self.method!r}, whose "
                    "parameters are in method_params."
                )
            comparator = comparator_of(self.method, params)
            if not comparator.has_cutoff and comparator.contamination is None:
                raise ValueError(
                    f"method={self.method!r} has no cut-off of its own: give the share of "
                    'outliers, such as method_params={"contamination": 0.1}.'
                )
            return comparator
        if params:
            raise ValueError(
                f"method_params={params!r} has no meaning for method={self.method!r}, whose "
                "parameters are those of the estimator: pass {} or None."
            )
        return None

    def _index_cloud(self, X, radius=None):
        """Validate X and return it with the index of its neighborhoods."""
        X = validate_points(self, X, ensure_min_features=2)
        n, d = X.shape
        fixed = self.n_neighbors if isinstance(self.n_neighbors, Integral) else None
        check_sizes(n, d, fixed)
        check_extent(X)
        index = self._make_index(X.astype(np.float64, copy=False), radius)
        check_work(self, len(index.points))
        self.n_neighbors_ = n if self.n_neighbors is None else index.n_neighbors
        if index.sizes is not None:
            self.n_neighbors_ = index.sizes[index.places]
        elif fixed is not None:
            warn_if_few(self, index, n)
        if X.dtype == np.float32 and (coarse := coarse_warning(index)):
            warn_caller(coarse)
        return X, index

    def _make_index(self, xyz, radius):
        return NeighborIndex(xyz, self.n_neighbors, radius)

    def _check_queries(self, X):
        """Validate points to evaluate: of the fitted dimension, their squares finite."""
        X = validate_points(self, X, reset=False)
        check_extent(X)
        return X

    def _count_trials(self, d):
        needed = n_trials_needed(self.max_outlier_rate, self.success_probability, d)
        most = MAX_TRIALS if d <= 3 else MAX_TRIALS_BEYOND_SPACE
        if needed > most and METHODS[self.method].needs_consistent_set:
            warn(
                f"$max_outlier_rate={self.max_outlier_rate!r} in {d}D asks for {needed} trials; "
                f"{most} are made. A lower $max_outlier_rate asks for fewer."
            )
        return min(needed, most)


def warn_if_few(estimator, index, n):
    """Warn if the n points of an index have fewer places than an estimator asks neighbors for."""
    if index.n_neighbors < estimator.n_neighbors:
        warn(
            f"$n_neighbors={estimator.n_neighbors} is more than the number of distinct points, "
            f"{index.n_distinct} of $n_samples: neighborhoods of all of them are used.",
            n_samples=n,
        )


class BasePlaneOutliers(FittedScoresMixin, BaseLocalPlanes):
    """Outliers by a score and an offset: subclasses have `fit` and `_score`.

    `_score` returns how abnormal points are: larger is more abnormal. `fit` sets ``scores_`` and
    ``offset_``.
    """

    def score_samples(self, X: "ArrayLike") -> NDArray[np.float64]:
        """Opposite of the abnormality of each point in its neighborhood.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)

        Returns
        -------
        scores : ndarray of shape (n_samples,)
            Lower is more abnormal.
        """
        check_is_fitted(self)
        return -self._score(self._check_queries(X))


def mends_planes(estimator):
    """Whether planes of 2D and 3D are more than Algorithm 4 of each neighborhood finds by itself.

    Neighbors agree on them, and `RobustNormalEstimator` looks for bends and edges. Not so for the
    papers' forms, and for rules without a compiled form, which neighbors need to agree.
    """
    rule = METHODS.get(estimator.method)
    robust = rule is not None and rule.needs_consistent_set and rule.compiled
    alone = estimator.n_neighbors is None or getattr(estimator, "strictness", "") is None
    return robust and estimator.reweight and not alone


def model_of(estimator, index, shape, precision, steps, cutoff=None, comparator=None):
    """The planes of an index of points of this shape, by the parameters of an estimator.

    `precision` and `steps` are as of `PlaneSettings`. The estimator gets `n_trials_`.
    """
    n, d = shape
    k, comparator = index.n_neighbors or n, comparator or estimator._comparator()
    settings = PlaneSettings(estimator.method, precision, steps)
    if comparator is not None:
        estimator.n_trials_, _ = comparator.table_shape(k, d)
        seed = comparator.seed(estimator.random_state)
        return LocalPlaneModel(index, seed, settings._replace(comparator=comparator))
    estimator.n_trials_ = estimator._count_trials(d)
    rule = METHODS[estimator.method]
    n_trials = estimator.n_trials_ if rule.needs_consistent_set else 0
    length = LONGEST_TRIAL if estimator.n_neighbors is None else None
    trials = draw_trials(n_trials, k, estimator.random_state, length=length)
    settings = settings._replace(
        support_fraction=estimator.support_fraction,
        cutoff=rule.default_cutoff(d) if cutoff is None else float(cutoff),
        reweight=estimator.reweight,
        agrees=d <= 3 and mends_planes(estimator),
        small_faces=estimator._small_faces,
    )
    return LocalPlaneModel(index, trials, settings)
