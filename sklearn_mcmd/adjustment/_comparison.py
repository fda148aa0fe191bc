"""Are two adjusted planes the same, moved or tilted?"""

from numbers import Real
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import chdtrc, fdtrc
from sklearn.utils.validation import check_is_fitted

from sklearn_mcmd._sklearn import Interval, validate_params
from sklearn_mcmd.adjustment._base import PlaneDetector
from sklearn_mcmd.adjustment._power import POWER, noncentrality
from sklearn_mcmd.adjustment._precision import parameter_derivatives, quantile
from sklearn_mcmd.adjustment._tests import local_level


class Difference(NamedTuple):
    """A tilt in degrees, or an offset in units of X, between two planes.

    Parameters
    ----------
    value, error : float
        The difference and its standard error; of tilts, into their own direction, and of a tilt of
        exactly 0 into the direction that is known worst.
    smallest : float
        Smallest difference that the test detects with a power of 0.8; of tilts, into the
        direction that is known worst.
    pvalue : float
        Of the test by chi-squared, or by F if the scales are estimated.
    significant : bool
    """

    value: float
    error: float
    smallest: float
    pvalue: float
    significant: bool


class PlaneComparison(NamedTuple):
    """How the second plane lies to the first, as of `compare_planes`.

    Parameters
    ----------
    verdict : {"same", "moved", "tilted", "tilted and moved"}
        Planes that are not tilted are parallel. "same" means that no difference is significant, not
        that there is none: see the smallest ones.
    tilt : Difference
        Angle between the normals; error and smallest are those of small angles.
    offset : Difference
        How far the second lies above the first along its normal, midway between both centers.
    """

    verdict: str
    tilt: Difference
    offset: Difference


@validate_params(
    {"a": [PlaneDetector], "b": [PlaneDetector], "alpha": [Interval(Real, 0, 1, closed="neither")]},
    prefer_skip_nested_validation=True,
)
def compare_planes(
    a: PlaneDetector,
    b: PlaneDetector,
    *,
    alpha: float = 0.05,
    variance: Literal["posterior", "prior"] = "posterior",
) -> PlaneComparison:
    """Test whether two fitted planes are the same, parallel, moved or tilted.

    The clouds must be in one coordinate system and measured independently: an error of their
    registration is not in the residuals, and looks like a movement. Tilt and offset are tested at
    ``1 - sqrt(1 - alpha)`` each, so that equal planes differ with probability alpha.

    Parameters
    ----------
    a, b : BaardaPlaneDetector or FuzzyPlaneDetector
        Fitted to clouds with as many columns; if not, a ValueError is raised.
    alpha : float in (0, 1), default=0.05
        Level of both tests together.
    variance : {"posterior", "prior"}, default="posterior"
        See `BaardaPlaneDetector.precision`. Two estimated scales have Welch's degrees of freedom.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector, compare_planes
    >>> X = np.random.default_rng(0).normal(size=(200, 3)) * [5, 5, 0.01]
    >>> detectors = [BaardaPlaneDetector(sigma0=0.01).fit(X + [0, 0, dz]) for dz in (0, 0.005)]
    >>> result = compare_planes(*detectors)
    >>> print(f"{result.verdict}: {result.offset.value:.4f} ± {result.offset.error:.4f}")
    moved: 0.0050 ± 0.0010
    """
    for detector in (a, b):
        check_is_fitted(detector)
    if a.n_features_in_ != b.n_features_in_:
        raise ValueError(
            f"The planes are of {a.n_features_in_} and {b.n_features_in_} columns: compare planes "
            "of points with as many columns."
        )
    place = (a._fitted.plane.center + b._fitted.plane.center) / 2
    side = np.sign(a.normal_ @ b.normal_) or 1.0
    # Tilts along unit directions across the first normal, then the offset.
    basis = np.linalg.svd(a.normal_[None])[2][1:]
    values = basis @ (side * b.normal_ - a.normal_)
    first, second = ((place - one._fitted.plane.center) @ one.normal_ for one in (a, b))
    offset = first - side * second
    covariances, dofs = [], []
    for one in (a, b):
        scale, dof = one._scale_by(variance)
        derivatives = scale * parameter_derivatives(one._fitted.plane)
        # The distance from the place, not from the origin.
        derivatives[-1] -= place @ derivatives[:-1]
        roots = np.vstack([basis @ derivatives[:-1], derivatives[-1]])
        covariances.append(roots @ roots.T)
        dofs.append(dof)
    levels = dofs, local_level(alpha, 2)
    angle = np.arctan2(np.linalg.norm(values), abs(a.normal_ @ b.normal_))  # values are its sine
    degree = np.degrees(1.0)
    tilt = _difference(angle * degree, values, [c[:-1, :-1] for c in covariances], *levels, degree)
    moved = _difference(offset, [offset], [c[-1:, -1:] for c in covariances], *levels)
    found = [word for word, one in (("tilted", tilt), ("moved", moved)) if one.significant]
    return PlaneComparison(" and ".join(found) or "same", tilt, moved)


def _difference(value, values, covariances, dofs, level, unit=1.0):
    """A `Difference` of this value, from its parts along all directions in radians or units."""
    values, k, together = np.asarray(values), len(values), sum(covariances)
    traces = np.array([np.trace(c) for c in covariances])
    parts = (traces**2 / np.maximum(dofs, 1)).sum()  # 0 of known scales
    dof = traces.sum() ** 2 / parts if parts > 0 else np.inf
    squared = values @ np.linalg.pinv(together, hermitian=True) @ values
    length, worst = np.linalg.norm(values), np.linalg.eigvalsh(together)[-1]
    along = values / (length or 1.0)
    return Difference(
        value=float(value),
        error=float(unit * np.sqrt(along @ together @ along if length else worst)),
        smallest=float(unit * np.sqrt(worst * noncentrality(level, POWER, k, dof))),
        pvalue=float(chdtrc(k, squared) if np.isinf(dof) else fdtrc(k, dof, squared / k)),
        significant=bool(squared > quantile(1 - level, dof, k) ** 2),
    )
