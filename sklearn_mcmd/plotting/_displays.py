"""Results of estimators as pictures, in the manner of scikit-learn's displays."""

from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.plotting._still import (
    check_points,
    draw_ball,
    normal_colors,
    plot_cloud,
    region_colors,
)
from sklearn_mcmd.plotting._views import thinned

if TYPE_CHECKING:
    from typing import Self

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "EdgeDisplay",
    "NormalsDisplay",
    "OutlierDisplay",
    "PlaneResidualDisplay",
    "SegmentationDisplay",
]

MOST_DRAWN = 200_000  # points; more take long and cover each other
# Okabe and Ito's colors, which the common color blindnesses keep apart.
REGULAR, FOUND, MISSED, WRONG = "#c3cad4", "#d55e00", "#0072b2", "#e69f00"
EDGE = "#d55e00"

View = str | tuple[float, float]


class _CloudDisplay:
    """What all displays of clouds share: points, a label for thinning, and the axes."""

    xyz: NDArray[np.float64]
    ax_: "Axes"
    figure_: "Figure"

    def _draw(self, colors, labels, title, *, view, max_points, ax, outliers=None, scale_bar=True):
        """Draw at most `max_points` points; rare labels keep more of theirs."""
        _check_count(max_points, "max_points")
        rows = thinned(labels, max_points)
        self.ax_ = plot_cloud(
            self.xyz[rows],
            color=colors[rows],
            outliers=None if outliers is None else outliers[rows],
            view=view,
            scale_bar=scale_bar,
            ax=ax,
        )
        self.ax_.set_title(title, fontsize=12, color="0.2")
        self.figure_ = self.ax_.figure  # type: ignore[assignment]
        return self

    def _key(self, entries):
        """A legend of colors and texts."""
        lines = import_extra("matplotlib.lines", "plot", "Plotting")
        marks = [
            lines.Line2D([], [], ls="", marker="o", ms=6, mfc=color, mec="none", label=text)
            for color, text in entries
        ]
        self.ax_.legend(handles=marks, loc="upper right", frameon=False, fontsize=9)


class OutlierDisplay(_CloudDisplay):
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

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        Axes of the last plot.
    figure_ : matplotlib.figure.Figure
        Its figure.

    See Also
    --------
    sklearn_mcmd.MCMDOutlierDetector : Finds outliers.

    Examples
    --------
    >>> import matplotlib
    >>> matplotlib.use("agg")
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
        self.is_outlier = _column(is_outlier, self.xyz, "is_outlier").astype(bool)
        self.scores = None if scores is None else _column(scores, self.xyz, "scores")
        self.is_true_outlier = (
            None
            if is_true_outlier is None
            else _column(is_true_outlier, self.xyz, "is_true_outlier").astype(bool)
        )

    @classmethod
    def from_estimator(
        cls, estimator: Any, X: ArrayLike, y: ArrayLike | None = None, **options: Any
    ) -> "Self":
        """Draw the verdict of a fitted detector.

        Parameters
        ----------
        estimator : fitted outlier detector
            With `predict` and `score_samples`, such as
            :class:`~sklearn_mcmd.MCMDOutlierDetector`.
        X : array-like of shape (n, 3)
            Points to judge.
        y : array-like of shape (n,), default=None
            The truth, -1 for outliers.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        OutlierDisplay
            The display, drawn.
        """
        scores = -estimator.score_samples(X)
        return cls.from_predictions(X, estimator.predict(X), scores=scores, y_true=y, **options)

    @classmethod
    def from_predictions(
        cls,
        X: ArrayLike,
        y_pred: ArrayLike,
        *,
        scores: ArrayLike | None = None,
        y_true: ArrayLike | None = None,
        **options: Any,
    ) -> "Self":
        """Draw a verdict.

        Parameters
        ----------
        X : array-like of shape (n, 3)
            The cloud.
        y_pred : array-like of shape (n,)
            -1 for outliers, as detectors of scikit-learn have it.
        scores : array-like of shape (n,), default=None
            Scores, larger for outliers.
        y_true : array-like of shape (n,), default=None
            The truth, -1 for outliers.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        OutlierDisplay
            The display, drawn.
        """
        true = None if y_true is None else np.asarray(y_true) == -1
        display = cls(X, np.asarray(y_pred) == -1, scores=scores, is_true_outlier=true)
        return display.plot(**options)

    def plot(
        self,
        *,
        show: Literal["verdict", "scores"] = "verdict",
        view: View = "perspective",
        max_points: int = MOST_DRAWN,
        ax: "Axes | None" = None,
    ) -> "Self":
        """Draw the cloud.

        Parameters
        ----------
        show : {"verdict", "scores"}, default="verdict"
            Colors by the verdict, or by scores up to 10, a clear error.
        view : {"top", "front", "side", "perspective"} or tuple of two floats
            The camera, as in :func:`plot_cloud`.
        max_points : int, default=200_000
            Points to draw. Of more, so many are chosen at random, rare classes more often.
        ax : matplotlib.axes.Axes, default=None
            Axes to draw on. None makes a figure.

        Returns
        -------
        OutlierDisplay
            The display.
        """
        if show not in ("verdict", "scores"):
            raise ValueError(f"show={show!r} is unknown; known are 'verdict' and 'scores'.")
        flagged, true = self.is_outlier, self.is_true_outlier
        n, n_all = np.count_nonzero(flagged), len(flagged)
        title = f"{n:,} of {n_all:,} points are outliers ({100 * n / n_all:.2f} %)"
        options = {"view": view, "max_points": max_points, "ax": ax}
        if show == "scores":
            if self.scores is None:
                raise ValueError("show='scores' needs scores.")
            return self._draw_scores(title, options)
        if true is None:
            colors = _choose([flagged], [FOUND], REGULAR)
            return self._draw(colors, flagged, title, **options)
        kinds = [flagged & true, ~flagged & true, flagged & ~true]
        colors = _choose(kinds, [FOUND, MISSED, WRONG], REGULAR)
        self._draw(colors, np.select(kinds, [1, 2, 3], 0), title, **options)
        names = ("found", "missed", "wrongly flagged")
        texts = [f"{name}: {np.count_nonzero(k):,}" for name, k in zip(names, kinds, strict=True)]
        self._key(zip((FOUND, MISSED, WRONG), texts, strict=True))
        return self

    def _draw_scores(self, title, options):
        from matplotlib import cm, colors

        norm = colors.Normalize(0, 10, clip=True)
        shade = cm.ScalarMappable(norm, "viridis")
        self._draw(shade.to_rgba(self.scores)[:, :3], self.is_outlier, title, **options)
        self.figure_.colorbar(shade, ax=self.ax_, label="score", shrink=0.6, extend="max")
        return self


class NormalsDisplay(_CloudDisplay):
    """Normals of a cloud as colors of a lit solid, with a ball that tells them.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        The cloud.
    normals : array-like of shape (n, 3)
        Unit normals; their sign does not matter.

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        Axes of the last plot.
    figure_ : matplotlib.figure.Figure
        Its figure.

    See Also
    --------
    sklearn_mcmd.RobustNormalEstimator : Estimates normals.
    normal_colors : The colors.

    Examples
    --------
    >>> import matplotlib
    >>> matplotlib.use("agg")
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
    def from_estimator(cls, estimator: Any, X: ArrayLike, **options: Any) -> "Self":
        """Draw the normals of a fitted estimator.

        Parameters
        ----------
        estimator : RobustNormalEstimator
            Fitted to X.
        X : array-like of shape (n, 3)
            The cloud.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        NormalsDisplay
            The display, drawn.
        """
        return cls.from_predictions(X, estimator.normals_, **options)

    @classmethod
    def from_predictions(cls, X: ArrayLike, normals: ArrayLike, **options: Any) -> "Self":
        """Draw normals.

        Parameters
        ----------
        X : array-like of shape (n, 3)
            The cloud.
        normals : array-like of shape (n, 3)
            Its normals.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        NormalsDisplay
            The display, drawn.
        """
        return cls(X, normals).plot(**options)

    def plot(
        self,
        *,
        view: View = "perspective",
        max_points: int = MOST_DRAWN,
        ax: "Axes | None" = None,
    ) -> "Self":
        """Draw the cloud.

        Parameters
        ----------
        view : {"top", "front", "side", "perspective"} or tuple of two floats
            The camera, as in :func:`plot_cloud`.
        max_points : int, default=200_000
            Points to draw. Of more, so many are chosen at random.
        ax : matplotlib.axes.Axes, default=None
            Axes to draw on. None makes a figure.

        Returns
        -------
        NormalsDisplay
            The display.
        """
        colors, labels = normal_colors(self.normals, view=view), np.zeros(len(self.xyz))
        title = f"Normals of {len(self.xyz):,} points"
        self._draw(colors, labels, title, view=view, max_points=max_points, ax=ax)
        draw_ball(self.ax_, view)
        return self


class SegmentationDisplay(_CloudDisplay):
    """Regions of a cloud, a color for each; points of none are dark.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        The cloud.
    labels : array-like of int of shape (n,)
        Regions from 0 on; negative ones are none.

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        Axes of the last plot.
    figure_ : matplotlib.figure.Figure
        Its figure.

    See Also
    --------
    sklearn_mcmd.RegionGrowing : Finds regions.
    region_colors : The colors.

    Examples
    --------
    >>> import matplotlib
    >>> matplotlib.use("agg")
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
        self.labels = _whole(_column(labels, self.xyz, "labels"), "labels")

    @classmethod
    def from_estimator(cls, estimator: Any, X: ArrayLike, **options: Any) -> "Self":
        """Draw the regions of a fitted estimator.

        Parameters
        ----------
        estimator : RegionGrowing or another clusterer with `labels_`
            Fitted to X.
        X : array-like of shape (n, 3 or more)
            The cloud; coordinates are its first three columns.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        SegmentationDisplay
            The display, drawn.
        """
        return cls.from_predictions(np.asarray(X)[:, :3], estimator.labels_, **options)

    @classmethod
    def from_predictions(cls, X: ArrayLike, labels: ArrayLike, **options: Any) -> "Self":
        """Draw regions.

        Parameters
        ----------
        X : array-like of shape (n, 3)
            The cloud.
        labels : array-like of int of shape (n,)
            Regions from 0 on; negative ones are none.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        SegmentationDisplay
            The display, drawn.
        """
        return cls(X, labels).plot(**options)

    def plot(
        self,
        *,
        view: View = "perspective",
        max_points: int = MOST_DRAWN,
        ax: "Axes | None" = None,
    ) -> "Self":
        """Draw the cloud.

        Parameters
        ----------
        view : {"top", "front", "side", "perspective"} or tuple of two floats
            The camera, as in :func:`plot_cloud`.
        max_points : int, default=200_000
            Points to draw. Of more, so many are chosen at random, those of small regions more
            often.
        ax : matplotlib.axes.Axes, default=None
            Axes to draw on. None makes a figure.

        Returns
        -------
        SegmentationDisplay
            The display.
        """
        inside = self.labels >= 0
        n = len(np.unique(self.labels[inside]))
        title = f"{n:,} regions, {100 * inside.mean():.2f} % of {len(inside):,} points"
        colors = region_colors(self.labels)
        return self._draw(colors, self.labels, title, view=view, max_points=max_points, ax=ax)


class EdgeDisplay(_CloudDisplay):
    """Edges of a cloud.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        The cloud.
    is_edge : array-like of bool of shape (n,)
        Points of edges.

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        Axes of the last plot.
    figure_ : matplotlib.figure.Figure
        Its figure.

    See Also
    --------
    sklearn_mcmd.SharpFeatureDetector : Finds edges.

    Examples
    --------
    >>> import matplotlib
    >>> matplotlib.use("agg")
    >>> import numpy as np
    >>> from sklearn_mcmd.plotting import EdgeDisplay
    >>> xyz = np.random.default_rng(0).uniform(size=(500, 3))
    >>> display = EdgeDisplay.from_predictions(xyz, np.where(xyz[:, 0] < 0.05, -1, 1))
    >>> display.ax_.get_title()
    '29 of 500 points are edges (5.80 %)'
    """

    def __init__(self, xyz: ArrayLike, is_edge: ArrayLike) -> None:
        self.xyz = check_points(xyz, finite=True)
        self.is_edge = _column(is_edge, self.xyz, "is_edge").astype(bool)

    @classmethod
    def from_estimator(cls, estimator: Any, X: ArrayLike, **options: Any) -> "Self":
        """Draw the edges of a fitted detector.

        Parameters
        ----------
        estimator : SharpFeatureDetector
            Fitted to X.
        X : array-like of shape (n, 3 or more)
            The cloud; coordinates are its first three columns.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        EdgeDisplay
            The display, drawn.
        """
        labels = np.where(estimator.scores_ < estimator.offset_, -1, 1)
        return cls.from_predictions(np.asarray(X)[:, :3], labels, **options)

    @classmethod
    def from_predictions(cls, X: ArrayLike, y_pred: ArrayLike, **options: Any) -> "Self":
        """Draw edges.

        Parameters
        ----------
        X : array-like of shape (n, 3)
            The cloud.
        y_pred : array-like of shape (n,)
            -1 for points of edges.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        EdgeDisplay
            The display, drawn.
        """
        return cls(X, np.asarray(y_pred) == -1).plot(**options)

    def plot(
        self,
        *,
        view: View = "perspective",
        max_points: int = MOST_DRAWN,
        ax: "Axes | None" = None,
    ) -> "Self":
        """Draw the cloud.

        Parameters
        ----------
        view : {"top", "front", "side", "perspective"} or tuple of two floats
            The camera, as in :func:`plot_cloud`.
        max_points : int, default=200_000
            Points to draw. Of more, so many are chosen at random, edges more often.
        ax : matplotlib.axes.Axes, default=None
            Axes to draw on. None makes a figure.

        Returns
        -------
        EdgeDisplay
            The display.
        """
        n, n_all = np.count_nonzero(self.is_edge), len(self.is_edge)
        title = f"{n:,} of {n_all:,} points are edges ({100 * n / n_all:.2f} %)"
        colors = _choose([self.is_edge], [EDGE], REGULAR)
        return self._draw(colors, self.is_edge, title, view=view, max_points=max_points, ax=ax)


class PlaneResidualDisplay(_CloudDisplay):
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

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        Axes of the last plot.
    figure_ : matplotlib.figure.Figure
        Its figure.

    See Also
    --------
    sklearn_mcmd.adjustment.plot_report : All figures of a plane test.

    Examples
    --------
    >>> import matplotlib
    >>> matplotlib.use("agg")
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
        self.residuals = _column(residuals, self.xyz, "residuals").astype(np.float64)
        self.is_outlier = _column(is_outlier, self.xyz, "is_outlier").astype(bool)

    @classmethod
    def from_estimator(cls, estimator: Any, X: ArrayLike, **options: Any) -> "Self":
        """Draw the residuals of a fitted plane test.

        Parameters
        ----------
        estimator : BaardaPlaneDetector or FuzzyPlaneDetector
            Fitted to X.
        X : array-like of shape (n, 3)
            The points.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        PlaneResidualDisplay
            The display, drawn.
        """
        return cls.from_predictions(X, estimator.residuals(X), estimator.labels_, **options)

    @classmethod
    def from_predictions(
        cls, X: ArrayLike, residuals: ArrayLike, y_pred: ArrayLike, **options: Any
    ) -> "Self":
        """Draw residuals.

        Parameters
        ----------
        X : array-like of shape (n, 3)
            The points.
        residuals : array-like of shape (n,)
            Their residuals.
        y_pred : array-like of shape (n,)
            -1 for outliers.
        **options : dict
            For :meth:`plot`.

        Returns
        -------
        PlaneResidualDisplay
            The display, drawn.
        """
        return cls(X, residuals, np.asarray(y_pred) == -1).plot(**options)

    def plot(
        self,
        *,
        view: View | None = None,
        max_points: int = MOST_DRAWN,
        ax: "Axes | None" = None,
    ) -> "Self":
        """Draw the points.

        Parameters
        ----------
        view : {"top", "front", "side", "perspective"} or tuple of two floats, default=None
            The camera, as in :func:`plot_cloud`. None looks along the normal.
        max_points : int, default=200_000
            Points to draw. Of more, so many are chosen at random, outliers more often.
        ax : matplotlib.axes.Axes, default=None
            Axes to draw on. None makes a figure.

        Returns
        -------
        PlaneResidualDisplay
            The display.
        """
        from matplotlib import cm, colors

        kept = ~self.is_outlier if not self.is_outlier.all() else self.is_outlier
        # Three standard deviations of what is kept; an outlier would take the contrast of all.
        reach = 3 * np.sqrt(np.mean(self.residuals[kept] ** 2)) or 1.0
        shade = cm.ScalarMappable(colors.Normalize(-reach, reach, clip=True), "RdBu_r")
        n = np.count_nonzero(self.is_outlier)
        title = f"Residuals of {len(self.xyz):,} points, {n:,} outliers"
        paint = shade.to_rgba(self.residuals)[:, :3]
        view = _along_normal(self.xyz[kept]) if view is None else view
        self._draw(paint, self.is_outlier, title, view=view, max_points=max_points, ax=ax)
        self.figure_.colorbar(shade, ax=self.ax_, label="residual", shrink=0.7, extend="both")
        return self


def _along_normal(points):
    """The camera that looks at a plane from its front, upright."""
    centered = points - points.mean(axis=0)
    x, y, z = np.linalg.eigh(centered.T @ centered)[1][:, 0]
    if y > 0 or (y == 0 and (x < 0 or (x == 0 and z < 0))):
        x, y, z = -x, -y, -z
    if abs(z) > np.hypot(x, y):  # floors are seen from above
        return -90.0, 90.0
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arcsin(np.clip(z, -1, 1))))


def _choose(masks, chosen, otherwise):
    """The color of the first mask that holds, for each point."""
    from matplotlib.colors import to_rgb

    colors = np.tile(to_rgb(otherwise), (len(masks[0]), 1))
    for mask, color in zip(masks, chosen, strict=True):
        colors[mask] = to_rgb(color)
    return colors


def _check_count(value, name):
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
        raise ValueError(f"{name} must be a whole number of at least 1, got {value!r}.")


def _whole(values, name):
    """Numbers as int64, if they are whole."""
    numbers = values.dtype.kind in "biuf" and np.isfinite(values).all()
    if not numbers or not np.array_equal(values, np.rint(values)):
        raise ValueError(f"{name} must be whole numbers without NaN.")
    return values.astype(np.int64)


def _column(values, points, name):
    values = np.asarray(values)
    if values.shape != (len(points),):
        raise ValueError(f"{name} must have shape ({len(points)},), got {values.shape}.")
    return values
