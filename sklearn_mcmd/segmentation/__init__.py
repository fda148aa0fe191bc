"""Surfaces, as regions that grow from point to point."""

from sklearn_mcmd.segmentation._estimator import RegionGrowing

__all__ = ["RegionGrowing"]
