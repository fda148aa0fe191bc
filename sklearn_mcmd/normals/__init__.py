"""Normals and curvature of cleaned neighborhoods."""

from sklearn_mcmd.normals._estimator import RobustNormalEstimator

__all__ = ["RobustNormalEstimator"]
