"""Flatness of points against a tolerance: zones, shares, and what is significant."""

from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.adjustment._base import PlaneDetector, check_points
from sklearn_mcmd.adjustment._least_squares import adjust_plane
from sklearn_mcmd.adjustment._precision import quantile
from sklearn_mcmd.adjustment._tests import local_level

LP_TOLERANCE = 1e-7  # of distances over the width, that of the linear programs
N_TURNS = 3  # of the normal; each squares the angle that is left


class PlaneFlatness(NamedTuple):
    """How flat the points of a plane are, as of `flatness`; lengths in units of X.

    Parameters
    ----------
    tolerance : float
    n_points, n_outside, n_significant : int
        All points; those farther than half the tolerance from the plane; those that are so by more
        than their uncertainty.
    zone, minimum_zone : float
        Width of the points that pass across their orthogonal least-squares plane, and the least
        between any two parallel planes. Both hold the noise: of n points of noise s on a perfect
        plane some ``2 s sqrt(2 ln n)``.
    uncertainty : float
        The largest of a distance.
    verdict : {"exceeded", "kept", "undecided"}
        "exceeded" if some distance is larger than half the tolerance by more than its uncertainty,
        "kept" if all are smaller by as much. Otherwise nothing is proven (ISO 14253-1).
    """

    tolerance: float
    n_points: int
    n_outside: int
    n_significant: int
    zone: float
    minimum_zone: float
    uncertainty: float
    verdict: str


def flatness(detector: PlaneDetector, X: ArrayLike, tolerance: float) -> PlaneFlatness:
    """Compare the points of a fitted plane with a tolerance of flatness (ISO 12781-1).

    A point is outside if it is farther than half the tolerance from the plane. Noise alone brings
    points there. A distance is significant if it is so by more than the test of one point allows.
    If sigma0 is estimated, it holds the form of the surface, and fewer are significant.

    Parameters
    ----------
    detector : BaardaPlaneDetector or FuzzyPlaneDetector
        Fitted to X.
    X : array-like of shape (n_samples, n_features)
        The training points; others raise a ValueError.
    tolerance : float > 0
        Width of the zone that shall hold all points, in units of X.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.adjustment import BaardaPlaneDetector, flatness
    >>> X = np.random.default_rng(0).normal(size=(500, 3)) * [4, 4, 0.001]
    >>> X[:5, 2] += 0.02
    >>> result = flatness(BaardaPlaneDetector(sigma0=0.001).fit(X), X, 0.01)
    >>> print(f"{result.n_outside} outside, {result.verdict}; zone {result.minimum_zone:.4f}")
    5 outside, exceeded; zone 0.0056
    """
    X = check_points(detector, X)
    if not isinstance(tolerance, Real) or not 0 < tolerance < np.inf:
        raise ParameterError(f"$tolerance={tolerance!r} is no width: give a finite number above 0.")
    plane, length = detector._fitted.plane, np.linalg.norm(detector._fitted.plane.direction)
    known, half = detector.test_ == "w", tolerance / 2
    scale, dof = (detector.sigma0_, np.inf) if known else (detector._fitted.scale, detector.dof_)
    distances, _, spread = plane.evaluate(X)
    distances = np.abs(distances) / length
    weights = np.ones(len(X)) if detector._fitted.weights is None else detector._fitted.weights
    factor = quantile(1 - local_level(detector.alpha, len(X)), dof)
    with np.errstate(divide="ignore"):
        uncertainty = factor * scale / length * np.sqrt(1 / weights + spread)
    exceeded = distances - uncertainty > half
    verdict = "kept" if np.all(distances + uncertainty <= half) else "undecided"
    passed = X[detector.labels_ == max(detector.labels_)]  # all, if none passes
    zone = np.ptp(adjust_plane(passed, surface="orthogonal").evaluate(passed)[0])
    return PlaneFlatness(
        tolerance=float(tolerance),
        n_points=len(X),
        n_outside=int(np.count_nonzero(distances > half)),
        n_significant=int(np.count_nonzero(exceeded)),
        zone=float(zone),
        minimum_zone=minimum_zone(passed),
        uncertainty=float(uncertainty.max()),
        verdict="exceeded" if exceeded.any() else verdict,
    )


def minimum_zone(X):
    """Least distance of two parallel planes that hold all points.

    From the plane of least squares on, linear programs find the plane whose largest distance along
    the present normal is least, and the normal is turned to it.
    """
    plane = adjust_plane(X, surface="orthogonal")
    X, normal = X - plane.center, plane.normal
    for _ in range(N_TURNS):
        basis = np.linalg.svd(normal[None])[2][1:]
        normal = normal - _least_largest(X @ basis.T, X @ normal) @ basis
        normal /= np.linalg.norm(normal)
    return float(np.ptp(X @ normal))


def _least_largest(along, across):
    """Slopes of the plane of least largest distance along an axis.

    A program begins with a few points, and takes those farthest outside of its zone until none is.
    """
    d, height = along.shape[1], np.ptp(across) or 1.0
    unit = np.abs(along).max(axis=0)
    unit[unit == 0] = 1.0
    design, heights = np.column_stack([along / unit, np.ones(len(along))]), across / height
    solution, active = np.zeros(d + 2), np.empty(0, dtype=np.intp)
    while True:
        residuals = heights - design @ solution[:-1]
        order = np.argsort(residuals)[np.r_[: d + 2, -d - 2 : 0]]
        added = np.union1d(active, order)
        if len(added) == len(active) or np.abs(residuals).max() <= solution[-1] + LP_TOLERANCE:
            return solution[:-2] / unit * height
        active, one = added, -np.ones((len(added), 1))
        rows, sides = design[active], heights[active]
        both, goal = np.block([[rows, one], [-rows, one]]), np.append(np.zeros(d + 1), 1.0)
        solution = linprog(goal, both, np.append(sides, -sides), bounds=(None, None)).x
