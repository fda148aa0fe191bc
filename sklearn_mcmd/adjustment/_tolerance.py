"""Flatness of points against a tolerance: zones, shares, and what is significant."""

from functools import partial
from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linprog
from scipy.special import chdtrc

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.adjustment._base import PlaneDetector, check_points
from sklearn_mcmd.adjustment._least_squares import adjust_plane
from sklearn_mcmd.adjustment._precision import quantile
from sklearn_mcmd.adjustment._tests import local_level
from sklearn_mcmd.planes._form import FormLimits, bow_of, cells_of

MEDIAN_POINTS = 8  # of the smallest cells, whose median single outliers do not move
MOST_HALVINGS = 8  # more points then make cells more precise, and not smaller
CLUSTER = 0.25  # share of a small cell outside for certain from which on it is no ghost's
LEAST_HALVINGS = 2  # four cells, which show a bow along and across
MEDIAN = np.sqrt(np.pi / 2)  # error of a median of normal noise over that of a mean
LEFT_OVER = 0.05  # chance of what a bow leaves of medians, below which they have another form
POWER_95 = 1.645  # deviations by which a bump is higher than its least median, at 95 %
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
        Cells of about as many points, outliers too, whose medians show the form of the surface.
    form, form_uncertainty : float
        The least distance of two parallel planes that hold these medians, and its uncertainty.
    cell, bump, bump_height : tuple of float, tuple of float, float
        Usual sides of these cells; sides, and the height above all else, from which on a bump
        forbids "kept" with a probability of 0.95.
    verdict : {"exceeded", "kept", "undecided"}
        "kept" if two parallel planes at the tolerance hold the medians of all cells with their
        uncertainties, of smaller cells those that are more than noise, and the bow that fits these
        best; or if they hold all points. "exceeded" if none hold these medians even less their
        uncertainties, or if the bow explains them and is higher. Otherwise nothing is proven (ISO
        14253-1).
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


class _Noise(NamedTuple):
    """That of the points (n,) of a plane, across it."""

    weights: np.ndarray
    deviation: float  # of unit weight
    of_points: np.ndarray  # the uncertainty of each point
    half_step: float  # by which a file may round all points of a cell alike


class _Zone(NamedTuple):
    """The plane in the middle of the least zone: slopes, constant, and its half width."""

    slopes: np.ndarray
    constant: float
    largest: float


def flatness(detector: PlaneDetector, X: "ArrayLike", tolerance: float) -> PlaneFlatness:
    """Compare the points of a fitted plane with a tolerance of flatness (ISO 1101).

    The zone between two parallel planes may lie anywhere. Medians of cells judge the surface, then
    those of ever smaller ones; a single ghost moves none. A point is outside if it is farther than
    half the tolerance from the plane of least squares, as noise alone brings some, and significant
    if by more than its test allows. Noise that is alike nearby looks like form.

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
    >>> X[X[:, 0] > 3, 2] += 0.02
    >>> result = flatness(BaardaPlaneDetector(sigma0=0.001).fit(X), X, 0.01)
    >>> print(f"{result.n_outside} outside, {result.verdict}; zone {result.minimum_zone:.4f}")
    91 outside, exceeded; zone 0.0055
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
        noise, noise_dof = max(form.noise, fitted.least_scale), form.noise_dof
    # Single points, each by the level of one of n.
    residuals, spread = plane.evaluate(X)
    residuals /= length
    weights = np.ones(len(X)) if fitted.weights is None else fitted.weights
    level = local_level(detector.alpha, len(X))
    factor = quantile(1 - level, dof)
    with np.errstate(divide="ignore"):
        uncertainty = factor * scale / length * np.sqrt(1 / weights + spread)
    exceeded = np.abs(residuals) - uncertainty > half
    passes = detector.labels_ == detector.labels_.max()  # all, if none passes
    passed = X[passes]
    zone = np.ptp(adjust_plane(passed, surface="orthogonal").evaluate(passed)[0])

    judged, step = weights > 0, fitted.step / length
    figures = _surface(
        (X[judged] - plane.center) @ plane.directions,
        residuals[judged],
        half,
        lambda m: quantile(1 - local_level(detector.alpha, m), noise_dof),
        _Noise(weights[judged], noise / length, uncertainty[judged], step / 2),
    )
    if figures["verdict"] == "undecided" and minimum_zone(X[judged]) + step <= tolerance:
        figures["verdict"] = "kept"
    return PlaneFlatness(
        tolerance=float(tolerance),
        n_points=len(X),
        n_outside=int(np.count_nonzero(np.abs(residuals) > half)),
        n_significant=int(np.count_nonzero(exceeded)),
        zone=float(zone),
        minimum_zone=minimum_zone(passed),
        uncertainty=float(uncertainty.max()),
        **figures,
    )


def _surface(places, residuals, half, factor, noise):
    """The verdict of medians of ever smaller cells on a zone of twice this half, and its figures.

    The function `factor` tells the quantile of so many cells at once.
    """
    n = len(places)
    last = max(int(np.log2(n / MEDIAN_POINTS)), min(LEAST_HALVINGS, n // 2))
    last = min(last, MOST_HALVINGS)
    first = min(FormLimits().halvings, last)
    scales = range(first, last + 1, 2)
    cells = cells_of(places, residuals, noise.weights, first)
    figures: dict = {"n_cells": len(cells.weights), "cell": _sides(cells, places)}
    kept, exceeded = True, False
    for scale in scales:
        if scale > first:
            cells = cells_of(places, residuals, noise.weights, 2, cells)
        heights, errors = _medians(cells, residuals, noise)
        limits = errors * factor(len(heights) * len(scales)) + noise.half_step
        zone = partial(_least_largest, cells.places, heights)
        # Most small cells are off by noise alone. The first show the form.
        is_noise = (np.abs(heights) <= limits) & (scale > first)
        inside = zone(np.where(is_noise, -limits, limits))
        kept &= inside.largest <= half
        exceeded |= zone(-limits).largest > half
        if scale == first:
            form, uncertainty = zone(np.zeros(len(limits))).largest, float(limits.max())
            figures |= {"form": 2 * form, "form_uncertainty": 2 * uncertainty}
    # Many points of a small cell outside for certain are a bump that is smaller than the cell.
    distances = residuals - places @ inside.slopes - inside.constant
    outside = np.abs(distances) - noise.of_points > half
    shares = np.bincount(cells.of_point, outside) / np.bincount(cells.of_point)
    kept &= shares.max() < CLUSTER
    # Medians show little of a bow, which goes on to the rims. It is proven where nothing else is
    # left of them; at a step it would overshoot.
    unit = errors.max() or 1.0
    precisions = (unit / np.where(errors > 0, errors, unit)) ** 2
    surface, cofactor, _, n_bows, left = bow_of(cells.places, heights, precisions, places)
    if (dof := len(heights) - places.shape[1] - 1 - n_bows) > 0:
        bow = 2 * _least_largest(places, surface).largest
        uncertainty = factor(1) * np.sqrt(cofactor) * errors.max() + 2 * noise.half_step
        kept &= bow + uncertainty <= 2 * half
        exceeded |= bow - uncertainty > 2 * half and chdtrc(dof, left / unit**2) > LEFT_OVER
    else:
        kept = False
    figures["bump"] = _sides(cells, places, 2)  # so large it covers a cell, wherever it is
    least_height = max(2 * half, float(np.median(limits)))
    figures["bump_height"] = least_height + 2 * POWER_95 * float(np.median(errors))
    return figures | {"verdict": "exceeded" if exceeded else "kept" if kept else "undecided"}


def _medians(cells, residuals, noise):
    """Medians of cells, and their standard errors."""
    counts = np.bincount(cells.of_point)
    order = np.argsort(cells.of_point, kind="stable")
    parts = np.split(residuals[order], np.cumsum(counts)[:-1])
    # The densities of noise / sqrt(p) at the median add up.
    roots = np.bincount(cells.of_point, np.sqrt(noise.weights))
    errors = MEDIAN * noise.deviation * np.sqrt(counts) / roots
    return np.array([np.median(part) for part in parts]), errors


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
        normal = normal - _least_largest(X @ basis.T, X @ normal).slopes @ basis
        normal /= np.linalg.norm(normal)
    return float(np.ptp(X @ normal))


def _least_largest(along, across, margins=0.0):
    """The `_Zone` of the plane of least largest ``|distance| + margin`` along an axis.

    A program begins with a few points, and takes those farthest outside of its zone until none is.
    """
    d, margins = along.shape[1], np.broadcast_to(margins, across.shape)
    height = np.ptp(across) + np.ptp(margins) or 1.0
    unit = np.abs(along).max(axis=0)
    unit[unit == 0] = 1.0
    design, heights = np.column_stack([along / unit, np.ones(len(along))]), across / height
    margins = margins / height
    solution, active = np.append(np.zeros(d + 1), -np.inf), np.empty(0, dtype=np.intp)
    while True:
        residuals = heights - design @ solution[:-1]
        largest = (np.abs(residuals) + margins).max()
        lowest, highest = np.argsort(margins - residuals), np.argsort(margins + residuals)
        added = np.union1d(active, np.r_[lowest[-d - 2 :], highest[-d - 2 :]])
        if len(added) == len(active) or largest <= solution[-1] + LP_TOLERANCE:
            slopes, constant = solution[:-2] / unit * height, float(solution[-2] * height)
            return _Zone(slopes, constant, float(largest * height))
        active, one = added, -np.ones((len(added), 1))
        rows, sides, inset = design[active], heights[active], margins[active]
        both, goal = np.block([[rows, one], [-rows, one]]), np.append(np.zeros(d + 1), 1.0)
        limits = np.append(sides - inset, -sides - inset)
        solution = linprog(goal, both, limits, bounds=(None, None)).x
