"""Verdicts about outliers as a picture."""

from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd.plotting._cloud_display import (
    FOUND,
    MOST_DRAWN,
    REGULAR,
    CloudDisplay,
    Picture,
    View,
    add_legend,
    choose_colors,
    is_minus_one,
    one_for_each,
)
from sklearn_mcmd.plotting._still import check_points, color_modules

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MISSED, WRONG = "#0072b2", "#e69f00"  # beside FOUND, of the same palette


class OutlierDisplay(CloudDisplay):
    """Outliers of a cloud; with the truth, also missed ones and wrongly flagged points.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        The cloud.
    is_outlier : array-like of bool of shape (n,)
        The verdict.
    scores : array-like of shape (n,), default=None
        Scores, larger for outliers.
    is_true_outlier : array-like of bool of shape (n,), default=None
        The truth.

    See Also
    --------
    sklearn_mcmd.MCMDOutlierDetector : Finds outliers.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.plotting import OutlierDisplay
    >>> xyz = np.random.default_rng(0).normal(size=(500, 3))
    >>> display = OutlierDisplay.from_predictions(xyz, np.where(xyz[:, 2] > 2, -1, 1))
    >>> display.ax_.get_title()
    '8 of 500 points are outliers (1.60 %)'
    """

    def __init__(
        self,
        xyz: ArrayLike,
        is_outlier: ArrayLike,
        *,
        scores: ArrayLike | None = None,
        is_true_outlier: ArrayLike | None = None,
    ) -> None:
        self.xyz = check_points(xyz, finite=True)
        self.is_outlier = one_for_each(is_outlier, self.xyz, "is_outlier", bool)
        self.scores = self.is_true_outlier = None
        if scores is not None:
            self.scores = one_for_each(scores, self.xyz, "scores")
        if is_true_outlier is not None:
            self.is_true_outlier = one_for_each(is_true_outlier, self.xyz, "is_true_outlier", bool)

    @classmethod
    def from_estimator(
        cls, estimator: Any, X: ArrayLike, y: ArrayLike | None = None, **options: Any
    ) -> Self:
        """Draw the verdict of a fitted detector on points X (n, 3); the truth `y`, if it is known,
        is -1 for outliers, and options are for :meth:`plot`."""
        scores = -estimator.score_samples(X)
        return super().from_estimator(estimator, X, scores=scores, y_true=y, **options)

    @classmethod
    def from_predictions(
        cls,
        X: ArrayLike,
        y_pred: ArrayLike,
        *,
        scores: ArrayLike | None = None,
        y_true: ArrayLike | None = None,
        **options: Any,
    ) -> Self:
        """Draw a verdict: X is the cloud, `y_pred` and the truth `y_true` are -1 for outliers, as
        detectors of scikit-learn have it; `scores` as of the class, options are for :meth:`plot`.
        """
        true = None if y_true is None else is_minus_one(y_true, "y_true")
        found = is_minus_one(y_pred, "y_pred")
        return cls(X, found, scores=scores, is_true_outlier=true).plot(**options)

    def plot(
        self,
        *,
        show: Literal["verdict", "scores"] = "verdict",
        view: View | None = None,
        max_points: int = MOST_DRAWN,
        ax: "Axes | None" = None,
    ) -> Self:
        """Draw the cloud.

        Parameters
        ----------
        show : {"verdict", "scores"}, default="verdict"
            Colors by the verdict, or by scores up to 10, a clear error.
        view, max_points, ax
            As for :meth:`EdgeDisplay.plot`.

        Returns
        -------
        OutlierDisplay
        """
        if show not in ("verdict", "scores"):
            raise ValueError(f"show={show!r} is unknown; known are 'verdict' and 'scores'.")
        if show == "scores" and self.scores is None:
            raise ValueError("show='scores' needs scores.")
        view = self._usual_view() if view is None else view
        picture = self._scores_picture() if show == "scores" else self._picture(view)
        return self._draw(picture, view, max_points, ax)

    @staticmethod
    def _found_by(estimator, X):
        return (estimator.predict(X),)

    def _picture(self, view):
        flagged, true = self.is_outlier, self.is_true_outlier
        if true is None:
            return Picture(choose_colors([flagged], [FOUND], REGULAR), flagged, self._title())
        kinds = [flagged & true, ~flagged & true, flagged & ~true]
        names = ("found", "missed", "wrongly flagged")
        texts = [f"{name}: {np.count_nonzero(k):,}" for name, k in zip(names, kinds, strict=True)]
        shades = (FOUND, MISSED, WRONG)
        return Picture(
            choose_colors(kinds, shades, REGULAR),
            np.select(kinds, [1, 2, 3], 0),
            self._title(),
            lambda ax: add_legend(ax, zip(shades, texts, strict=True)),
        )

    def _scores_picture(self):
        cm, colors = color_modules()
        norm = colors.Normalize(0, 10, clip=True)
        shade = cm.ScalarMappable(norm, "viridis")
        return Picture(
            shade.to_rgba(self.scores)[:, :3],
            self.is_outlier,
            self._title(),
            lambda ax: ax.figure.colorbar(shade, ax=ax, label="score", shrink=0.6, extend="max"),
        )

    def _title(self):
        n, n_all = np.count_nonzero(self.is_outlier), len(self.is_outlier)
        return f"{n:,} of {n_all:,} points are outliers ({100 * n / n_all:.2f} %)"
