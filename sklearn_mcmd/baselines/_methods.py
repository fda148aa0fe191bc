"""The comparators by name."""

from sklearn_mcmd.baselines._pca import Pca
from sklearn_mcmd.baselines._qsp import Qsp
from sklearn_mcmd.baselines._ransac import Msac, Ransac
from sklearn_mcmd.baselines._robpca import Robpca
from sklearn_mcmd.baselines._ulsif import Ulsif
from sklearn_mcmd.planes._rules import COMPARATORS

for kind in (Msac, Pca, Qsp, Ransac, Robpca, Ulsif):
    COMPARATORS[kind.__name__.lower()] = kind
