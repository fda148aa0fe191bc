"""Robust planes in point clouds: outliers, normals and curvature as scikit-learn estimators."""

TYPE_CHECKING = False  # True for type checkers, like typing's, whose import takes time
if TYPE_CHECKING:
    from sklearn_mcmd.adjustment import BaardaPlaneDetector as BaardaPlaneDetector
    from sklearn_mcmd.adjustment import FuzzyPlaneDetector as FuzzyPlaneDetector
    from sklearn_mcmd.change import CloudChange as CloudChange
    from sklearn_mcmd.edges import SharpFeatureDetector as SharpFeatureDetector
    from sklearn_mcmd.normals import RobustNormalEstimator as RobustNormalEstimator
    from sklearn_mcmd.outliers import MCMDOutlierDetector as MCMDOutlierDetector
    from sklearn_mcmd.segmentation import RegionGrowing as RegionGrowing

__version__ = "0.1.0"

# Public rooms, and which of their names are here, too. Imported on first use (PEP 562): estimators
# need scikit-learn, whose import takes two seconds, and `mcmd --help` needs no estimator.
_ROOMS = {
    "adjustment": ["BaardaPlaneDetector", "FuzzyPlaneDetector"],
    "baselines": [],
    "change": ["CloudChange"],
    "datasets": [],
    "edges": ["SharpFeatureDetector"],
    "io": [],
    "metrics": [],
    "normals": ["RobustNormalEstimator"],
    "outliers": ["MCMDOutlierDetector"],
    "plotting": [],
    "segmentation": ["RegionGrowing"],
    "tiling": [],
    "view": [],
}
_HOMES = {name: room for room, names in _ROOMS.items() for name in names}

__all__ = [*_HOMES, "__version__"]


def __getattr__(name):
    from importlib import import_module

    if name in _ROOMS:
        return import_module(f"{__name__}.{name}")
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted([*__all__, *_ROOMS])
