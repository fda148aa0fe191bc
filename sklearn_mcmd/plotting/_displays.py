"""Results as pictures, in the manner of scikit-learn's displays."""

from abc import ABC, abstractmethod
from inspect import signature
from typing import TYPE_CHECKING, Any, Self

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
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_DRAWN = 200_000  # points; more take long and cover each other
# Okabe and Ito's colors, which the common color blindnesses keep apart.
REGULAR, FOUND = "#c3cad4", "#d55e00"
MISSED, WRONG = "#0072b2", "#e69f00"

View = str | tuple[float, float]


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
        return cls.from_predictions(np.asarray(X)[:, :3], *cls._results_of(estimator, X), **options)

    @classmethod
    def from_predictions(cls, X: "ArrayLike", *results: "ArrayLike", **options: Any) -> Self:
        """Draw what was found in a cloud.

        The arguments are those of the class, by place or name, and options for :meth:`plot`.
        """
        names = signature(cls).parameters.keys() & options.keys()
        return cls(X, *results, **{name: options.pop(name) for name in names}).plot(**options)

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
        colors, labels, title = self._picture(view)
        rows = thinned(labels, max_points)
        self._ax = plot_cloud(self.xyz[rows], color=colors[rows], view=view, scale_bar=True, ax=ax)
        self._ax.set_title(title, fontsize=12, color="0.2")
        self._complete(view)
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
    def _results_of(estimator: Any, X: "ArrayLike") -> tuple[Any, ...]:
        """What the class takes behind the points."""

    @abstractmethod
    def _picture(self, view: View) -> tuple[NDArray[np.floating], NDArray[Any], str]:
        """Colors (n, 3), labels, of which rare ones keep more of their points, and the title."""

    def _complete(self, view: View) -> None:  # noqa: B027, most have nothing to add
        """Add a legend or the like to the axes."""

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
        has_truth = y_true is not None
        self.is_true_outlier = _is_minus_one(y_true, self.xyz, "y_true") if has_truth else None

    @classmethod
    def from_estimator(
        cls, estimator: Any, X: "ArrayLike", y: "ArrayLike | None" = None, **options: Any
    ) -> Self:
        """Draw the verdict of a fitted detector on points X (n, 3); the truth `y`, if it is known,
        is -1 for outliers, and options are for :meth:`plot`."""
        return super().from_estimator(estimator, X, y_true=y, **options)

    @staticmethod
    def _results_of(estimator, X):
        return (estimator.predict(X),)

    def _kinds(self):
        """What outliers are named, drawn in, and which they are."""
        flagged, true = self.is_outlier, self.is_true_outlier
        if true is None:
            return {"found": (FOUND, flagged)}
        missed, wrong = (MISSED, ~flagged & true), (WRONG, flagged & ~true)
        return {"found": (FOUND, flagged & true), "missed": missed, "wrongly flagged": wrong}

    def _picture(self, view):
        kinds = self._kinds().values()
        return *_choose_colors(kinds), _marked_title(self.is_outlier, "are outliers")

    def _complete(self, view):
        if self.is_true_outlier is None:
            return
        for name, (color, mask) in self._kinds().items():
            self._ax.scatter([], [], color=color, label=f"{name}: {np.count_nonzero(mask):,}")
        beside = 1, 1  # the cloud
        self._ax.legend(frameon=False, fontsize=9, loc="upper left", bbox_to_anchor=beside)


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
    def _results_of(estimator, X):
        return (estimator.normals_,)

    def _picture(self, view):
        colors = normal_colors(self.normals, view=view)
        return colors, np.zeros(len(colors)), f"Normals of {len(colors):,} points"

    def _complete(self, view):
        draw_ball(self._ax, view)


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
    def _results_of(estimator, X):
        return (estimator.labels_,)

    def _picture(self, view):
        inside = self.labels >= 0
        n = len(np.unique(self.labels[inside]))
        title = f"{counted(n, 'region')}, {100 * inside.mean():.2f} % of {len(inside):,} points"
        return region_colors(self.labels), self.labels, title


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
    def _results_of(estimator, X):
        return (np.where(estimator.scores_ < estimator.offset_, -1, 1),)

    def _picture(self, view):
        kinds = [(FOUND, self.is_edge)]
        return *_choose_colors(kinds), _marked_title(self.is_edge, "are edges")


class PlaneResidualDisplay(CloudDisplay):
    """Residuals of one plane, seen along its normal.

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
    sklearn_mcmd.BaardaPlaneDetector : Tests a plane.

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
    def _results_of(estimator, X):
        return estimator.residuals(X), estimator.labels_

    def _usual_view(self):
        return along_normal(self.xyz[those_of_plane(self.is_outlier)])

    def _shade(self):
        cm, colors = color_modules()
        # Three standard deviations of what is kept; an outlier would take the contrast of all.
        kept = self.residuals[those_of_plane(self.is_outlier)]
        reach = 3 * np.sqrt(np.mean(kept**2)) or 1.0
        return cm.ScalarMappable(colors.Normalize(-reach, reach, clip=True), "RdBu_r")

    def _picture(self, view):
        n = counted(np.count_nonzero(self.is_outlier), "outlier")
        title = f"Residuals of {len(self.xyz):,} points, {n}"
        return self._shade().to_rgba(self.residuals)[:, :3], self.is_outlier, title

    def _complete(self, view):
        add_color_bar(self._ax, self._shade(), "residual")


def add_color_bar(ax, shade, label):
    """A bar below the axes of what colors mean."""
    ends, place = (shade.norm.vmin, shade.norm.vmax), {"location": "bottom", "shrink": 0.5}
    ticks = {"ticks": np.linspace(*ends, 3), "format": "%.4g", "extend": "both"}
    ax.figure.colorbar(shade, ax=ax, label=label, **ticks, **place)


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


def _choose_colors(kinds):
    """Colors and numbers of the kinds that points are of: pairs of a color and a mask."""
    to_rgb = import_extra("matplotlib.colors", "plot", "Plotting").to_rgb
    shades, masks = zip(*kinds, strict=True)
    number = np.select(masks, range(1, 1 + len(masks)), 0)
    return np.array([to_rgb(shade) for shade in (REGULAR, *shades)])[number], number


def _marked_title(is_marked, what):
    n, n_all = np.count_nonzero(is_marked), len(is_marked)
    return f"{counted(n, 'point', what, of=n_all)} ({100 * n / n_all:.2f} %)"


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
