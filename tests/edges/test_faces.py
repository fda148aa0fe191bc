"""Which points are on a face, and which faces are flat: of planes that are known."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.edges._crease_distance import are_faces, find_creases
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._record import Planes


def planes_of(normals, levels, scale, radius=10.0):
    """Planes through the points of their normals that are as far from the origin as told."""
    normals = np.asarray(normals, dtype=float)
    n, d = normals.shape
    planes = Planes.empty(n, d)
    planes.scale[:], planes.radius[:] = scale, radius
    planes.normals[:] = normals
    planes.centroids[:] = normals * np.asarray(levels)[:, None]
    return planes


FLOOR = [0, 0, 1]


@pytest.mark.parametrize("height", [2.7, 3.3, -3.3])
def test_points_more_than_three_deviations_off_are_on_no_face(height):
    points = np.array([[x, y, 0.0] for x in range(6) for y in range(6)])
    points[14, 2] = 0.2 * height
    index = NeighborIndex(points, 9)
    creases, _ = find_creases(index, planes_of([FLOOR] * 36, [0] * 36, 0.2), 20.0, np.ones(36))
    place = index.places[14]
    assert are_faces(creases.meeting.planes, creases.meeting.usual)[place]
    assert creases.faces.on_face[place] == (abs(height) < 3)


def test_the_usual_flatness_is_that_of_half_of_the_planes():
    points = np.array([[x, y, 0.0] for x in range(6) for y in range(6)])
    noise = np.random.default_rng(0).uniform(1, 5, 36)
    planes = planes_of([FLOOR] * 36, [0] * 36, noise)
    meeting = find_creases(NeighborIndex(points, 9), planes, 20, np.ones(36))[0].meeting
    assert meeting.usual == np.median(meeting.planes.scale / meeting.planes.radius)
    assert are_faces(meeting.planes, meeting.usual).mean() == 0.5


def test_faces_are_flat_or_the_flatter_half():
    flatness = np.array([0.05, 0.1, 0.19, 0.21, 0.4])
    planes = planes_of([FLOOR] * 5, [0] * 5, 10 * flatness)
    noisy = planes._replace(scale=30 * flatness)
    for some in (planes, noisy):
        usual = np.median(some.scale / some.radius)
        assert_array_equal(are_faces(some, usual), flatness < 0.2)
    assert not are_faces(planes._replace(scale=-flatness), -0.19).any()
