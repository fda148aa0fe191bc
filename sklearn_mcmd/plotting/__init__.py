"""Pictures of point clouds and of results, and a page to look around in."""

from sklearn_mcmd.plotting._displays import (
    EdgeDisplay,
    NormalsDisplay,
    OutlierDisplay,
    PlaneResidualDisplay,
    SegmentationDisplay,
)
from sklearn_mcmd.plotting._still import normal_colors, plot_cloud, region_colors
from sklearn_mcmd.view._page import view

__all__ = [
    "EdgeDisplay",
    "NormalsDisplay",
    "OutlierDisplay",
    "PlaneResidualDisplay",
    "SegmentationDisplay",
    "normal_colors",
    "plot_cloud",
    "region_colors",
    "view",
]
