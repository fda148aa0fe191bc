"""Robust planes in point clouds: outliers, normals and curvature as scikit-learn estimators."""

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector
from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.segmentation import RegionGrowing

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
