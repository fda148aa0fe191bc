"""The least squares cylinder of a few points."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.runtime._compiling import compiled_function

N_PARAMETERS = 5  # of a cylinder


class FitLimits(NamedTuple):
    """When a fit ends. They reach kernels as arguments, which would freeze imported constants."""

    n_steps: int = 8  # most steps from each start; from a good one two or three suffice
    least_gain: float = 1e-6  # share of the sum of squares that a step must gain
    # Keeps the equations of a flat strip, whose radius is infinite, from being singular.
    ridge: float = 1e-12


class Cylinder(NamedTuple):
    """A circular cylinder without ends."""

    point: np.ndarray  # of the axis
    axis: np.ndarray  # unit vector
    radius: float

    def distances(self, points):
        """Signed distances of points (n, 3) from the surface, positive outside."""
        # Each by itself, whereas a product of matrices depends on where in them a point is.
        gaps = [points[:, i] - self.point[i] for i in range(3)]
        along = gaps[0] * self.axis[0] + gaps[1] * self.axis[1] + gaps[2] * self.axis[2]
        x, y, z = (gap - along * step for gap, step in zip(gaps, self.axis, strict=True))
        return np.sqrt(x * x + y * y + z * z) - self.radius


def fit_cylinder(points, normals):
    """Fit a cylinder to points by least squares of their distances (Gauss-Newton).

    The search for the axis starts from three directions. The longest extent of the points is right
    for a pole, and the second extent for a wide strip of a column. The direction most nearly
    perpendicular to all normals, of either sign, is right for pieces as high as wide; where all are
    equal, as of points that borrowed one plane, it is any. Points of an
    exact plane have no best cylinder and get a poor one: compare it with their plane. There must be
    at least six points. Returns the sum of squares and the `Cylinder`.
    """
    center = points.mean(axis=0)
    local = points - center
    scale = np.sqrt(np.square(local).sum() / len(local))
    if not scale > 0:
        return 0.0, Cylinder(center, np.array([0.0, 0.0, 1.0]), 0.0)
    local /= scale
    extents = np.linalg.eigh(local.T @ local)[1]
    across, turns = np.linalg.eigh(normals.T @ normals)
    starts = [extents[:, 2], extents[:, 1], turns[:, 0]]
    limits = FitLimits()
    starts = np.stack(starts if across[1] > limits.ridge * len(points) else starts[:2])
    fit = compiled_function("segmentation._cylinder_numba", "fit")
    total, model = fit(local, starts, limits)
    return total * scale**2, Cylinder(center + scale * model[:3], model[3:6], scale * model[6])
