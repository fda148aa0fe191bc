"""Precision of an adjusted plane: covariance, standard errors, confidence bands."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, fdtri, ndtri, stdtrit

CLEAR = 4.0  # standard errors of a coordinate of a normal from which on its sign is known
ROUNDING = 8 * np.finfo(float).eps  # of such a coordinate


@dataclass(frozen=True, eq=False)
class PlanePrecision:
    """Covariance and standard errors of a plane, as of ``detector.precision()``.

    They are propagated to first order from one scale, as of uncorrelated observations (JCGM 100,
    5.1.2); what these have in common is in the scale. Angles are in degrees,
    lengths in units of X. There are k = rank - 1 tilts, two in space.

    Attributes
    ----------
    scale, dof : float
        Standard deviation of unit weight and its degrees of freedom, which are ``inf`` a priori.
    alike : float
        How many times larger the errors are than those of independent noise: 1 where the points
        show none that is alike nearby.
    covariance : ndarray of shape (n_features + 1, n_features + 1)
        Of ``normal_`` and ``distance_``; singular, because the normal keeps its length.
    slopes_covariance : ndarray of shape (n_features, n_features)
        Of ``coef_`` and ``intercept_``; not finite for an upright plane.
    offset_error : float
        Of the plane across itself, at the center of its points. The error of ``distance_`` holds
        the tilts times the distance of the origin as well.
    cone : float
        Root mean square angle between the normal and its true value.
    ellipse, ellipse_axes : ndarray of shape (k,) and (n_features, k)
        Semi-axes of the standard error ellipse of the normal, descending, and their directions.
    tilt, tilt_error, azimuth, azimuth_error : float
        Angle to the horizontal; direction of fall, clockwise from the y axis (nan unless in space,
        with an infinite error if horizontal); and their standard errors.
    """

    scale: float
    dof: float
    alike: float
    covariance: NDArray[np.float64]
    slopes_covariance: NDArray[np.float64]
    offset_error: float
    cone: float
    ellipse: NDArray[np.float64]
    ellipse_axes: NDArray[np.float64]
    tilt: float
    tilt_error: float
    azimuth: float
    azimuth_error: float

    def confidence_factor(self, level: float = 0.95) -> float:
        """``sqrt(k F)``, from the standard ellipse to the one of a confidence level; 2.45 a priori
        in space."""
        return quantile(level, self.dof, len(self.ellipse))


def quantile(level, dof, k=1):
    """``sqrt(k F)``, the radius of a region of k parameters; for k = 1 the two-sided t."""
    if np.isinf(dof):
        return float(np.sqrt(chdtri(k, 1 - level)) if k > 1 else -ndtri((1 - level) / 2))
    if k > 1:
        return float(np.sqrt(k * fdtri(k, dof, level)))
    return float(-stdtrit(dof, (1 - level) / 2))


def welch(variances, dofs):
    """Degrees of freedom of a sum of estimated variances; infinite ones are of known scales."""
    parts = (np.square(variances) / np.maximum(dofs, 1)).sum()
    return np.sum(variances) ** 2 / parts if parts > 0 else np.inf


def parameter_derivatives(plane):
    """Derivatives of unit normal (rows 0 to d - 1) and distance by whitened parameters, whose
    cofactor matrix is the identity.

    With the rows g of `PlaneAdjustment.design`, parameters t raise the plane by ``g't`` along its
    residuals. Its direction becomes ``direction - axes t``, and is then scaled to length 1.
    """
    normal, length = plane.normal, np.linalg.norm(plane.direction)
    derivatives = np.zeros((len(normal) + 1, plane.rank))
    across = plane.axes - np.outer(normal, normal @ plane.axes)
    derivatives[:-1, 1:] = -across / length
    derivatives[-1] = plane.center @ derivatives[:-1]
    derivatives[-1, 0] = 1 / (length * np.sqrt(plane.sum_weights))
    return derivatives * plane.deviations


def pointed_up(plane, scale):
    """The plane of an orthogonal surface with its normal up; that of a wall to +y, or +x.

    The last coordinate decides that is more than four of its standard errors, of this scale of
    unit weight: noise has no say.
    """
    with np.errstate(over="ignore"):  # of points as thick as they are wide errors are infinite
        errors = np.linalg.norm(scale * parameter_derivatives(plane)[:-1], axis=1)
    clear = np.abs(plane.normal) > CLEAR * errors + ROUNDING
    axis = np.flatnonzero(clear)[-1] if clear.any() else np.abs(plane.normal).argmax()
    return plane if plane.normal[axis] > 0 else plane.reversed()


def precision_of(plane, scale, dof, alike=1.0):
    """The `PlanePrecision` of a `PlaneAdjustment`."""
    normal, k = plane.normal, plane.rank - 1
    roots = scale * parameter_derivatives(plane)
    axes, errors, _ = np.linalg.svd(roots[:-1], full_matrices=False)
    sine, azimuth, azimuth_error = float(np.linalg.norm(normal[:-1])), np.nan, np.nan
    upright, tilt_error = np.sign(normal[-1]) or 1.0, errors[0]
    if sine:  # into the direction that the normal turns to if the tilt grows
        steeper = np.append(normal[:-1] / sine * abs(normal[-1]), -upright * sine)
        tilt_error = np.linalg.norm(steeper @ roots[:-1])
    if len(normal) == 3:
        x, y = upright * normal[:2]  # of the normal that points up
        azimuth = np.degrees(np.arctan2(x, y)) % 360
        level = np.array([normal[1], -normal[0], 0.0])
        azimuth_error = np.degrees(np.linalg.norm(level @ roots[:-1]) / sine**2) if sine else np.inf
    # Of z = x @ coef + intercept, with coef = -normal[:-1] / normal[-1].
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.append(-normal[:-1], plane.center @ normal) / normal[-1]
        slopes = np.vstack([-roots[:-2], roots[-1:]]) - np.outer(values, roots[-2])
        slopes_covariance = slopes / normal[-1] @ slopes.T / normal[-1]
    offset = scale / np.sqrt(plane.sum_weights) / np.linalg.norm(plane.direction)
    return PlanePrecision(
        scale=float(scale),
        dof=float(dof),
        alike=float(alike),
        covariance=roots @ roots.T,
        slopes_covariance=slopes_covariance,
        offset_error=float(offset),
        cone=float(np.degrees(np.linalg.norm(errors))),
        ellipse=np.degrees(errors[:k]),
        ellipse_axes=axes[:, :k],
        tilt=float(np.degrees(np.arctan2(sine, abs(normal[-1])))),
        tilt_error=float(np.degrees(tilt_error)),
        azimuth=float(azimuth),
        azimuth_error=float(azimuth_error),
    )
