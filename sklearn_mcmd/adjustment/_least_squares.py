"""Weighted least-squares planes: coefficients, cofactors and redundancy numbers."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.linalg import eigh
from numpy.typing import NDArray
from scipy.linalg import lstsq, orth

from sklearn_mcmd._choices import Surface
from sklearn_mcmd.planes._principal_planes import tilt_variances
from sklearn_mcmd.planes._resolution import RoundingLimits, axis_steps
from sklearn_mcmd.runtime._chunks import slices

CHUNK = 1 << 15  # rows that are processed together, whose copy stays in the processor's cache

# Spread of a direction over the largest, squared and of columns scaled alike, of collinear columns.
RANK_TOLERANCE = 1e-13


class Rounding(NamedTuple):
    """What is rounded in the coordinates of points."""

    errors: NDArray[np.float64]  # of float64, the largest in each coordinate
    steps: NDArray[np.float64]  # to which the file rounded each before, 0 if it did not

    def error_of_float64(self, direction):
        """The largest in a residual of this direction, which is only rounding if it is no longer.

        On a steep vertical surface the rounding of the regressors enters the residuals.
        """
        return max(float(np.abs(direction) @ self.errors), np.finfo(float).tiny)

    def least_deviation(self, direction, steps=12**-0.5):
        """Of a residual of this direction: that of values rounded to a step, if it is more."""
        return max(self.error_of_float64(direction), steps * self.step_of(direction))

    def step_of(self, direction):
        """That of a residual of this direction."""
        return float(np.linalg.norm(self.steps * direction))

    def least_robust_deviation(self, direction):
        """Of which a point one step beside a plane is within 2.5: most points may lie on one
        level, which tells nothing of the noise."""
        return self.least_deviation(direction, RoundingLimits().least_steps)


class Training(NamedTuple):
    """Points to test, and their weights, None where all are 1."""

    X: NDArray[np.float64]
    weights: NDArray[np.float64] | None
    used: NDArray[np.bool_]  # points of positive weight
    rounding: Rounding

    def deviation_of(self, plane):
        """Estimated standard deviation of unit weight, no less than rounding."""
        return max(np.sqrt(plane.variance_factor), self.rounding.least_deviation(plane.direction))


@dataclass(frozen=True, eq=False)
class PlaneAdjustment:
    """A least-squares plane with the numbers that its tests need (Eqs 9-10).

    The design matrix is never formed. Regressors are centered and whitened, so that
    ``a_i' N^-1 a_i = 1 / sum(p) + |U_i|^2`` with ``U = (X - center) @ axes``, where `center` (d,)
    is the weighted mean and `axes` is (d, rank - 1). Nothing else of the cofactor matrix is needed,
    and coordinates of 10^7 cost no accuracy.

    Residuals are ``(X - center) @ direction``: observed minus adjusted, the sign that surveyors use
    on maps; the paper's v has the opposite sign. The direction (d,) is ``(-slopes, 1)`` for a
    vertical surface and the unit normal for an orthogonal one. `sum_of_squares` is v'Pv, and
    `n_observations` counts the points of positive weight.
    """

    center: NDArray[np.float64]
    axes: NDArray[np.float64]
    direction: NDArray[np.float64]
    sum_weights: float
    sum_of_squares: float
    n_observations: int
    surface: Surface

    @property
    def rank(self) -> int:
        """Number of estimable parameters u."""
        return self.axes.shape[1] + 1

    @property
    def dof(self) -> int:
        """Degrees of freedom f = n - u, never negative."""
        return max(self.n_observations - self.rank, 0)

    @property
    def variance_factor(self) -> float:
        """Estimated variance of unit weight v'Pv / f; 0 without redundancy."""
        return self.sum_of_squares / self.dof if self.dof else 0.0

    @property
    def normal(self) -> NDArray[np.float64]:
        """Unit normal, on the side of positive residuals."""
        return self.direction / np.linalg.norm(self.direction)

    @property
    def coef(self) -> NDArray[np.float64]:
        """Slopes of ``z = x @ coef + intercept``; not finite for an upright plane."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return -self.direction[:-1] / self.direction[-1]

    @property
    def intercept(self) -> float:
        """Constant term of ``z = x @ coef + intercept``."""
        with np.errstate(invalid="ignore"):
            return float(self.center[-1] - self.center[:-1] @ self.coef)

    @property
    def deviations(self) -> NDArray[np.float64]:
        """Standard deviations of the whitened parameters over sigma0: 1, but more for the tilts of
        an orthogonal surface that is not much wider than its noise."""
        deviations = np.ones(self.rank)
        if self.surface == "orthogonal":
            widths = 1 / np.einsum("ij,ij->j", self.axes, self.axes)
            gaps = np.maximum(widths - self.sum_of_squares, np.finfo(float).tiny)
            deviations[1:] = np.sqrt(tilt_variances(widths, gaps, widths))
        return deviations

    def toward(self, place):
        """The plane with its normal on the side of a place."""
        return self.reversed() if (place - self.center) @ self.direction < 0 else self

    def reversed(self):
        """The plane with its normal to the other side."""
        return replace(self, direction=-self.direction)

    @property
    def directions(self) -> NDArray[np.float64]:
        """Principal axes (d, rank - 1) of the points in the plane, of length 1."""
        return np.linalg.svd(self.axes, full_matrices=False)[0]

    def evaluate(self, X):
        """Residuals of points and cofactors of the plane below them.

        Residuals are observed minus adjusted, in units of X. A cofactor is ``a_i' N^-1 a_i``, the
        variance of the adjusted value over sigma0^2; times the point's weight it is its leverage
        h_i.
        """
        n = X.shape[0]
        residuals, cofactors = np.empty(n), np.empty(n)
        for rows in slices(n, CHUNK):
            U, residuals[rows] = self.whiten(X[rows])
            cofactors[rows] = np.einsum("ij,ij->i", U, U) + 1 / self.sum_weights
        return residuals, cofactors

    def whiten(self, X):
        """Whitened regressors (n, rank - 1) and residuals (n,) of a few points."""
        local = (X - self.center) @ np.column_stack([self.axes, self.direction])
        return local[:, :-1], local[:, -1]

    def design(self, U):
        """Rows g of the whitened design matrix, with the constant first; ``g'g`` is a cofactor."""
        return np.column_stack([np.full(len(U), self.sum_weights**-0.5), U])


def adjust_plane(X, weights=None, *, surface="vertical"):
    """Weighted least-squares plane, its cofactors and variance factor (Eqs 2-4, 9).

    The last column of X (n, d) is the dependent variable of a vertical surface; residuals are along
    it (the paper), or along the normal of an orthogonal one (total least squares, for walls).
    Weights are precisions ``p_i = sigma0^2 / sigma_i^2``; points of weight 0 take no part. Raise if
    squares of X overflow.

    Rank-deficient designs (collinear or constant regressors, one location) get the slopes of
    minimum norm. Residuals and redundancy numbers do not depend on that choice.

    The whitening is done twice, like a second Gram-Schmidt step. The first pass squares the
    condition number, and the second restores the accuracy lost by that.
    """
    # Step 1: the plane by the scatter about the mean, and whitened axes (Eqs 2-4).
    used = np.arange(X.shape[0]) if weights is None else np.flatnonzero(weights)
    # Any point inside the cloud can be the first origin: take the mean of a thinned cloud.
    origin = X[used[:: len(used) // 1024 + 1]].mean(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        total, first, second = _moments(X, origin, None, weights)
    if not np.all(np.isfinite(second)):
        raise ValueError(
            "X has coordinates whose squares overflow float64; remove those points or rescale X to "
            "smaller units."
        )
    mean = first / total
    scatter = second - np.outer(mean, first)
    center = origin + mean
    # A constant column is not exactly zero after centering; this is its rounding.
    rounding = total * (64 * np.finfo(float).eps * np.abs(center)) ** 2
    solve = _solve_orthogonal if surface == "orthogonal" else _solve_vertical
    axes, direction = solve(scatter, rounding)

    # Step 2: the same again, in coordinates that are already nearly white.
    basis = np.column_stack([axes, direction])
    total, first, second = _moments(X, center, basis, weights)
    mean = first / total
    center = center + lstsq(basis.T, mean)[0]
    second = second - np.outer(mean, first)
    white, cross = second[:-1, :-1], second[:-1, -1]
    slopes = np.linalg.solve(white, cross)
    values, vectors = eigh(white)
    direction = direction - axes @ slopes
    if surface == "orthogonal":
        direction = direction / np.linalg.norm(direction)
    # v'Pv is what the slopes leave of the squares across (Eq. 9).
    n_observations = X.shape[0] if weights is None else np.count_nonzero(weights)
    return PlaneAdjustment(
        center=center,
        # The symmetric root rotates the axes as little as possible.
        axes=axes @ (vectors / np.sqrt(values)) @ vectors.T,
        direction=direction,
        sum_weights=float(total),
        sum_of_squares=float(max(second[-1, -1] - cross @ slopes, 0.0)),
        n_observations=int(n_observations),
        surface=surface,
    )


def weighed(values, weights):
    """Values times weights, None where all are 1; of a mask the weights of its points, else 0."""
    return values * (1.0 if weights is None else weights)


def rounding_of(X, surface):
    """The `Rounding` of points; regressors of a vertical surface are exact."""
    steps = axis_steps(X)
    steps[: -1 if surface == "vertical" else 0] = 0.0
    return Rounding(rounding_errors(X), steps)


def rounding_errors(X):
    """Largest rounding error of float64 in each coordinate of the points of an exact plane.

    In steps of float64 at the largest coordinate of a column, it is 1/2 of storing it, up to
    ``d / 2`` of computing it from the others, and up to 1 of the center. A residual of centered
    coordinates takes d products and d - 1 sums along a rounded direction: ``(d + 1) eps`` of the
    extent of the cloud.
    """
    d = X.shape[1]
    low, high = X.min(axis=0), X.max(axis=0)
    with np.errstate(over="ignore"):
        extent = high - low
    steps = np.spacing(np.maximum(np.abs(low), np.abs(high)))
    return (d + 3) / 2 * steps + (d + 1) * np.finfo(float).eps * extent


def _moments(X, origin, basis, weights):
    """Weighted count, sum and second moment of (X - origin) @ basis."""
    width = X.shape[1] if basis is None else basis.shape[1]
    total, first, second = 0.0, np.zeros(width), np.zeros((width, width))
    for rows in slices(len(X), CHUNK):
        local = X[rows] - origin
        if basis is not None:
            local = local @ basis
        if weights is None:
            weighted = local
            total += local.shape[0]
        else:
            weighted = local * weights[rows, None]
            total += weights[rows].sum()
        first += np.ones(len(local)) @ weighted  # three times as fast as a sum of short rows
        second += weighted.T @ local
    return total, first, second


def _solve_vertical(scatter, rounding):
    """Whitening of the regressors, and (-slopes, 1), from the scatter matrix."""
    d = scatter.shape[0]
    variance = np.diag(scatter)[:-1]
    varies = variance > rounding[:-1]
    scale = np.where(varies, 1 / np.sqrt(np.where(varies, variance, 1.0)), 0.0)
    values, vectors = eigh(scatter[:-1, :-1] * np.outer(scale, scale))
    kept = values > RANK_TOLERANCE * max(values[-1], 1.0)
    axes = np.zeros((d, np.count_nonzero(kept)))
    axes[:-1] = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    slopes = axes[:-1] @ (axes[:-1].T @ scatter[:-1, -1])
    if 0 < axes.shape[1] < d - 1:
        # Slopes across the points' own span are arbitrary: set them to zero (minimum norm).
        span = orth(scatter[:-1, :-1] @ axes[:-1])
        slopes = span @ (span.T @ slopes)
    return axes, np.append(-slopes, 1.0)


def _solve_orthogonal(scatter, rounding):
    """Whitening within the plane of least orthogonal distances, and its normal."""
    values, vectors = eigh(scatter)
    kept = values > np.maximum(RANK_TOLERANCE * values[-1], rounding.max())
    kept[0] = False
    return vectors[:, kept] / np.sqrt(values[kept]), vectors[:, 0]
