"""Residuals of one plane as a picture."""

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd.plotting._cloud_display import CloudDisplay, Picture, is_minus_one, one_for_each
from sklearn_mcmd.plotting._still import check_points, color_modules


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
