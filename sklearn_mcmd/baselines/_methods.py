"""The comparators by name, and one function for all of them."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd.baselines._fits import NeighborhoodFit
from sklearn_mcmd.baselines._pca import Pca
from sklearn_mcmd.baselines._qsp import Qsp
from sklearn_mcmd.baselines._ransac import Msac, Ransac
from sklearn_mcmd.baselines._robpca import Robpca
from sklearn_mcmd.baselines._ulsif import Ulsif
from sklearn_mcmd.planes._rules import comparator_of, register_comparator

#: Those that registered themselves with the engine, by name.
COMPARATORS = {kind.__name__.lower(): kind for kind in (Msac, Pca, Qsp, Ransac, Robpca, Ulsif)}
for _name, _kind in COMPARATORS.items():
    register_comparator(_name, _kind)


def fit_neighborhoods(
    method: str,
    points: ArrayLike,
    *,
    random_state: int | np.random.RandomState | None = None,
    **method_params: Any,
) -> NeighborhoodFit:
    """Judge the members of many neighborhoods by the method with this name.

    Parameters
    ----------
    method : {"msac", "pca", "qsp", "ransac", "robpca", "ulsif"}
    points : ndarray of shape (B, n, d)
        Neighborhoods, in any unit; one cloud X is ``X[None]``. They are centered at each
        neighborhood's first member before any arithmetic.
    random_state : int, RandomState instance or None, default=None
        Seed of the one table of random positions that all neighborhoods of a size use.
    **method_params
        Parameters of the method, see `Msac`, `Pca`, `Qsp`, `Ransac`, `Robpca`, `Ulsif`.

    Returns
    -------
    NeighborhoodFit
        With ``scores``, ``inliers``, ``cutoff``, ``centers``, ``normals``, ``scale`` and
        ``score(queries)``.

    Raises
    ------
    ValueError
        If the method or a parameter is unknown, a parameter is out of its range, or
        neighborhoods are too small.

    Examples
    --------
    Two walls, one with a car in front of it:

    >>> import numpy as np
    >>> from sklearn_mcmd.baselines import fit_neighborhoods
    >>> rng = np.random.default_rng(0)
    >>> walls = rng.uniform(0, 2, (2, 50, 3)) * [1, 0, 1] + rng.normal(0, 0.004, (2, 50, 3))
    >>> walls[1, :15] += [0, -0.8, 0]
    >>> for method in ("pca", "ransac", "robpca"):
    ...     found = fit_neighborhoods(method, walls, random_state=0)
    ...     removed = (~found.inliers).sum(axis=1)
    ...     tilts = np.degrees(np.arccos(np.abs(found.normals[:, 1])))
    ...     print(f"{method}: {removed} removed, tilts {tilts.round(1)} degrees")
    pca: [1 0] removed, tilts [0.1 4.7] degrees
    ransac: [ 1 15] removed, tilts [0.  0.1] degrees
    robpca: [ 2 15] removed, tilts [0.1 0.1] degrees
    """
    return comparator_of(method, method_params).fit(points, random_state=random_state)
