"""Residuals of one plane as a picture."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd.plotting._cloud_display import MOST_DRAWN, CloudDisplay, View, one_for_each
from sklearn_mcmd.plotting._still import check_points

if TYPE_CHECKING:
    from typing import Self

    from matplotlib.axes import Axes

__all__ = ["PlaneResidualDisplay", "along_normal"]


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
        self.residuals = one_for_each(residuals, self.xyz, "residuals").astype(np.float64)
        self.is_outlier = one_for_each(is_outlier, self.xyz, "is_outlier").astype(bool)

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
        view = along_normal(self.xyz[kept]) if view is None else view
        self._draw(paint, self.is_outlier, title, view=view, max_points=max_points, ax=ax)
        self.figure_.colorbar(shade, ax=self.ax_, label="residual", shrink=0.7, extend="both")
        return self


def along_normal(points):
    """The camera that looks at a plane from its front, upright."""
    centered = points - points.mean(axis=0)
    x, y, z = np.linalg.eigh(centered.T @ centered)[1][:, 0]
    if y > 0 or (y == 0 and (x < 0 or (x == 0 and z < 0))):
        x, y, z = -x, -y, -z
    if abs(z) > np.hypot(x, y):  # floors are seen from above
        return -90.0, 90.0
    return float(np.degrees(np.arctan2(y, x))), float(np.degrees(np.arcsin(np.clip(z, -1, 1))))
