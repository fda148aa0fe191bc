"""A report of a fitted plane test for a surveyor's files, as text or as a figure."""

from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd._sklearn import Interval, checked
from sklearn_mcmd.adjustment._base import PlaneDetector, check_points
from sklearn_mcmd.adjustment._comparison import PlaneComparison
from sklearn_mcmd.adjustment._plane_figures import plane_figures
from sklearn_mcmd.adjustment._tolerance import PlaneFlatness
from sklearn_mcmd.planes._form import cells_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_DRAWN = 50_000  # more points take minutes to draw, and show no more
MAX_DEVIATIONS = 15  # half width of the histogram, in standard deviations of the inliers
BLUE, RED = "#1f77b4", "#d62728"


@checked(n_worst=[Interval(Integral, 0, None, closed="left")])
def text_report(
    detector: PlaneDetector,
    X: "ArrayLike",
    *,
    title: str = "Plane test",
    unit: str = "",
    n_worst: int = 10,
    comparison: PlaneComparison | None = None,
    flatness: PlaneFlatness | None = None,
) -> str:
    """Plane, precision, reliability and the worst points of a fitted detector, as text.

    Parameters
    ----------
    detector : BaardaPlaneDetector or FuzzyPlaneDetector
        Fitted to X.
    X : array-like of shape (n_samples, n_features)
        The training points.
    title : str, default="Plane test"
    unit : str, default=""
        Unit of X, for example "m"; only printed.
    n_worst : int, default=10
        Number of points to list, those with the largest test statistics.
    comparison : PlaneComparison, default=None
        With another plane, by `compare_planes`.
    flatness : PlaneFlatness, default=None
        Of these points, by :func:`flatness`.

    Raises
    ------
    ValueError
        If the detector was fitted to other points than X.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector, text_report
    >>> X = np.array([[0.0, 0], [1, 1], [2, 2], [3, 9], [4, 4], [5, 5], [6, 6]])
    >>> print(text_report(BaardaPlaneDetector().fit(X), X, n_worst=1))
    Plane test
    ==========
    ...
    outliers              1 of 7 (14.29 %)
    ...
    """
    figures = plane_figures(
        detector,
        check_points(detector, X),
        unit,
        n_worst=n_worst,
        comparison=comparison,
        flatness=flatness,
    )
    return figures_as_text(title, figures)


def figures_as_text(title, figures):
    """Parts of rows below each other, then aligned tables."""
    lines = [title, "=" * len(title)]
    for name, rows in figures.parts.items():
        lines += with_heading(name, {row.name: row for row in rows})
    for name, table in figures.tables.items():
        cells = [table.header, *table.rows]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines += with_heading(name, {})
        lines += ["  ".join(map(str.rjust, row, widths)) for row in cells]
    return "\n".join(lines) + "\n"


def with_heading(title, rows):
    """Lines of a part of the report: a title, and names beside values."""
    lines = [f"{name:<22}{value}" for name, value in rows.items()]
    return [*(["", title, "-" * len(title)] if title else []), *lines]


def plot_report(
    detector: PlaneDetector,
    X: "ArrayLike",
    *,
    title: str = "Plane test",
    unit: str = "",
) -> "Figure":
    """Residual map, the form that is left, and histogram against the normal curve.

    Parameters
    ----------
    detector, X, title, unit
        As of `text_report`.

    Returns
    -------
    matplotlib.figure.Figure
        Without a window; ``figure.savefig("report.png")`` saves it.
    """
    new_figure = import_extra("matplotlib.figure", "plot", "plot_report").Figure
    X = check_points(detector, X)
    figure = new_figure(figsize=(11.7, 8.3), layout="constrained")  # A4
    panels = figure.subplot_mosaic("mf;hh")
    residuals, good = detector.residuals(X), detector.labels_ == 1
    suffix = f" [{unit}]" if unit else ""
    figure.suptitle(title, fontsize="x-large")
    figure.supxlabel(_key_figures(detector, X, unit), fontsize="medium")
    view, names = _view(detector, X, residuals)
    _draw_map(panels["m"], view[good], residuals[good], "residual of inliers" + suffix)
    panels["m"].set_title("Residual map")
    if not good.all():
        marks = {"s": 9, "marker": "x", "c": "k", "linewidths": 0.6, "label": "outlier"}
        x, y = _thinned(view[~good]).T
        panels["m"].scatter(x, y, **marks, rasterized=True)
        panels["m"].legend(loc="lower right", bbox_to_anchor=(1, 1), markerscale=2, frameon=False)
    plane = detector._fitted.plane
    cells = cells_of((X[good] - plane.center) @ plane.directions, residuals[good])
    means = cells.residuals[cells.of_point]
    _draw_map(panels["f"], view[good], means, "mean residual of a cell" + suffix)
    panels["f"].set_title(f"Form: means of {len(cells.residuals)} cells")
    for name in "mf":
        panels[name].set(xlabel=names[0] + suffix, ylabel=names[1] + suffix)
        if X.shape[1] > 2:
            panels[name].set_aspect("equal", adjustable="box")
    _draw_histogram(panels["h"], residuals, ~good, suffix)
    return figure


def _key_figures(detector, X, unit):
    """The lines below the panels."""
    rows = plane_figures(detector, X, unit).rows()
    figures = ("outliers",), ("normal", "dip"), ("test", "sigma0"), ("residuals",)
    lines = ["; ".join(f"{name} {rows[name]}" for name in names) for names in figures]
    return "\n".join([*lines, str(rows["method"])])


def _thinned(rows):
    """At most `MAX_DRAWN` of the rows, at even steps."""
    return rows[:: len(rows) // MAX_DRAWN + 1]


def _draw_map(axes, view, values, label):
    """Places in the colors of their values, and a bar of these."""
    view, values = _thinned(view), _thinned(values)
    # Not the largest value: one point would make all others pale.
    reach = np.percentile(np.abs(values), 99) if len(values) else 1.0
    ends = {"cmap": "coolwarm", "vmin": -(reach or 1.0), "vmax": reach or 1.0}
    x, y = view.T
    shown = axes.scatter(x, y, c=values, s=4, linewidths=0, rasterized=True, **ends)
    place = {"location": "bottom", "shrink": 0.6, "aspect": 30, "pad": 0.02}
    bar = axes.figure.colorbar(shown, ax=axes, label=label, extend="both", **place)
    bar.ax.locator_params(nbins=4)


def _view(detector, X, residuals):
    """Coordinates of the points in a map (n, 2), and their names.

    A plane in space that is steeper than 45 degrees is seen from the side to which its normal
    points, with the level line to the right and height up. All others are seen from above, and
    lines have their residuals upward.
    """
    normal = detector.normal_
    if X.shape[1] == 2:
        return np.column_stack([X[:, 0], residuals]), ["x", "residual"]
    if X.shape[1] == 3 and detector.surface == "orthogonal" and abs(normal[2]) < np.sqrt(0.5):
        right = np.array([-normal[1], normal[0], 0.0]) / np.hypot(normal[0], normal[1])
        along = (X - detector._fitted.plane.center) @ right
        return np.column_stack([along, X[:, 2]]), ["along the level line", "z"]
    return X[:, :2], ["x", "y"] if X.shape[1] == 3 else ["column 0", "column 1"]


def _draw_histogram(axes, residuals, outliers, suffix):
    """Residuals against the normal curve of the inliers' scale."""
    inliers = residuals[~outliers]
    scale = (inliers.std() if len(inliers) else 0.0) or max(np.abs(residuals).max(), 1.0)
    largest = np.abs(residuals).max() / scale
    reach = np.clip(np.ceil(largest), 4, MAX_DEVIATIONS)
    bins = scale * np.linspace(-reach, reach, int(10 * reach) + 1)
    # The last bins count all points beyond them, so that all points are seen.
    for values, color, name in ((inliers, BLUE, "inliers"), (residuals[outliers], RED, "outliers")):
        if len(values):
            axes.hist(np.clip(values, bins[0], bins[-1]), bins, color=color, alpha=0.7, label=name)
    curve = np.linspace(bins[0], bins[-1], 800)
    density = np.exp(-0.5 * (curve / scale) ** 2) / (scale * np.sqrt(2 * np.pi))
    axes.plot(curve, density * len(inliers) * (bins[1] - bins[0]), color="k", label="normal curve")
    beyond = f", beyond {MAX_DEVIATIONS} deviations in the last bin" if largest > reach else ""
    axes.set(title="Residuals", xlabel=f"residual{suffix}{beyond}", ylabel="points")
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.5)
    axes.legend(loc="best")
