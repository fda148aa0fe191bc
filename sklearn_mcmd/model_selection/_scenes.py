"""A scorer of segments, for grid search over whole scenes."""

import warnings

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, clone
from sklearn.exceptions import UndefinedMetricWarning

from sklearn_mcmd.metrics import segmentation_scores


def score_segments(estimator: BaseEstimator, X: "ArrayLike", y: "ArrayLike") -> dict[str, float]:
    """Scores of the segmentation of X by a clusterer, or by a pipeline that ends in one.

    It is a scorer for scikit-learn's searches. Each fold is a whole scene, whose points are both
    fitted and scored: ``cv=[(rows, rows) for rows in scenes]``, with the rows of each scene.
    Clusterers are fitted without labels, so nothing leaks. A clone segments X anew, because
    clusterers have no `predict`. With ``memory`` the pipeline's earlier steps are not repeated.
    Scenes in one array lie on top of each other, so ``refit=False``.

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
    SpatialBlockSplit : Folds of one cloud, for outlier detectors.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.model_selection import GridSearchCV
    >>> from sklearn.pipeline import Pipeline
    >>> from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
    >>> from sklearn_mcmd.datasets import make_box
    >>> from sklearn_mcmd.model_selection import score_segments
    >>> scenes = [make_box(1500, noise=0.005, random_state=seed) for seed in range(2)]
    >>> X = np.vstack([scene.data for scene in scenes])
    >>> y = np.hstack([scene.surface for scene in scenes])
    >>> pipeline = Pipeline([
    ...     ("normals", RobustNormalEstimator(30, random_state=0)),
    ...     ("segment", RegionGrowing(normals="precomputed")),
    ... ])
    >>> search = GridSearchCV(
    ...     pipeline, {"segment__max_angle": [0.05, 15]}, scoring=score_segments,
    ...     cv=[(rows, rows) for rows in np.arange(3000).reshape(2, 1500)], refit=False,
    ... ).fit(X, y)
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
