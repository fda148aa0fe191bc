"""Surfaces: which planes form one, and how far points are from it."""

import numpy as np
import pytest

from reference import GivenNeighbors
from sklearn_mcmd.outliers._surfaces import are_usable, find_surfaces
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._record import Planes

K, SCALE = 20, 0.01


def planes_at(points, normals, radius, scale=SCALE, kept=1.0):
    """The true plane at each point."""
    planes = Planes.empty(*points.shape)
    for values in planes:
        values[:] = 0
    planes.centroids[:], planes.normals[:] = points, normals
    planes.radius[:], planes.scale[:], planes.kept[:] = radius, scale, kept
    return planes


def face(n, rng, side=1.0):
    """A level square with its neighborhoods and planes."""
    index = NeighborIndex(rng.uniform(0, side, (n, 3)) * [1, 1, 0], K)
    neighbors = index.query(index.points)
    last = index.points[neighbors.indices[:, -1]]
    radius = np.linalg.norm(last - index.points, axis=1)
    return index.points, neighbors, planes_at(index.points, [0, 0, 1], radius)


def surfaces(points, neighbors, planes, least=K):
    usable = are_usable(planes, np.zeros(500))  # distances from their own planes
    index = GivenNeighbors(points, neighbors)
    return find_surfaces(index, planes, usable, least)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize(("scale", "good"), [(0.14, True), (0.16, False), (0.0, False)])
def test_rough_planes_and_those_without_noise_are_of_no_surface(rng, scale, good):
    points, neighbors, planes = face(500, rng)
    changed = planes._replace(scale=np.full(500, scale), radius=np.ones(500))
    assert (surfaces(points, neighbors, changed) == good).all()


@pytest.mark.parametrize(("angle", "linked"), [(24, True), (26, False)])
def test_normals_of_a_surface_turn_by_at_most_25_degrees_a_link(rng, angle, linked):
    """Two halves that lie in one plane and say otherwise: 250 points each."""
    points, neighbors, planes = face(500, rng)
    left = points[:, 0] < np.median(points[:, 0])
    t = np.radians(angle)
    planes.normals[left] = [np.sin(t), 0, np.cos(t)]
    planes.scale[:] = 0.1  # as for all that the heights say
    planes.radius[:] = 1.0
    assert surfaces(points, neighbors, planes, least=300).all() == linked
    assert surfaces(points, neighbors, planes, least=200).all()


def test_levels_that_do_not_explain_each_other_are_two_surfaces(rng):
    points, neighbors, planes = face(500, rng)
    planes.radius[:] = 1.0
    high = points[:, 0] < np.median(points[:, 0])
    for step, linked in ((2.9 * SCALE, True), (3.1 * SCALE, False)):
        lifted = points + np.outer(high, [0, 0, step])
        planes.centroids[:] = lifted
        assert surfaces(lifted, neighbors, planes, least=300).all() == linked
