"""The least squares cylinder: exact ones, noise, another library, degenerate points."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sklearn_mcmd.segmentation._cylinder_parts import fit_cylinder

POSE = Rotation.from_euler("xyz", [20, 35, 50], degrees=True)
SHIFT = np.array([4e3, -2e3, 10.0])


def strip(rng, n, radius, height, arc, noise=0.0):
    """Points and normals of part of a cylinder in an oblique pose."""
    angle, along = rng.uniform(0, np.radians(arc), n), rng.uniform(0, height, n)
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    points = radius * normals + np.outer(along, [0, 0, 1]) + rng.normal(0, noise, (n, 3))
    # In the order of rows, as segments come: Numba compiles other orders anew.
    return np.ascontiguousarray(POSE.apply(points) + SHIFT), POSE.apply(normals)


@pytest.mark.parametrize(
    ("radius", "height", "arc"),
    [(0.05, 1.0, 180), (0.2, 0.8, 180), (1.0, 1.0, 40), (0.5, 0.1, 300)],
    ids=["a post", "a bin", "a piece as high as wide", "a ring"],
)
def test_points_without_noise_give_their_cylinder_back(radius, height, arc):
    points, normals = strip(np.random.default_rng(0), 80, radius, height, arc)
    total, cylinder = fit_cylinder(points, normals)
    assert total < 1e-12 * radius**2
    # Coordinates of thousands leave 1e-12, which a short arc multiplies.
    assert_allclose(cylinder.radius, radius, rtol=1e-6)
    assert_allclose(abs(cylinder.axis @ POSE.apply([0, 0, 1])), 1, rtol=1e-8)
    assert_allclose(cylinder.distances(points), 0, atol=1e-6 * radius)


@pytest.mark.parametrize("seed", range(5))
def test_the_sum_of_squares_is_that_of_a_general_optimizer(seed):
    rng = np.random.default_rng(seed)
    points, normals = strip(rng, 60, 0.2, 0.8, 150, noise=0.005)
    local = POSE.inv().apply(points - SHIFT)

    def distances(parameters):
        x, y, tilt_x, tilt_y, radius = parameters
        axis = np.array([tilt_x, tilt_y, 1]) / np.sqrt(1 + tilt_x**2 + tilt_y**2)
        away = local - [x, y, 0]
        return np.linalg.norm(away - np.outer(away @ axis, axis), axis=1) - radius

    other = least_squares(distances, [0, 0, 0, 0, 0.2], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # A step that gains less than a millionth is not made.
    assert_allclose(fit_cylinder(points, normals)[0], 2 * other.cost, rtol=1e-5)


@pytest.mark.parametrize(
    "points",
    [
        np.random.default_rng(0).uniform(size=(20, 3)) * [1, 1, 0],
        np.outer(np.arange(10.0), [1, 2, 3]),
        np.full((10, 3), 7.0),
    ],
    ids=["a plane", "a line", "copies"],
)
def test_points_of_no_cylinder_give_finite_results(points):
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    total, cylinder = fit_cylinder(points, normals)
    assert np.isfinite(total)
    assert np.isfinite(cylinder.distances(points)).all()


def test_equal_normals_start_no_search_in_a_direction_that_rounding_picks():
    """A wavy strip has several cylinders, and none depends on how the strip lies."""
    u, v = np.random.default_rng(0).uniform(-1, 1, (2, 60))
    points, normals = np.column_stack([u, 0.2 * v, 0.05 * np.sin(6 * u)]), np.eye(3)[[2] * 60]
    totals = [
        fit_cylinder(np.ascontiguousarray(turn.apply(points)), turn.apply(normals))[0]
        for turn in Rotation.random(40, random_state=1)
    ]
    assert_allclose(totals, totals[0], rtol=1e-9)
