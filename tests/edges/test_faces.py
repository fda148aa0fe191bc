"""The plane that each point is given, and its noise: against planes that are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.edges._faces import (
    LEAST_NOISE,
    OFF,
    Faces,
    _spacing,
    are_faces,
    give_faces,
    measure_spacing,
)
from sklearn_mcmd.planes._record import Neighborhoods, Planes


def planes_of(normals, levels, scale, radius=10.0, spacing=1.0, kept=1.0):
    """Planes through the points of their normals that are as far from the origin as told."""
    normals = np.asarray(normals, dtype=float)
    n, d = normals.shape
    planes = Planes.empty(n, d)
    for field, value in {
        "scale": scale,
        "radius": radius,
        "spacing": spacing,
        "kept": kept,
    }.items():
        getattr(planes, field)[:] = value
    planes.normals[:] = normals
    planes.centroids[:] = normals * np.asarray(levels)[:, None]
    return planes


def all_of(m, n):
    return Neighborhoods(np.tile(np.arange(n, dtype=np.int32), (m, 1)), np.full(m, n))


def given(queries, planes, flat=None):
    n = len(planes.scale)
    flat = np.ones(n, bool) if flat is None else np.asarray(flat)
    return give_faces(
        np.array(queries, float), all_of(len(queries), n), planes, flat, np.ones(n, bool)
    )


FLOOR, WALL = [0, 0, 1], [1, 0, 0]


def test_points_are_given_the_plane_that_they_lie_on():
    faces = given([[3, 1, 0.1], [0.1, 2, 5]], planes_of([FLOOR, WALL], [0, 0], 0.2))
    assert_array_equal(faces.normals, [FLOOR, WALL])
    assert_allclose(faces.height, [0.1, 0.1])
    assert_allclose(faces.levels, 0)
    assert_allclose(faces.scale, 0.2)
    assert faces.flat.all()
    assert faces.on_face.all()


def test_of_two_planes_through_a_point_it_is_given_the_likelier():
    # As near in standard deviations, but the wall is flatter; then the floor has more of its own.
    faces = given([[0.1, 0, 0.4]], planes_of([FLOOR, WALL], [0, 0], [0.4, 0.1]))
    assert_array_equal(faces.normals[0], WALL)
    faces = given([[0, 0, 0]], planes_of([FLOOR, WALL], [0, 0], 0.1, kept=[0.9, 0.5]))
    assert_array_equal(faces.normals[0], FLOOR)


def test_a_plane_reaches_as_far_as_its_neighborhood():
    planes = planes_of([FLOOR, WALL], [0, 0], 0.1, radius=[2.0, 10.0])
    assert_array_equal(given([[3, 0, 0]], planes).normals[0], WALL)
    # What none reaches is given the likeliest as if both were boundless.
    assert_array_equal(given([[30, 0, 0]], planes).normals[0], FLOOR)


def test_heights_are_counted_from_planes_off_the_origin():
    faces = given([[3, 1, 7.5]], planes_of([FLOOR], [7], 0.2))
    assert_allclose((faces.levels[0], faces.height[0]), (7, 0.5))


@pytest.mark.parametrize("height", [0.9 * OFF, 1.1 * OFF, -1.1 * OFF])
def test_points_more_than_three_deviations_off_are_on_no_face(height):
    faces = given([[0, 0, 0.2 * height]], planes_of([FLOOR], [0], 0.2))
    assert faces.flat[0]
    assert faces.on_face[0] == (abs(height) < OFF)


def test_points_on_foliage_are_on_no_face():
    faces = given([[0, 0, 0]], planes_of([FLOOR], [0], 0.2), flat=[False])
    assert not faces.flat[0]
    assert not faces.on_face[0]


def test_no_plane_is_known_better_than_a_share_of_the_mean_spacing():
    faces = given([[0, 0, 0]], planes_of([FLOOR, FLOOR, FLOOR], [0, 0, 0], 1e-6, spacing=[1, 1, 4]))
    assert_allclose((faces.spacing[0], faces.scale[0]), (2, 2 * LEAST_NOISE))


def test_spacing_reach_and_noise_are_those_of_a_grid():
    x, y = np.meshgrid(np.arange(21.0), np.arange(21.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(441)])
    center = points[220][None]
    near = np.argsort(np.linalg.norm(points - center, axis=1), kind="stable")[:25][None]
    around = Neighborhoods(near.astype(np.int32), np.array([25]))
    spacing, reach, scale = measure_spacing(points, center, around, np.array([0.001]))
    # The 8 nearest of a square grid lie within the root of 2: pi * 2 / 8 = .785 of a cell.
    assert_allclose(spacing, np.sqrt(np.pi / 4))
    assert_allclose(reach, np.sqrt(8))
    assert_allclose(scale, LEAST_NOISE * spacing)
    assert_allclose(measure_spacing(points, center, around, np.array([0.3]))[2], 0.3)


def test_the_spacing_of_a_line_is_its_step():
    assert_allclose(_spacing(np.arange(9.0)[None] // 2 + np.arange(9.0)[None] % 2, 2), 1.0)


def test_faces_are_flat_or_the_flatter_half():
    flatness = np.array([0.05, 0.1, 0.19, 0.21, 0.4])
    planes = planes_of([FLOOR] * 5, [0] * 5, 10 * flatness)
    assert_array_equal(are_faces(planes), flatness < 0.2)
    assert_array_equal(are_faces(planes._replace(scale=30 * flatness)), flatness < 0.2)
    assert not are_faces(planes._replace(scale=-flatness)).any()


def test_rows_are_taken_and_put():
    faces = Faces.empty(3, 2)
    for values in faces:
        values[:] = 0
    part = Faces(np.ones((1, 2)), *np.full((4, 1), 2.0), *np.ones((2, 1), bool))
    faces.put([1], part)
    assert_array_equal(faces.take([1]).normals, part.normals)
    assert_array_equal(faces.scale, [0, 2, 0])
    assert_array_equal(faces.on_face, [False, True, False])
