"""Edges and corners."""

from sklearn_mcmd.edges._detector import SharpFeatureDetector

__all__ = ["SharpFeatureDetector"]
