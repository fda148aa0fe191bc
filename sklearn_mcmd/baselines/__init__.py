"""The methods that the first paper compares with, for arrays and as one outlier detector."""

from sklearn_mcmd.baselines._detector import PlaneOutlierDetector
from sklearn_mcmd.baselines._fits import NeighborhoodFit
from sklearn_mcmd.baselines._pca import Pca
from sklearn_mcmd.baselines._qsp import Qsp
from sklearn_mcmd.baselines._ransac import Msac, Ransac
from sklearn_mcmd.baselines._robpca import Robpca
from sklearn_mcmd.baselines._ulsif import Ulsif

__all__ = [
    "Msac",
    "NeighborhoodFit",
    "Pca",
    "PlaneOutlierDetector",
    "Qsp",
    "Ransac",
    "Robpca",
    "Ulsif",
]
