"""Cross-validation on clouds, by blocks that keep their neighbors."""

from sklearn_mcmd.model_selection._blocks import SpatialBlockSplit, spatial_blocks

__all__ = ["SpatialBlockSplit", "spatial_blocks"]
