"""Results as pictures, in the manner of scikit-learn's displays."""

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
from sklearn_mcmd.plotting._still import (
    check_points,
    color_modules,
    draw_ball,
    normal_colors,
    region_colors,
)

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


class NormalsDisplay(CloudDisplay):
    """Normals of a cloud as colors of a lit solid, with a ball as their legend.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        The cloud.
    normals : array-like of shape (n, 3)
        Unit normals; their sign does not matter.

    See Also
    --------
    sklearn_mcmd.RobustNormalEstimator : Estimates normals.
    normal_colors : The colors.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.plotting import NormalsDisplay
    >>> ball = np.random.default_rng(0).normal(size=(500, 3))
    >>> ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    >>> display = NormalsDisplay.from_predictions(ball, ball)
    >>> display.ax_.get_title()
    'Normals of 500 points'
    """

    def __init__(self, xyz: ArrayLike, normals: ArrayLike) -> None:
        self.xyz = check_points(xyz, finite=True)
        self.normals = check_points(normals, "normals")
        if len(self.normals) != len(self.xyz):
            raise ValueError(f"normals has {len(self.normals)} rows, the cloud {len(self.xyz)}.")

    @classmethod
    def from_predictions(cls, X: ArrayLike, normals: ArrayLike, **options: Any) -> Self:
        """Draw normals: X is the cloud, `normals` as of the class; options are for :meth:`plot`."""
        return cls(X, normals).plot(**options)

    @staticmethod
    def _found_by(estimator, X):
        return (estimator.normals_,)

    def _picture(self, view):
        colors = normal_colors(self.normals, view=view)
        title = f"Normals of {len(self.xyz):,} points"
        return Picture(colors, np.zeros(len(self.xyz)), title, lambda ax: draw_ball(ax, view))


class SegmentationDisplay(CloudDisplay):
    """Regions of a cloud, a color for each; points of none are dark.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        The cloud.
    labels : array-like of int of shape (n,)
        Regions from 0 on; negative ones are none.

    See Also
    --------
    sklearn_mcmd.RegionGrowing : Finds regions.
    region_colors : The colors.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.plotting import SegmentationDisplay
    >>> xyz = np.random.default_rng(0).uniform(size=(500, 3))
    >>> labels = np.where(xyz[:, 0] < 0.1, -1, xyz[:, 1] > 0.5)
    >>> display = SegmentationDisplay.from_predictions(xyz, labels, view="top")
    >>> display.ax_.get_title()
    '2 regions, 89.00 % of 500 points'
    """

    def __init__(self, xyz: ArrayLike, labels: ArrayLike) -> None:
        self.xyz = check_points(xyz, finite=True)
        self.labels = _whole(one_for_each(labels, self.xyz, "labels"), "labels")

    @classmethod
    def from_predictions(cls, X: ArrayLike, labels: ArrayLike, **options: Any) -> Self:
        """Draw regions: X is the cloud, `labels` as of the class; options are for :meth:`plot`."""
        return cls(X, labels).plot(**options)

    @staticmethod
    def _found_by(estimator, X):
        return (estimator.labels_,)

    def _picture(self, view):
        inside = self.labels >= 0
        n = len(np.unique(self.labels[inside]))
        title = f"{n:,} regions, {100 * inside.mean():.2f} % of {len(inside):,} points"
        return Picture(region_colors(self.labels), self.labels, title)


class EdgeDisplay(CloudDisplay):
    """Edges of a cloud.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        The cloud.
    is_edge : array-like of bool of shape (n,)
        Points of edges.

    See Also
    --------
    sklearn_mcmd.SharpFeatureDetector : Finds edges.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.plotting import EdgeDisplay
    >>> xyz = np.random.default_rng(0).uniform(size=(500, 3))
    >>> display = EdgeDisplay.from_predictions(xyz, np.where(xyz[:, 0] < 0.05, -1, 1))
    >>> display.ax_.get_title()
    '29 of 500 points are edges (5.80 %)'
    """

    def __init__(self, xyz: ArrayLike, is_edge: ArrayLike) -> None:
        self.xyz = check_points(xyz, finite=True)
        self.is_edge = one_for_each(is_edge, self.xyz, "is_edge").astype(bool)

    @classmethod
    def from_predictions(cls, X: ArrayLike, y_pred: ArrayLike, **options: Any) -> Self:
        """Draw edges: X is the cloud, `y_pred` is -1 for points of edges; options are for
        :meth:`plot`."""
        return cls(X, is_minus_one(y_pred, "y_pred")).plot(**options)

    @staticmethod
    def _found_by(estimator, X):
        return (np.where(estimator.scores_ < estimator.offset_, -1, 1),)

    def _picture(self, view):
        n, n_all = np.count_nonzero(self.is_edge), len(self.is_edge)
        title = f"{n:,} of {n_all:,} points are edges ({100 * n / n_all:.2f} %)"
        return Picture(choose_colors([self.is_edge], [FOUND], REGULAR), self.is_edge, title)


class PlaneResidualDisplay(CloudDisplay):
    """Residuals of one plane, seen along its normal; outliers are larger.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        The points.
    residuals : array-like of shape (n,)
        Their residuals.
    is_outlier : array-like of bool of shape (n,)
        The verdict.

    See Also
    --------
    sklearn_mcmd.adjustment.plot_report : All figures of a plane test.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.plotting import PlaneResidualDisplay
    >>> xyz = np.random.default_rng(0).normal(size=(500, 3)) * [1, 1, 0.01]
    >>> outliers = np.where(abs(xyz[:, 2]) > 0.025, -1, 1)
    >>> display = PlaneResidualDisplay.from_predictions(xyz, xyz[:, 2], outliers)
    >>> display.ax_.get_title()
    'Residuals of 500 points, 7 outliers'
    """

    def __init__(self, xyz: ArrayLike, residuals: ArrayLike, is_outlier: ArrayLike) -> None:
        self.xyz = check_points(xyz, finite=True)
        self.residuals = one_for_each(residuals, self.xyz, "residuals").astype(np.float64)
        self.is_outlier = one_for_each(is_outlier, self.xyz, "is_outlier").astype(bool)

    @classmethod
    def from_predictions(
        cls, X: ArrayLike, residuals: ArrayLike, y_pred: ArrayLike, **options: Any
    ) -> Self:
        """Draw residuals: X has the points, `y_pred` is -1 for outliers; options are for
        :meth:`plot`."""
        return cls(X, residuals, is_minus_one(y_pred, "y_pred")).plot(**options)

    @staticmethod
    def _found_by(estimator, X):
        return estimator.residuals(X), estimator.labels_

    def _usual_view(self):
        return along_normal(self.xyz[those_of_plane(self.is_outlier)])

    def _picture(self, view):
        cm, colors = color_modules()
        # Three standard deviations of what is kept; an outlier would take the contrast of all.
        kept = self.residuals[those_of_plane(self.is_outlier)]
        reach = 3 * np.sqrt(np.mean(kept**2)) or 1.0
        shade = cm.ScalarMappable(colors.Normalize(-reach, reach, clip=True), "RdBu_r")
        n = np.count_nonzero(self.is_outlier)
        title = f"Residuals of {len(self.xyz):,} points, {n:,} outliers"
        return Picture(
            shade.to_rgba(self.residuals)[:, :3],
            self.is_outlier,
            title,
            lambda ax: ax.figure.colorbar(
                shade, ax=ax, label="residual", shrink=0.7, extend="both"
            ),
        )


def those_of_plane(is_outlier):
    """The points that are no outliers; all if there are none."""
    return is_outlier if is_outlier.all() else ~is_outlier


def along_normal(points):
    """The camera that looks at a plane from its front, upright."""
    centered = points - points.mean(axis=0)
    x, y, z = np.linalg.eigh(centered.T @ centered)[1][:, 0]
    if y > 0 or (y == 0 and (x < 0 or (x == 0 and z < 0))):
        x, y, z = -x, -y, -z
    if abs(z) > np.hypot(x, y):  # floors are seen from above
        return -90.0, 90.0
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arcsin(np.clip(z, -1, 1))))


def _whole(values, name):
    """Numbers as int64, if they are whole."""
    numbers = values.dtype.kind in "biuf" and np.isfinite(values).all()
    if not numbers or not np.array_equal(values, np.rint(values)):
        raise ValueError(f"{name} must be whole numbers without NaN.")
    return values.astype(np.int64)
