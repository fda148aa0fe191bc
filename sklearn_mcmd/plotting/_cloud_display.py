"""What displays of clouds share: how they are made and drawn, legends, and checks."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.plotting._still import plot_cloud
from sklearn_mcmd.plotting._views import thinned
from sklearn_mcmd.view._page import check_count

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_DRAWN = 200_000  # points; more take long and cover each other
# Okabe and Ito's colors, which the common color blindnesses keep apart.
REGULAR, FOUND = "#c3cad4", "#d55e00"

View = str | tuple[float, float]


class Picture(NamedTuple):
    """What a display draws."""

    colors: NDArray[np.floating]  # (n, 3)
    labels: NDArray[Any]  # of clouds with too many points, rare labels keep more of theirs
    title: str
    complete: "Callable[[Axes], object] | None" = None  # adds a legend or the like to the axes


class CloudDisplay(ABC):
    """What all displays of clouds share: where they come from, how they are drawn, and on what."""

    xyz: NDArray[np.float64]
    _ax: "Axes"
    from_predictions: ClassVar["Callable[..., Any]"]  # each display's own, by names of arguments

    @classmethod
    def from_estimator(cls, estimator: Any, X: ArrayLike, **options: Any) -> Self:
        """Draw what an estimator found in X (n, 3 or more), to which it is fitted.

        The first three columns are coordinates, and options are for :meth:`plot`.
        """
        found = cls._found_by(estimator, X)
        return cls.from_predictions(np.asarray(X)[:, :3], *found, **options)

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
        view = self._usual_view() if view is None else view
        return self._draw(self._picture(view), view, max_points, ax)

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
    def _found_by(estimator: Any, X: ArrayLike) -> tuple[Any, ...]:
        """What `from_predictions` takes behind the points."""

    @abstractmethod
    def _picture(self, view: View) -> Picture:
        """What is drawn, seen from there."""

    def _usual_view(self) -> View:
        return "perspective"

    def _draw(self, picture, view, max_points, ax):
        check_count(max_points, "max_points")
        rows = thinned(picture.labels, max_points)
        self._ax = plot_cloud(
            self.xyz[rows], color=picture.colors[rows], view=view, scale_bar=True, ax=ax
        )
        self._ax.set_title(picture.title, fontsize=12, color="0.2")
        if picture.complete is not None:
            picture.complete(self._ax)
        return self


def picture_of(display, view):
    """What a display draws, seen from there."""
    return display._picture(view)


def add_legend(ax, entries):
    """A legend of colors and texts."""
    lines = import_extra("matplotlib.lines", "plot", "Plotting")
    marks = [
        lines.Line2D([], [], ls="", marker="o", ms=6, mfc=color, mec="none", label=text)
        for color, text in entries
    ]
    ax.legend(handles=marks, loc="upper right", frameon=False, fontsize=9)


def choose_colors(masks, chosen, otherwise):
    """The color of the first mask that holds, for each point."""
    to_rgb = import_extra("matplotlib.colors", "plot", "Plotting").to_rgb
    colors = np.tile(to_rgb(otherwise), (len(masks[0]), 1))
    for mask, color in zip(masks, chosen, strict=True):
        colors[mask] = to_rgb(color)
    return colors


def is_minus_one(labels, name):
    """Where labels are -1; flags are refused, because none of them is."""
    labels = np.asarray(labels)
    if labels.dtype == bool:
        raise ValueError(
            f"{name} must be labels, -1 for what was found and 1 for the rest, but it is boolean: "
            f"take np.where({name}, -1, 1)."
        )
    return labels == -1


def one_for_each(values, points, name, dtype=None):
    values = np.asarray(values, dtype)
    if values.shape != (len(points),):
        raise ValueError(f"{name} must have shape ({len(points)},), got {values.shape}.")
    return values
