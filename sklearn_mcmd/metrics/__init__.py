"""Measures of the paper: bias angle (Eq. 19), outlier rates (20-24), segmentation (26-28)."""

from sklearn_mcmd.metrics._rates import bias_angle, outlier_scores
from sklearn_mcmd.metrics._segmentation import segmentation_scores

__all__ = ["bias_angle", "outlier_scores", "segmentation_scores"]
