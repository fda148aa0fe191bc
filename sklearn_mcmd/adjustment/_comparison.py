"""Are two adjusted planes the same, moved or tilted?"""

from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc, fdtrc
from sklearn.utils.validation import check_is_fitted

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._sklearn import Interval, checked
from sklearn_mcmd.adjustment._base import PlaneDetector, Variance, place_of
from sklearn_mcmd.adjustment._precision import parameter_derivatives, quantile, welch
from sklearn_mcmd.adjustment._tests import POWER, local_level, noncentrality

CORNERS = 2**0.5  # rims to the farthest point of a square that stands on a corner


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
    verdict : {"same", "moved", "tilted", "tilted and moved", "no overlap"}
        Planes that are not tilted are parallel. "same" means that no difference is significant, not
        that there is none: see the smallest ones. "no overlap": the clouds are apart along their
        planes, so that their differences are those of other places, and no `place` was given.
    tilt : Difference
        Angle between the planes, 90 degrees at most; between their normals if both have a side,
        by `toward`.
    offset : Difference
        How far the second lies above the first along its normal, at the place.
    place : ndarray of shape (n_features,)
        Where the planes are compared. A plane that turns about it does not move.
    registration_error : float
        The given one, which the errors hold.
    """

    verdict: str
    tilt: Difference
    offset: Difference
    place: NDArray[np.float64]
    registration_error: float


@checked(
    a=[PlaneDetector],
    b=[PlaneDetector],
    alpha=[Interval(Real, 0, 1, closed="neither")],
    registration_error=[Interval(Real, 0, None, closed="left")],
)
def compare_planes(
    a: PlaneDetector,
    b: PlaneDetector,
    *,
    alpha: float = 0.05,
    variance: Variance = "posterior",
    place: "ArrayLike | None" = None,
    registration_error: float = 0.0,
) -> PlaneComparison:
    """Test whether two fitted planes are the same, parallel, moved or tilted.

    The clouds must be in one coordinate system and measured independently. What their noise has in
    common nearby is in the errors. What is smooth over a whole plane, their registration and the
    calibration are in no residual, and look like a movement. Tilt and offset are tested at
    ``1 - sqrt(1 - alpha)`` each, so that equal planes differ with probability alpha.

    Parameters
    ----------
    a, b : BaardaPlaneDetector or FuzzyPlaneDetector
        Fitted to clouds with as many columns; if not, a ValueError is raised.
    alpha : float in (0, 1), default=0.05
        Level of both tests together.
    variance : {"posterior", "independent", "prior"}, default="posterior"
        See `BaardaPlaneDetector.precision`. Two estimated scales have Welch's degrees of freedom.
    place : array-like of shape (n_features,), default=None
        Where the offset is told, near both planes. None takes the mean of the middles of both
        extents, which depends on the outermost points alone. What turns about another place moves
        there.
    registration_error : float, default=0.0
        Standard error of the registration of both clouds, in units of X: by which one is off at the
        place, and by which a turn takes the rims of the first plane off as well.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector, compare_planes
    >>> X = np.random.default_rng(0).normal(size=(200, 3)) * [5, 5, 0.01]
    >>> detectors = [BaardaPlaneDetector(sigma0=0.01).fit(X + [0, 0, dz]) for dz in (0, 0.005)]
    >>> result = compare_planes(*detectors)
    >>> print(f"{result.verdict}: {result.offset.value:.4f} ± {result.offset.error:.4f}")
    moved: 0.0050 ± 0.0012
    """
    for detector in (a, b):
        check_is_fitted(detector)
    if a.n_features_in_ != b.n_features_in_:
        raise ValueError(
            f"The planes are of {a.n_features_in_} and {b.n_features_in_} columns: compare planes "
            "of points with as many columns."
        )
    apart = place is None and _are_apart(a._fitted, b._fitted)
    if place is None:
        at = (a._fitted.middle + b._fitted.middle) / 2
        if apart:
            warn_caller(
                "The clouds do not overlap: their planes are compared between, where neither has "
                "points. Are both in one coordinate system?"
            )
    else:
        at = place_of(place, a.n_features_in_, "place")
    is_sided = a.toward is not None and b.toward is not None
    side = 1.0 if is_sided else np.sign(a.normal_ @ b.normal_) or 1.0
    angle, bases = _great_circle(a.normal_, side * b.normal_)
    first, second = ((at - one._fitted.plane.center) @ one.normal_ for one in (a, b))
    offset = first - side * second
    # The independent parts of both differences: roots of their covariances, and degrees of freedom.
    tilts, offsets, dofs = [], [], []
    for one, basis in zip((a, b), bases, strict=True):
        scale, dof = one._scale_by(variance)
        derivatives = scale * parameter_derivatives(one._fitted.plane)
        # The distance from the place, not from the origin.
        derivatives[-1] -= at @ derivatives[:-1]
        tilts.append(basis @ derivatives[:-1])
        offsets.append(derivatives[-1:])
        dofs.append(dof)
    if registration_error:
        tilts.append(registration_error * bases[0] @ _turns(a._fitted.plane))
        offsets.append(np.array([[registration_error]]))
        dofs.append(np.inf)
    tests = {"dofs": np.array(dofs), "level": local_level(alpha, 2)}
    degree, turns = np.degrees(1.0), np.append(angle, np.zeros(len(bases[0]) - 1))
    tilt = _difference(angle * degree, turns, tilts, **tests, unit=degree)
    moved = _difference(offset, [offset], offsets, **tests)
    words = [word for word, one in (("tilted", tilt), ("moved", moved)) if one.significant]
    return PlaneComparison(
        verdict="no overlap" if apart else " and ".join(words) or "same",
        tilt=tilt,
        offset=moved,
        place=at,
        registration_error=float(registration_error),
    )


def _great_circle(first, second):
    """Angle of two unit normals, and for each the directions into which it may turn: along the
    great circle of both, then across."""
    cosine, gap = first @ second, second - first
    along = gap - first * (first @ gap)
    sine = np.linalg.norm(along)
    if sine == 0:
        basis = np.linalg.svd(first[None])[2][1:]
        return np.arctan2(0.0, cosine), (basis, basis)
    along /= sine
    across = np.linalg.svd([first, along])[2][2:]
    tangents = along, cosine * along - sine * first
    return np.arctan2(sine, cosine), [np.vstack([one, across]) for one in tangents]


def _turns(plane):
    """Turns of the normal that lift one rim by 1; a rim is sqrt(3) deviations from the center."""
    directions, inverse, _ = np.linalg.svd(plane.axes, full_matrices=False)
    return directions * inverse * np.sqrt(plane.sum_weights / 3)


def _are_apart(a, b):
    """Whether two clouds leave a gap: in the plane of each, an axis separates their rectangles."""
    step, sides = b.middle - a.middle, [_sides(one.plane) for one in (a, b)]

    def separates(axes):
        reach = sum(np.abs(axes.T @ sides_of) @ rims for sides_of, rims in sides)
        return (np.abs(axes.T @ step) > CORNERS * reach).any()

    return all(separates(axes) for axes, _ in sides)


def _sides(plane):
    """Axes of a cloud in its plane, as columns, and the distances of its rims from the center."""
    axes, inverse, _ = np.linalg.svd(plane.axes, full_matrices=False)
    return axes, np.sqrt(3 / plane.sum_weights) / inverse


def _difference(value, values, roots, dofs, level, unit=1.0):
    """A `Difference` of this value, from its parts along all directions in radians or units, and
    the roots of their covariances."""
    # Both clouds are independent, so covariances add up.
    covariances = [root @ root.T for root in roots]
    values, k, together = np.asarray(values), len(values), sum(covariances)
    dof = welch([np.trace(c) for c in covariances], dofs)
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
