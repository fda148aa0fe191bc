"""Grid search of segmentation: folds of whole scenes, and a scorer of segments."""

import warnings
from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.exceptions import UndefinedMetricWarning
from sklearn.model_selection import BaseCrossValidator
from sklearn.utils.validation import check_consistent_length, column_or_1d

from sklearn_mcmd.metrics import segmentation_scores


class WholeSceneSplit(BaseCrossValidator):
    """Folds that each are one whole scene, to fit and to score.

    A clusterer finds segments in a whole cloud. It learns nothing from one scene for another, and
    a part of a scene would be another task. So the training points and the test points of each
    fold are both the points of one scene. The score of a candidate is the mean over scenes.

    See Also
    --------
    score_segments : The scorer to use with it.
    SpatialBlockSplit : Folds of one cloud, for outlier detectors.
    sklearn.model_selection.LeaveOneGroupOut : Trains on the other scenes, for what learns.

    Notes
    -----
    *Training and test points are the same on purpose*. Clusterers are fitted without labels, and
    labels only score, so nothing leaks. With an estimator that learns from y, labels would leak.
    The score of the best of many candidates is optimistic, as in every search. Judge the winner on
    a scene that the search has not seen.

    Give ``refit=False`` to the search: scenes in one array lie on top of each other, and to segment
    them together makes no sense.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.model_selection import WholeSceneSplit
    >>> X, scene = np.zeros((5, 3)), [0, 1, 1, 0, 1]
    >>> for train, test in WholeSceneSplit().split(X, groups=scene):
    ...     print(train, test)
    [0 3] [0 3]
    [1 2 4] [1 2 4]
    """

    __metadata_request__split: ClassVar = {"groups": True}

    def get_n_splits(
        self, X: object = None, y: object = None, groups: ArrayLike | None = None
    ) -> int:
        """Number of scenes.

        Parameters
        ----------
        X, y : Ignored
        groups : array-like of shape (n_samples,)
            The scene of each point.

        Returns
        -------
        n_splits : int

        Raises
        ------
        ValueError
            If `groups` is missing.
        """
        return len(np.unique(_check_groups(groups)))

    def split(
        self, X: ArrayLike, y: object = None, groups: ArrayLike | None = None
    ) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Indices of the points of each scene, twice.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
        y : Ignored
        groups : array-like of shape (n_samples,)
            The scene of each point.

        Yields
        ------
        train, test : ndarray of int
            Equal and ascending.

        Raises
        ------
        ValueError
            If `groups` is missing or of another length than X.
        """
        scenes = _check_groups(groups)
        check_consistent_length(X, scenes)
        for scene in np.unique(scenes):
            rows = np.flatnonzero(scenes == scene)
            yield rows, rows.copy()


def _check_groups(groups):
    if groups is None:
        raise ValueError(
            "groups=None: give the scene of each point, as in fit(X, y, groups=scene)."
        )
    return column_or_1d(groups)


def score_segments(estimator: BaseEstimator, X: ArrayLike, y: ArrayLike) -> dict[str, float]:
    """Scores of the segmentation of X by a clusterer, or by a pipeline that ends in one.

    It is a scorer for scikit-learn's searches: ``GridSearchCV(pipeline, grid,
    scoring=score_segments, cv=WholeSceneSplit(), refit=False)``. A clone segments X anew, because
    clusterers have no `predict`. With ``memory`` the pipeline's earlier steps are not repeated.

    Parameters
    ----------
    estimator : clusterer or Pipeline
        An estimator with `fit_predict`, fitted or not. Points that a sampler of the pipeline
        dropped, such as :class:`~sklearn_mcmd.resampling.DenoisingSampler`, belong to no segment.
    X : array-like of shape (n_samples, n_features)
        One scene.
    y : array-like of int of shape (n_samples,)
        The true surface of each point; -1 for outliers, which do not count.

    Returns
    -------
    scores : dict of str to float
        ``f_score``, ``recall``, ``precision``, ``mean_iou`` and ``adjusted_rand`` of
        :func:`~sklearn_mcmd.metrics.segmentation_scores`. The first three are 0 where they
        are undefined, because a search cannot rank NaN.

    Raises
    ------
    TypeError
        If the estimator has no `fit_predict`.
    ValueError
        If the estimator gives fewer or more labels than X has rows, and no sampler tells which
        rows it kept, or if the labels are not integers.

    See Also
    --------
    WholeSceneSplit : Folds for it.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.model_selection import GridSearchCV
    >>> from sklearn.pipeline import Pipeline
    >>> from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
    >>> from sklearn_mcmd.datasets import make_box
    >>> from sklearn_mcmd.model_selection import WholeSceneSplit, score_segments
    >>> scenes = [make_box(1500, noise=0.005, random_state=seed) for seed in range(2)]
    >>> X = np.vstack([scene.data for scene in scenes])
    >>> y = np.hstack([scene.surface for scene in scenes])
    >>> pipeline = Pipeline([
    ...     ("normals", RobustNormalEstimator(30, random_state=0)),
    ...     ("segment", RegionGrowing(normals="precomputed")),
    ... ])
    >>> search = GridSearchCV(
    ...     pipeline, {"segment__max_angle": [0.05, 15]}, scoring=score_segments,
    ...     cv=WholeSceneSplit(), refit=False,
    ... ).fit(X, y, groups=np.repeat([0, 1], 1500))
    >>> search.cv_results_["mean_test_f_score"].round(1)
    array([0., 1.])
    """
    if not hasattr(estimator, "fit_predict"):
        raise TypeError(
            f"{estimator!r} has no fit_predict: score_segments is for clusterers such as "
            "RegionGrowing, or a Pipeline that ends in one."
        )
    fitted = clone(estimator)
    labels = np.asarray(fitted.fit_predict(X))
    true = np.asarray(y)
    rows = _rows_kept(fitted, len(true))
    if len(labels) != len(rows):
        raise ValueError(
            f"fit_predict gave {len(labels)} labels for {len(rows)} points: steps that drop rows "
            "must tell which they kept, in sample_indices_, as DenoisingSampler does."
        )
    whole = np.full(len(true), -1, dtype=labels.dtype)
    whole[rows] = labels
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UndefinedMetricWarning)
        scores = segmentation_scores(true, whole)
    names = ("f_score", "recall", "precision", "mean_iou", "adjusted_rand")
    return {name: float(np.nan_to_num(scores[name])) for name in names}


def _rows_kept(estimator, n_samples):
    """Rows of X that reach the last step; samplers before it may have dropped others."""
    rows = np.arange(n_samples)
    for _, step in getattr(estimator, "steps", ()):
        rows = rows[getattr(step, "sample_indices_", slice(None))]
    return rows
