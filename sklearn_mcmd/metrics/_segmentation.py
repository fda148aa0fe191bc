"""Segments against true surfaces: proper, over and under segmentation (Eqs. 26-28)."""

import warnings

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from sklearn.exceptions import UndefinedMetricWarning
from sklearn.metrics import adjusted_rand_score
from sklearn.utils import Bunch, check_consistent_length, column_or_1d


def segmentation_scores(
    y_true: "ArrayLike", y_pred: "ArrayLike", *, min_overlap: float = 0.8
) -> Bunch:
    """Proper, over and under segmentation, recall, precision and F (Eqs. 26-28).

    Each true surface has one of four outcomes. Its *main segment* is the one that holds most
    of its points. Among equals it is the one that fits best (largest intersection over union),
    then the one with the smallest label. The first rule that holds decides:

    1. The surface is missed if no more than 1 - `min_overlap` of its points are in any segment.
    2. It is under-segmented (US) if its main segment also holds `min_overlap` of another surface,
       or if less than `min_overlap` of the main segment belongs to this surface.
    3. It is over-segmented (OS) if the main segment holds less than `min_overlap` of it: it is
       broken or incomplete.
    4. It is properly segmented (PS).

    So if a road and a kerb are in one segment, both are under-segmented, even if the road is large.

    Parameters
    ----------
    y_true : array-like of int of shape (n_samples,)
        The surface of each point. Points of label -1 (outliers, unknown) are left out.
    y_pred : array-like of int of shape (n_samples,)
        The segment of each point; -1 for none.
    min_overlap : float in (0.5, 1], default=0.8
        Share that counts as the whole surface or segment. Above one half no point counts twice.

    Returns
    -------
    scores : :class:`~sklearn.utils.Bunch`
        - ``proper``, ``over``, ``under``, ``missed``: int, numbers of surfaces; they add up to
          the number of all surfaces;
        - ``recall``, PS / (PS + US), ``precision``, PS / (PS + OS), and ``f_score``, their
          harmonic mean 2 PS / (2 PS + OS + US): float in [0, 1], NaN, with an
          ``UndefinedMetricWarning``, where the divisor is zero. The paper prints them times 100;
        - ``mean_iou``: float, mean over surfaces of the intersection over union with the segment
          for which it is largest;
        - ``adjusted_rand``: float, scikit-learn's, with points of no segment as one cluster;
        - ``n_segments``: int, segments that hold points of a surface;
        - ``surfaces``, ``surface_sizes``, ``surface_iou``, ``surface_outcomes``: arrays of shape
          (n_surfaces,), the labels in `y_true`, their points, their intersection over union
          and "proper", "over", "under" or "missed".

    Raises
    ------
    ValueError
        If labels are not integers, the lengths differ, `y_true` names no surface, or
        `min_overlap` is outside (0.5, 1].

    See Also
    --------
    sklearn.metrics.adjusted_rand_score : Agreement of pairs of points, without outcomes.
    sklearn_mcmd.RegionGrowing : Segments a point cloud.

    Notes
    -----
    The paper does not say when a surface counts as properly segmented; its authors judged by
    eye. The rules here are like those of Hoover et al. [1]_, whose usual overlap is 0.8. But here
    a surface whose segment holds another one is never proper. Missed surfaces lower neither recall
    nor precision: look at ``missed``, or at ``mean_iou``, which they lower. In Table 6 the three
    counts also add up to less than the number of surfaces where some were missed.

    References
    ----------
    .. [1] A. Hoover et al., "An experimental comparison of range image segmentation
       algorithms", IEEE Transactions on Pattern Analysis and Machine Intelligence 18 (1996)
       673-689.

    Examples
    --------
    A road and a kerb in one segment, a wall in two, a sign as it should be:

    >>> from sklearn_mcmd.metrics import segmentation_scores
    >>> road, kerb, wall, sign = [0] * 20, [1] * 4, [2] * 10, [3] * 5
    >>> segments = [7] * 24 + [1] * 5 + [2] * 5 + [3] * 5
    >>> scores = segmentation_scores(road + kerb + wall + sign, segments)
    >>> scores.proper, scores.over, scores.under
    (1, 1, 2)
    >>> print(f"recall {scores.recall:.3f}, precision {scores.precision:.1f}")
    recall 0.333, precision 0.5
    """
    if not 0.5 < min_overlap <= 1:
        raise ValueError(f"min_overlap={min_overlap!r} must be above 0.5 and at most 1.")
    y_true, y_pred = _labels(y_true, "y_true"), _labels(y_pred, "y_pred")
    check_consistent_length(y_true, y_pred)
    is_labelled = y_true != -1
    if not is_labelled.any():
        raise ValueError("y_true names no surface: all its labels are -1.")
    y_true, y_pred = y_true[is_labelled], y_pred[is_labelled]
    surfaces, surface = np.unique(y_true, return_inverse=True)
    surface_sizes = np.bincount(surface)
    rows, segments, common, segment_sizes = _overlaps(surface, y_pred)

    # Shares of each pair of a surface and a segment with points in common.
    held = common / surface_sizes[rows]  # of the surface, by the segment
    pure = common / segment_sizes[segments]  # of the segment, by the surface
    iou = common / (surface_sizes[rows] + segment_sizes[segments] - common)
    best_iou = np.zeros(len(surfaces))
    np.maximum.at(best_iou, rows, iou)
    # The last of each surface's entries: most points, then best fit, then smallest label.
    order = np.lexsort((-segments, iou, common, rows))
    main = order[np.flatnonzero(np.diff(rows[order], append=-1))]
    n_held = np.bincount(segments[held >= min_overlap], minlength=len(segment_sizes))

    # The rules in reverse order: the first that holds is written last.
    covered = np.bincount(rows, common, len(surfaces)) / surface_sizes
    outcome = np.full(len(surfaces), "missed", dtype="<U6")
    row, share = rows[main], held[main]
    # Other surfaces of which the main segment holds enough.
    others = n_held[segments[main]] - (share >= min_overlap)
    fate = np.where(share < min_overlap, "over", "proper")
    fate = np.where((others > 0) | (pure[main] < min_overlap), "under", fate)
    outcome[row] = np.where(covered[row] <= 1 - min_overlap, "missed", fate)

    counts = {name: int((outcome == name).sum()) for name in ("proper", "over", "under", "missed")}
    proper, over, under = counts["proper"], counts["over"], counts["under"]
    return Bunch(
        **counts,
        recall=_ratio(proper, proper + under, "recall", "proper or under-segmented"),
        precision=_ratio(proper, proper + over, "precision", "proper or over-segmented"),
        f_score=_ratio(2 * proper, 2 * proper + over + under, "f_score", "segmented"),
        mean_iou=float(best_iou.mean()),
        adjusted_rand=float(adjusted_rand_score(y_true, y_pred)),
        n_segments=len(segment_sizes),
        surfaces=surfaces,
        surface_sizes=surface_sizes,
        surface_iou=best_iou,
        surface_outcomes=outcome,
    )


def _overlaps(surface, y_pred):
    """Surfaces and segments with points in common, these points' numbers, and segment sizes."""
    inside = np.flatnonzero(y_pred != -1)
    names, segment = np.unique(y_pred[inside], return_inverse=True)
    shape = (int(surface.max()) + 1, len(names))
    table = coo_array((np.ones(len(inside), np.int64), (surface[inside], segment)), shape=shape)
    table = table.tocsr().tocoo()  # adds up entries at the same place
    rows, columns = table.row, table.col
    return rows, columns, table.data, np.bincount(segment, minlength=len(names))


def _labels(y: "ArrayLike", name: str) -> NDArray[np.integer]:
    labels: NDArray[np.integer] = column_or_1d(y)
    if labels.dtype.kind not in "iu":
        raise ValueError(f"{name} has dtype {labels.dtype}; labels are integers, -1 for none.")
    return labels


def _ratio(part, total, name, kind):
    if total == 0:
        warnings.warn(
            f"{name} is undefined and set to nan: no surface is {kind}.",
            UndefinedMetricWarning,
            stacklevel=3,
        )
        return np.nan
    return part / total
