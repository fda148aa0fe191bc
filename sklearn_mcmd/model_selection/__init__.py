"""Cross-validation on clouds: by blocks that keep their neighbors, or by whole scenes."""

from sklearn_mcmd.model_selection._blocks import SpatialBlockSplit, spatial_blocks
from sklearn_mcmd.model_selection._scenes import score_segments

__all__ = ["SpatialBlockSplit", "score_segments", "spatial_blocks"]
