"""What displays of clouds share: drawing of few enough points, legends, and checks."""

from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.plotting._still import plot_cloud
from sklearn_mcmd.plotting._views import thinned

if TYPE_CHECKING:
    from typing import Self

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "FOUND",
    "MOST_DRAWN",
    "REGULAR",
    "CloudDisplay",
    "ColoredDisplay",
    "View",
    "choose_colors",
    "one_for_each",
]

MOST_DRAWN = 200_000  # points; more take long and cover each other
# Okabe and Ito's colors, which the common color blindnesses keep apart.
REGULAR, FOUND = "#c3cad4", "#d55e00"

View = str | tuple[float, float]


class CloudDisplay:
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


class ColoredDisplay(CloudDisplay):
    """A display with one coloring, which subclasses give by `_picture`."""

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
            Points to draw. Of more, so many are chosen at random, rare classes more often.
        ax : matplotlib.axes.Axes, default=None
            Axes to draw on. None makes a figure.

        Returns
        -------
        display : object
            Itself.
        """
        colors, labels, title = self._picture(view)
        self._draw(colors, labels, title, view=view, max_points=max_points, ax=ax)
        self._complete(view)
        return self

    def _picture(self, view):
        """Colors (n, 3), labels (n,) for thinning, and the title."""
        raise NotImplementedError

    def _complete(self, view):
        """Add what belongs to the picture."""


def choose_colors(masks, chosen, otherwise):
    """The color of the first mask that holds, for each point."""
    from matplotlib.colors import to_rgb

    colors = np.tile(to_rgb(otherwise), (len(masks[0]), 1))
    for mask, color in zip(masks, chosen, strict=True):
        colors[mask] = to_rgb(color)
    return colors


def one_for_each(values, points, name):
    values = np.asarray(values)
    if values.shape != (len(points),):
        raise ValueError(f"{name} must have shape ({len(points)},), got {values.shape}.")
    return values


def _check_count(value, name):
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
        raise ValueError(f"{name} must be a whole number of at least 1, got {value!r}.")
