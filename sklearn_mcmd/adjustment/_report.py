"""A report of a fitted plane test for a surveyor's files, as text."""

from numbers import Integral

from numpy.typing import ArrayLike

from sklearn_mcmd._sklearn import Interval, checked
from sklearn_mcmd.adjustment._base import PlaneDetector, check_points
from sklearn_mcmd.adjustment._comparison import PlaneComparison
from sklearn_mcmd.adjustment._plane_figures import plane_figures
from sklearn_mcmd.adjustment._tolerance import PlaneFlatness


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
    X = check_points(detector, X)
    further = {"comparison": comparison, "flatness": flatness}
    figures = plane_figures(detector, X, unit, n_worst=n_worst, **further)
    lines = [title, "=" * len(title)]
    for name, rows in figures.parts.items():
        lines += _heading(name) + [f"{row.name:<22}{row}" for row in rows]
    for name, table in figures.tables.items():
        cells = [table.header, *table.rows]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines += _heading(name) + ["  ".join(map(str.rjust, row, widths)) for row in cells]
    return "\n".join(lines) + "\n"


def _heading(title):
    """Lines above a part, if it has a title."""
    return ["", title, "-" * len(title)] if title else []
