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
from sklearn_mcmd.planes._form import FormLimits, cells_of, planes_of

LEAST_POINTS = 12  # of a cell with a plane, if they are enough for cells that show a bow
LEAST_HALVINGS = 2  # four cells, which show a bow along and across
MEAN_POINTS = 4  # of the smallest cells, of which there are means alone
FAR = 3  # times the usual leverage: beside its cell; a corner of an even one has 7/3
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
        The largest of the distance of a point.
    n_cells : int
        Cells of about as many points that pass, whose own planes show the form of the surface.
    form, form_uncertainty : float
        The largest distance of these planes, and the largest uncertainty of one.
    cell, bump, bump_height : tuple of float, tuple of float, float
        Usual sides of these cells, and sides and height from which on a bump forbids "kept".
    verdict : {"exceeded", "kept", "undecided"}
        "exceeded" if a plane, the mean of a cell, or a point is off by more than half the tolerance
        and its uncertainty; else "kept" if all planes are within it by as much, and each mean that
        is more than noise. Otherwise nothing is proven (ISO 14253-1).
    """

    tolerance: float
    n_points: int
    n_outside: int
    n_significant: int
    zone: float
    minimum_zone: float
    uncertainty: float
    n_cells: int
    form: float
    form_uncertainty: float
    cell: tuple[float, ...]
    bump: tuple[float, ...]
    bump_height: float
    verdict: str


def flatness(detector: PlaneDetector, X: "ArrayLike", tolerance: float) -> PlaneFlatness:
    """Compare the points of a fitted plane with a tolerance of flatness (ISO 12781-1).

    Planes of cells judge the surface, then means of ever smaller ones, then single points. One is
    outside if it is farther than half the tolerance from the plane, as noise alone brings some, and
    significant if by more than its test allows. Noise that is alike nearby looks like form.

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
    fitted, form, half = detector._fitted, detector.form_, tolerance / 2
    plane, length = fitted.plane, np.linalg.norm(fitted.plane.direction)
    # The scale of a single point; and of cells the noise within them, if there are enough points.
    scale, dof = fitted.scale, detector.dof_
    if detector.test_ == "w":
        scale, dof = detector.sigma0_, np.inf
    noise, noise_dof = scale, dof
    if np.isfinite(form.pvalue):
        noise, noise_dof = max(form.noise, fitted.rounding), form.noise_dof
    # Single points, each by the level of one of n.
    residuals, spread = plane.evaluate(X)
    residuals /= length
    weights = np.ones(len(X)) if fitted.weights is None else fitted.weights
    level = local_level(detector.alpha, len(X))
    factor = quantile(1 - level, dof)
    with np.errstate(divide="ignore"):
        uncertainty = factor * scale / length * np.sqrt(1 / weights + spread)
    exceeded = np.abs(residuals) - uncertainty > half
    passes = detector.labels_ == max(detector.labels_)  # all, if none passes
    passed = X[passes]
    zone = np.ptp(adjust_plane(passed, surface="orthogonal").evaluate(passed)[0])

    judged = passes & (weights > 0)
    verdict, figures = _surface(
        (X[judged] - plane.center) @ plane.directions,
        residuals[judged],
        weights[judged],
        tolerance,
        noise / length,
        lambda m, rank: quantile(1 - local_level(detector.alpha, m), noise_dof, rank),
    )
    return PlaneFlatness(
        tolerance=float(tolerance),
        n_points=len(X),
        n_outside=int(np.count_nonzero(np.abs(residuals) > half)),
        n_significant=int(np.count_nonzero(exceeded)),
        zone=float(zone),
        minimum_zone=minimum_zone(passed),
        uncertainty=float(uncertainty.max()),
        verdict="exceeded" if exceeded.any() else verdict,
        **figures,
    )


def _surface(places, residuals, weights, tolerance, noise, factor):
    """Verdict of planes of cells and of means of ever smaller ones, and the figures of both.

    The function `factor` tells the quantile of so many cells of so many unknowns at once.
    """
    half, rank = float(tolerance) / 2, places.shape[1] + 1
    enough, last = (max(int(np.log2(len(places) / m)), 0) for m in (LEAST_POINTS, MEAN_POINTS))
    first = min(max(enough, LEAST_HALVINGS), FormLimits().halvings, last)
    scales = range(first, last + 1, 2)
    cells = cells_of(places, residuals, weights, first)
    heights, cofactors = planes_of(cells, places, residuals, weights, noise)
    near = cofactors * cells.weights[cells.of_point] <= FAR * rank
    heights = np.abs(heights[near])
    error = noise * factor(len(cells.weights) * len(scales), rank) * np.sqrt(cofactors[near])
    figures = {"n_cells": len(cells.weights), "cell": _sides(cells, places)}
    figures |= {"form": float(heights.max()), "form_uncertainty": float(error.max())}
    kept, exceeded = np.all(heights + error <= half), np.any(heights - error > half)
    for scale in scales:
        if scale > first:
            cells = cells_of(places, residuals, weights, 2, cells)
        heights = np.abs(cells.residuals)
        error = noise * factor(len(heights) * len(scales), 1) / np.sqrt(cells.weights)
        kept &= np.all(heights <= np.maximum(error, half - error))
        exceeded |= np.any(heights - error > half)
    figures["bump"] = _sides(cells, places, 2)  # so large it covers a cell, wherever it is
    figures["bump_height"] = max(2 * float(np.median(error)), half)
    return "exceeded" if exceeded else "kept" if kept else "undecided", figures


def _sides(cells, places, times=1):
    """Usual sides of cells: half of the points are within a quarter of a side of the middle."""
    local = np.abs(places - cells.places[cells.of_point])
    return tuple((4 * times * np.median(local, axis=0)).tolist())


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
        order = np.argsort(residuals)  # those at both ends, or all if they are fewer
        added = np.union1d(active, np.append(order[: d + 2], order[-d - 2 :]))
        if len(added) == len(active) or np.abs(residuals).max() <= solution[-1] + LP_TOLERANCE:
            return solution[:-2] / unit * height
        active, one = added, -np.ones((len(added), 1))
        rows, sides = design[active], heights[active]
        both, goal = np.block([[rows, one], [-rows, one]]), np.append(np.zeros(d + 1), 1.0)
        solution = linprog(goal, both, np.append(sides, -sides), bounds=(None, None)).x
