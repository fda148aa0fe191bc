"""Measures of the paper: bias angle (Eq. 19), outlier rates (20-24), segmentation (26-28)."""

from sklearn_mcmd.metrics._rates import (
    bias_angle,
    masking_rate,
    outlier_scores,
    swamping_rate,
    true_negative_rate,
    true_positive_rate,
)
from sklearn_mcmd.metrics._segmentation import segmentation_scores

__all__ = [
    "bias_angle",
    "masking_rate",
    "outlier_scores",
    "segmentation_scores",
    "swamping_rate",
    "true_negative_rate",
    "true_positive_rate",
]
