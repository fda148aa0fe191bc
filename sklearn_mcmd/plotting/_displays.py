"""Results as pictures, in the manner of scikit-learn's displays."""

from abc import ABC, abstractmethod
from inspect import signature
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._errors import counted
from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.plotting._still import (
    check_points,
    color_modules,
    draw_ball,
    normal_colors,
    plot_cloud,
    region_colors,
)
from sklearn_mcmd.plotting._views import thinned
from sklearn_mcmd.view._page import check_count

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_DRAWN = 200_000  # points; more take long and cover each other
# Okabe and Ito's colors, which the common color blindnesses keep apart.
REGULAR, FOUND = "#c3cad4", "#d55e00"
MISSED, WRONG = "#0072b2", "#e69f00"

View = str | tuple[float, float]


class Picture(NamedTuple):
    """What a display draws."""

    colors: NDArray[np.floating]  # (n, 3)
    labels: NDArray[Any]  # of clouds with too many points, rare labels keep more of theirs
    title: str
    complete: "Callable[[Axes], object] | None" = None  # adds a legend or the like to the axes


class CloudDisplay(ABC):
    """What all displays of clouds share: where they come from, how they are drawn, and on what.

    A subclass takes the cloud, and what was found in it.
    """

    _ax: "Axes"  # of the last plot

    def __init__(self, X: "ArrayLike") -> None:
        self.xyz = check_points(X, finite=True)

    @classmethod
    def from_estimator(cls, estimator: Any, X: "ArrayLike", **options: Any) -> Self:
        """Draw what an estimator found in X (n, 3 or more), to which it is fitted.

        The first three columns are coordinates, and options as in `from_predictions`.
        """
        return cls.from_predictions(np.asarray(X)[:, :3], *cls._found_by(estimator, X), **options)

    @classmethod
    def from_predictions(cls, X: "ArrayLike", *found: "ArrayLike", **options: Any) -> Self:
        """Draw what was found in a cloud.

        The arguments are those of the class, by place or name, and options for :meth:`plot`.
        """
        own = signature(cls).parameters.keys() & options.keys()
        return cls(X, *found, **{name: options.pop(name) for name in own}).plot(**options)

    def plot(
        self, *, view: View | None = None, max_points: int = MOST_DRAWN, ax: "Axes | None" = None
    ) -> Self:
        """Draw the cloud.

        Parameters
        ----------
        view : {"top", "front", "side", "perspective"} or tuple of two floats, default=None
            The camera, as in :func:`plot_cloud`. None is "perspective", or where residuals of a
            plane are drawn, along its normal.
        max_points : int, default=200_000
            Points to draw. Of more, so many are chosen at random, rare classes more often.
        ax : matplotlib.axes.Axes, default=None
            Axes to draw on. None makes a figure.
        """
        check_count(max_points, "max_points")
        view = self._usual_view() if view is None else view
        picture = self._picture(view)
        rows = thinned(picture.labels, max_points)
        self._ax = plot_cloud(
            self.xyz[rows], color=picture.colors[rows], view=view, scale_bar=True, ax=ax
        )
        self._ax.set_title(picture.title, fontsize=12, color="0.2")
        if picture.complete is not None:
            picture.complete(self._ax)
        return self

    @property
    def ax_(self) -> "Axes":
        """Axes of the last plot."""
        return self._ax

    @property
    def figure_(self) -> "Figure":
        """Figure of the last plot."""
        return self._ax.figure  # type: ignore[return-value]

    @staticmethod
    @abstractmethod
    def _found_by(estimator: Any, X: "ArrayLike") -> tuple[Any, ...]:
        """What the class takes behind the points."""

    @abstractmethod
    def _picture(self, view: View) -> Picture:
        """What is drawn, seen from there."""

    def _usual_view(self) -> View:
        return "perspective"


class OutlierDisplay(CloudDisplay):
    """Outliers of a cloud; with the truth, also missed ones and wrongly flagged points.

    Parameters
    ----------
    X : array-like of shape (n, 3)
        The cloud.
    y_pred : array-like of int of shape (n,)
        The verdict: -1 for outliers, as detectors of scikit-learn have it.
    y_true : array-like of int of shape (n,), default=None
        The truth, likewise.

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
        self, X: "ArrayLike", y_pred: "ArrayLike", y_true: "ArrayLike | None" = None
    ) -> None:
        super().__init__(X)
        self.is_outlier = _is_minus_one(y_pred, self.xyz, "y_pred")
        known = y_true is not None
        self.is_true_outlier = _is_minus_one(y_true, self.xyz, "y_true") if known else None

    @classmethod
    def from_estimator(
        cls, estimator: Any, X: "ArrayLike", y: "ArrayLike | None" = None, **options: Any
    ) -> Self:
        """Draw the verdict of a fitted detector on points X (n, 3); the truth `y`, if it is known,
        is -1 for outliers, and options are for :meth:`plot`."""
        return super().from_estimator(estimator, X, y_true=y, **options)

    @staticmethod
    def _found_by(estimator, X):
        return (estimator.predict(X),)

    def _picture(self, view):
        flagged, true = self.is_outlier, self.is_true_outlier
        picture = _found_picture(flagged, "are outliers")
        if true is None:
            return picture
        kinds = [flagged & true, ~flagged & true, flagged & ~true]
        names = ("found", "missed", "wrongly flagged")
        texts = [f"{name}: {np.count_nonzero(k):,}" for name, k in zip(names, kinds, strict=True)]
        shades = (FOUND, MISSED, WRONG)
        return picture._replace(
            colors=_choose_colors(kinds, shades, REGULAR),
            labels=np.select(kinds, [1, 2, 3], 0),
            complete=lambda ax: _add_legend(ax, zip(shades, texts, strict=True)),
        )


class NormalsDisplay(CloudDisplay):
    """Normals of a cloud as colors of a lit solid, with a ball as their legend.

    Parameters
    ----------
    X : array-like of shape (n, 3)
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

    def __init__(self, X: "ArrayLike", normals: "ArrayLike") -> None:
        super().__init__(X)
        self.normals = check_points(normals, "normals")
        if len(self.normals) != len(self.xyz):
            raise ValueError(f"normals has {len(self.normals)} rows, the cloud {len(self.xyz)}.")

    @staticmethod
    def _found_by(estimator, X):
        return (estimator.normals_,)

    def _picture(self, view):
        colors = normal_colors(self.normals, view=view)
        title = f"Normals of {len(self.xyz):,} points"
        return Picture(colors, np.zeros(len(self.xyz)), title, lambda ax: draw_ball(ax, view))


class SegmentationDisplay(CloudDisplay):
    """Regions of a cloud, a color for each; points of none are dark.

    Parameters
    ----------
    X : array-like of shape (n, 3)
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

    def __init__(self, X: "ArrayLike", labels: "ArrayLike") -> None:
        super().__init__(X)
        self.labels = _whole(_one_for_each(labels, self.xyz, "labels"), "labels")

    @staticmethod
    def _found_by(estimator, X):
        return (estimator.labels_,)

    def _picture(self, view):
        inside = self.labels >= 0
        n = len(np.unique(self.labels[inside]))
        title = f"{counted(n, 'region')}, {100 * inside.mean():.2f} % of {len(inside):,} points"
        return Picture(region_colors(self.labels), self.labels, title)


class EdgeDisplay(CloudDisplay):
    """Edges of a cloud.

    Parameters
    ----------
    X : array-like of shape (n, 3)
        The cloud.
    y_pred : array-like of int of shape (n,)
        The verdict: -1 for points of edges.

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

    def __init__(self, X: "ArrayLike", y_pred: "ArrayLike") -> None:
        super().__init__(X)
        self.is_edge = _is_minus_one(y_pred, self.xyz, "y_pred")

    @staticmethod
    def _found_by(estimator, X):
        return (np.where(estimator.scores_ < estimator.offset_, -1, 1),)

    def _picture(self, view):
        return _found_picture(self.is_edge, "are edges")


class PlaneResidualDisplay(CloudDisplay):
    """Residuals of one plane, seen along its normal; outliers are larger.

    Parameters
    ----------
    X : array-like of shape (n, 3)
        The points.
    residuals : array-like of shape (n,)
        Their residuals.
    y_pred : array-like of int of shape (n,)
        The verdict: -1 for outliers.

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

    def __init__(self, X: "ArrayLike", residuals: "ArrayLike", y_pred: "ArrayLike") -> None:
        super().__init__(X)
        self.residuals = _one_for_each(residuals, self.xyz, "residuals").astype(np.float64)
        self.is_outlier = _is_minus_one(y_pred, self.xyz, "y_pred")

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
        title = f"Residuals of {len(self.xyz):,} points, {counted(n, 'outlier')}"
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


def _add_legend(ax, entries):
    """A legend of colors and texts."""
    lines = import_extra("matplotlib.lines", "plot", "Plotting")
    marks = [
        lines.Line2D([], [], ls="", marker="o", ms=6, mfc=color, mec="none", label=text)
        for color, text in entries
    ]
    ax.legend(handles=marks, loc="upper right", frameon=False, fontsize=9)


def _choose_colors(masks, chosen, otherwise):
    """The color of the first mask that holds, for each point."""
    to_rgb = import_extra("matplotlib.colors", "plot", "Plotting").to_rgb
    colors = np.tile(to_rgb(otherwise), (len(masks[0]), 1))
    for mask, color in zip(masks, chosen, strict=True):
        colors[mask] = to_rgb(color)
    return colors


def _found_picture(found, what):
    """Which points were found, and how many."""
    n, n_all = np.count_nonzero(found), len(found)
    title = f"{counted(n, 'point', what, of=n_all)} ({100 * n / n_all:.2f} %)"
    return Picture(_choose_colors([found], [FOUND], REGULAR), found, title)


def _is_minus_one(labels, points, name):
    """Where labels are -1; flags are refused, because none of them is."""
    labels = _one_for_each(labels, points, name)
    if labels.dtype == bool:
        raise ValueError(
            f"{name} must be labels, -1 for what was found and 1 for the rest, but it is boolean: "
            f"take np.where({name}, -1, 1)."
        )
    return labels == -1


def _one_for_each(values, points, name):
    values = np.asarray(values)
    if values.shape != (len(points),):
        raise ValueError(f"{name} must have shape ({len(points)},), got {values.shape}.")
    return values
