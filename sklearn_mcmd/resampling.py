"""A sampler that drops outliers from X and y together, for imbalanced-learn's pipelines."""

from typing import Any, ClassVar

import numpy as np
from sklearn.base import BaseEstimator, clone
from sklearn.utils.validation import check_consistent_length, validate_data

from sklearn_mcmd._sklearn import DocLinkMixin, HasMethods, fit_context
from sklearn_mcmd._validation import check_inliers
from sklearn_mcmd.outliers._detector import MCMDOutlierDetector

__all__ = ["DenoisingSampler"]


class DenoisingSampler(DocLinkMixin, BaseEstimator):
    """Drop outliers from X and y together, by `fit_resample` as in imbalanced-learn.

    Steps of scikit-learn's Pipeline never change the number of rows, but steps of
    :class:`imblearn.pipeline.Pipeline` may. With this as its first step, all later steps
    learn from the cleaned cloud, and a grid search reaches the detector's parameters. Only
    fitting is affected; rows to predict, transform or score are never dropped.

    Parameters
    ----------
    detector : outlier detector, default=None
        The detector of the outliers: an estimator with `fit_predict` that gives -1 for them. It is
        cloned. None means ``MCMDOutlierDetector(random_state=0)``.

    Attributes
    ----------
    detector_ : estimator
        The detector, fitted on the coordinates.

    sample_indices_ : ndarray of int of shape (n_kept,)
        Rows of X that were kept, ascending.

    n_features_in_, feature_names_in_ : int and ndarray of str of shape (`n_features_in_`,)
        Number of features seen during `fit_resample`, and their names, if all are strings.

    See Also
    --------
    sklearn_mcmd.MCMDOutlierDetector : The default detector.
    sklearn_mcmd.model_selection.score_segments : Scores a pipeline that drops rows.

    Notes
    -----
    The class itself does not need imbalanced-learn. It has that library's interface without its
    base class. `y` may hold anything with one entry for each row, such as continuous values or
    several columns, or be None. A clusterer at the end of such a pipeline gives one label for
    each row that was kept; ``pipeline[0].sample_indices_`` lists these rows.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd import MCMDOutlierDetector
    >>> from sklearn_mcmd.resampling import DenoisingSampler
    >>> from sklearn_mcmd.datasets import make_street
    >>> street = make_street(4000, outlier_share=0.1, random_state=0)
    >>> sampler = DenoisingSampler(MCMDOutlierDetector(strictness="surfaces", random_state=0))
    >>> X, y = sampler.fit_resample(street.data, street.target)
    >>> print(f"{np.mean(street.target == -1):.0%} outliers before")
    10% outliers before
    >>> bool(np.mean(y == -1) < 0.02)
    True
    """

    _parameter_constraints: ClassVar[dict] = {"detector": [HasMethods("fit_predict"), None]}

    def __init__(self, detector: BaseEstimator | None = None) -> None:
        self.detector = detector

    @fit_context(prefer_skip_nested_validation=False)
    def fit_resample(self, X: Any, y: Any = None) -> tuple[Any, Any]:
        """Find the outliers of X and drop their rows from X and y.

        Parameters
        ----------
        X : array-like or dataframe of shape (n_samples, n_features)
            Coordinates.
        y : array-like, series or dataframe of n_samples rows, default=None

        Returns
        -------
        X_kept, y_kept : of the kinds of X and y
            The rows of the inliers, in their order. Lists become arrays. `y_kept` is None if y is.

        Raises
        ------
        ValueError
            If the detector has no `fit_predict` or refuses X, if the lengths of X and y differ, or
            if the detector gives other labels than +1 and -1 or calls every point an outlier.
        """
        check_consistent_length(X, y)
        detector = self.detector
        detector = MCMDOutlierDetector(random_state=0) if detector is None else clone(detector)
        labels = detector.fit_predict(X)
        validate_data(self, X, skip_check_array=True)
        kept = np.flatnonzero(check_inliers("detector", detector, labels))
        self.detector_, self.sample_indices_ = detector, kept
        return _take(X, kept), _take(y, kept)


def _take(rows, indices):
    """Rows of an array, or of a pandas, pyarrow or polars object, as their own kind."""
    if rows is None:
        return None
    if hasattr(rows, "iloc"):
        return rows.iloc[indices]
    if hasattr(rows, "to_pylist"):  # pyarrow
        return rows.take(indices)
    if hasattr(rows, "__dataframe__") or hasattr(rows, "to_arrow"):  # polars
        return rows[indices]
    return np.asarray(rows)[indices]
