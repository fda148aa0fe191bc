"""The plane that each point is given, and its noise: against planes that are known."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.edges._crease_distance import are_faces, find_creases, give_planes
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._record import Neighborhoods, Planes


def planes_of(normals, levels, scale, radius=10.0, spacing=1.0, kept=1.0):
    """Planes through the points of their normals that are as far from the origin as told."""
    normals = np.asarray(normals, dtype=float)
    n, d = normals.shape
    planes = Planes.empty(n, d)
    planes.scale[:], planes.radius[:] = scale, radius
    planes.spacing[:], planes.kept[:] = spacing, kept
    planes.normals[:] = normals
    planes.centroids[:] = normals * np.asarray(levels)[:, None]
    return planes


def given(query, planes):
    """The normal of the plane that a query is given."""
    n = len(planes.scale)
    around = Neighborhoods(np.arange(n, dtype=np.int32)[None], np.array([n]))
    owner = give_planes(np.array(query, float), around, planes, np.ones(n, bool))[0]
    return planes.normals[owner]


FLOOR, WALL = [0, 0, 1], [1, 0, 0]


def test_of_two_planes_through_a_point_it_is_given_the_likelier():
    # As near in standard deviations, but the wall is flatter; then the floor has more of its own.
    planes = planes_of([FLOOR, WALL], [0, 0], [0.4, 0.1])
    assert_array_equal(given([[0.1, 0, 0.4]], planes), WALL)
    planes = planes_of([WALL, FLOOR], [0, 0], 0.1, kept=[0.5, 0.9])
    assert_array_equal(given([[0, 0, 0]], planes), FLOOR)


def test_a_plane_reaches_as_far_as_its_neighborhood():
    planes = planes_of([FLOOR, WALL], [0, 0], 0.1, radius=[2.0, 10.0])
    assert_array_equal(given([[3, 0, 0]], planes), WALL)
    # What none reaches is given the nearest neighbor's.
    assert_array_equal(given([[30, 0, 40]], planes), FLOOR)


@pytest.mark.parametrize("height", [2.7, 3.3, -3.3])
def test_points_more_than_three_deviations_off_are_on_no_face(height):
    points = np.array([[x, y, 0.0] for x in range(6) for y in range(6)])
    points[14, 2] = 0.2 * height
    index = NeighborIndex(points, 9)
    creases, _ = find_creases(index, planes_of([FLOOR] * 36, [0] * 36, 0.2), 20.0)
    place = index.places[14]
    assert are_faces(creases.planes, creases.usual)[place]
    assert creases.faces.on_face[place] == (abs(height) < 3)


def test_the_usual_flatness_is_that_of_half_of_the_planes():
    points = np.array([[x, y, 0.0] for x in range(6) for y in range(6)])
    noise = np.random.default_rng(0).uniform(1, 5, 36)
    creases, _ = find_creases(
        NeighborIndex(points, 9), planes_of([FLOOR] * 36, [0] * 36, noise), 20
    )
    assert creases.usual == np.median(creases.planes.scale / creases.planes.radius)
    assert are_faces(creases.planes, creases.usual).mean() == 0.5


def test_faces_are_flat_or_the_flatter_half():
    flatness = np.array([0.05, 0.1, 0.19, 0.21, 0.4])
    planes = planes_of([FLOOR] * 5, [0] * 5, 10 * flatness)
    noisy = planes._replace(scale=30 * flatness)
    for some in (planes, noisy):
        usual = np.median(some.scale / some.radius)
        assert_array_equal(are_faces(some, usual), flatness < 0.2)
    assert not are_faces(planes._replace(scale=-flatness), -0.19).any()
