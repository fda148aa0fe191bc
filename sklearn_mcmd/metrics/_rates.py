"""Measures of the paper: the bias angle (Eq. 19) and the outlier rates (Eqs. 20-24)."""

import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.exceptions import UndefinedMetricWarning
from sklearn.metrics import confusion_matrix
from sklearn.utils import Bunch, check_array, check_consistent_length, column_or_1d


def bias_angle(normals_a: "ArrayLike", normals_b: "ArrayLike") -> float | NDArray[np.float64]:
    """Angle between two planes, from their normals, in degrees (Eq. 19).

    A normal and its opposite stand for the same plane, so the angle lies in [0, 90].

    Parameters
    ----------
    normals_a, normals_b : array-like of shape (n_features,) or (..., n_features)
        Normals of any length except zero. The leading axes are broadcast. A row with NaN, as for
        a point without a normal, gives NaN.

    Returns
    -------
    angle : float or ndarray of shape (...), float64
        Degrees in [0, 90]. A float where both inputs are single vectors.

    Raises
    ------
    ValueError
        If a normal is zero or infinite, or the shapes do not broadcast.

    Notes
    -----
    Eq. 19 is ``arccos|n1 . n2|``. Near 0 the cosine is flat: by rounding alone parallel normals
    get angles of up to 1e-6 degrees, or NaN where the product exceeds one. Here the angle is twice
    the arctangent of chord over opposite chord, which is accurate for all angles.

    Examples
    --------
    >>> from sklearn_mcmd.metrics import bias_angle
    >>> bias_angle([0, 0, 1], [0, 0, -2])
    0.0
    >>> bias_angle([[0, 0, 1], [0, 1, 1]], [0, 0, 1]).round(6)
    array([ 0., 45.])
    """
    a, b = _unit(normals_a, "normals_a"), _unit(normals_b, "normals_b")
    if a.shape[-1] != b.shape[-1]:
        raise ValueError(f"normals_a has {a.shape[-1]} coordinates and normals_b {b.shape[-1]}.")
    try:
        difference, total = a - b, a + b
    except ValueError as error:
        raise ValueError(
            f"normals_a of shape {a.shape} and normals_b of shape {b.shape} do not broadcast: "
            "give one normal, or as many in both."
        ) from error
    # Of unit vectors at an angle a, the difference is 2 sin(a / 2) and the sum 2 cos(a / 2).
    chords = np.stack([np.linalg.norm(difference, axis=-1), np.linalg.norm(total, axis=-1)])
    angle = np.degrees(2.0 * np.arctan2(chords.min(axis=0), chords.max(axis=0)))
    return float(angle) if angle.ndim == 0 else angle


def outlier_scores(y_true: "ArrayLike", y_pred: "ArrayLike") -> Bunch:
    """The five measures of an outlier detector as a classifier (Eqs. 20-24).

    Parameters
    ----------
    y_true, y_pred : array-like of shape (n_samples,)
        Truth and verdict: -1 for outliers, +1 for inliers, as from ``predict``.

    Returns
    -------
    scores : :class:`~sklearn.utils.Bunch`
        Floats in [0, 1]: ``true_positive_rate``, the share of the true outliers that are called
        outliers (Eq. 20), ``true_negative_rate``, that of inliers that are called inliers (Eq. 21),
        ``swamping_rate`` and ``masking_rate``, one minus the second and the first (Eqs. 22, 23),
        and ``accuracy``, the share of all labels that are right. The paper prints them times 100.
        The rates of a class that `y_true` lacks are NaN, with an ``UndefinedMetricWarning``.

    Raises
    ------
    ValueError
        If a label is neither -1 nor +1, or the lengths differ.

    See Also
    --------
    sklearn.metrics.accuracy_score : Eq. 24 alone.

    Examples
    --------
    >>> from sklearn_mcmd.metrics import outlier_scores
    >>> scores = outlier_scores([1, 1, 1, 1, -1], [1, 1, 1, -1, -1])
    >>> scores.accuracy, scores.swamping_rate, scores.masking_rate
    (0.8, 0.25, 0.0)
    """
    y_true, y_pred = _labels(y_true, "y_true"), _labels(y_pred, "y_pred")
    check_consistent_length(y_true, y_pred)
    counts = confusion_matrix(y_true, y_pred, labels=[-1, 1])
    totals = counts.sum(axis=1)
    for total, missing in zip(totals, ("outlier (-1)", "inlier (+1)"), strict=True):
        if total == 0:
            message = f"Rates are undefined and set to nan: y_true holds no {missing}."
            warnings.warn(message, UndefinedMetricWarning, stacklevel=2)
    with np.errstate(invalid="ignore"):
        (detected, missed), (swamped, kept) = (counts / totals[:, None]).tolist()
    return Bunch(
        true_positive_rate=detected,
        true_negative_rate=kept,
        swamping_rate=swamped,
        masking_rate=missed,
        accuracy=float(np.trace(counts) / totals.sum()),
    )


def _unit(normals, name):
    """Normals as float64 of length one; NaN rows stay NaN."""
    normals = check_array(
        normals,
        dtype=np.float64,
        ensure_2d=False,
        allow_nd=True,
        ensure_all_finite="allow-nan",
        ensure_min_samples=0,
        input_name=name,
    )
    if normals.ndim == 0 or normals.shape[-1] == 0:
        raise ValueError(f"{name} has no coordinates: give vectors of shape (..., n_features).")
    # Divided by the largest coordinate first, so that squares neither overflow nor vanish.
    largest = np.abs(normals).max(axis=-1, keepdims=True)
    if np.any(largest == 0):
        raise ValueError(
            f"{name} holds {(largest == 0).sum()} zero vectors: mark missing normals by NaN."
        )
    scaled = normals / largest
    return scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)


def _labels(y, name):
    y = column_or_1d(y)
    if y.size == 0:
        raise ValueError(f"{name} is empty: rates need at least one label.")
    values = np.unique(y)
    if y.dtype.kind not in "iuf" or not np.isin(values, (-1, 1)).all():
        raise ValueError(
            f"{name} holds the values {values[:5].tolist()}; outlier labels are -1 (outlier) and "
            f"+1 (inlier). Flags turn into labels by np.where(is_outlier, -1, 1)."
        )
    return y.astype(np.int8)
