"""Robust planes in point clouds: outliers, normals and curvature as scikit-learn estimators."""

from sklearn_mcmd._edges import SharpFeatureDetector
from sklearn_mcmd._mcmd import MCMDOutlierDetector
from sklearn_mcmd._normals import RobustNormalEstimator
from sklearn_mcmd._region_growing import RegionGrowing
from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

__version__ = "0.1.0.dev0"

__all__ = [
    "BaardaPlaneDetector",
    "FuzzyPlaneDetector",
    "MCMDOutlierDetector",
    "RegionGrowing",
    "RobustNormalEstimator",
    "SharpFeatureDetector",
    "__version__",
]
