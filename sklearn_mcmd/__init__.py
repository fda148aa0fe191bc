"""Robust planes in point clouds: outliers, normals and curvature as scikit-learn estimators."""

TYPE_CHECKING = False  # True for type checkers, like typing's, whose import takes time
if TYPE_CHECKING:
    from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector
    from sklearn_mcmd.edges import SharpFeatureDetector
    from sklearn_mcmd.normals import RobustNormalEstimator
    from sklearn_mcmd.outliers import MCMDOutlierDetector
    from sklearn_mcmd.segmentation import RegionGrowing

__version__ = "0.1.0"

__all__ = [
    "BaardaPlaneDetector",
    "FuzzyPlaneDetector",
    "MCMDOutlierDetector",
    "RegionGrowing",
    "RobustNormalEstimator",
    "SharpFeatureDetector",
    "__version__",
]

# Imported on first use (PEP 562): estimators need scikit-learn, whose import takes two seconds, and
# `mcmd --help` needs no estimator.
_HOMES = {
    "BaardaPlaneDetector": "adjustment",
    "FuzzyPlaneDetector": "adjustment",
    "MCMDOutlierDetector": "outliers",
    "RegionGrowing": "segmentation",
    "RobustNormalEstimator": "normals",
    "SharpFeatureDetector": "edges",
}
_SUBPACKAGES = {
    "adjustment",
    "baselines",
    "datasets",
    "edges",
    "io",
    "metrics",
    "model_selection",
    "normals",
    "outliers",
    "plotting",
    "resampling",
    "segmentation",
    "tiling",
    "view",
}


def __getattr__(name):
    from importlib import import_module

    if name in _HOMES:
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        globals()[name] = value
        return value
    if name in _SUBPACKAGES:
        return import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted({*globals(), *__all__, *_SUBPACKAGES})
