"""Whose plane a point next to an edge may borrow, against a loop taken literally."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from scenes import random_planes
from sklearn_mcmd.normals._neighbor_planes import find_lenders
from sklearn_mcmd.planes._record import Neighborhoods, Planes


def scene(kind, d, m=200, n=120, k=18):
    """Points, queries, neighborhoods, planes and most."""
    rng = np.random.default_rng(0)
    points = rng.uniform(size=(n, d))
    planes = random_planes(points, rng)
    queries, sizes = rng.uniform(-0.1, 1.1, (m, d)), np.full(m, k)
    queries[::2] = points[rng.integers(0, n, len(queries[::2]))]  # of the points themselves
    indices = np.argsort(np.linalg.norm(queries[:, None] - points, axis=2), axis=1)[:, :k]
    most = np.full(m, np.inf)
    if kind == "ties":  # of two copies of a plane the first neighbor lends
        planes = planes.take(np.arange(n) // 2)
    elif kind == "sizes":
        sizes = rng.integers(1, k + 1, m)
        indices = np.where(np.arange(k) < sizes[:, None], indices, indices[:, :1])
    elif kind == "zero scales":
        planes.scale[::2] = 0.0
    elif kind == "no planes":
        planes.scale[::3] = -1.0
    elif kind == "noisy ones last":
        most = rng.uniform(0, 0.1, m)
    elif kind == "far away":
        queries += 10.0
    return points, queries, Neighborhoods(indices.astype(np.int32), sizes), planes, most


KINDS = ["plain", "ties", "sizes", "zero scales", "no planes", "noisy ones last", "far away"]


def literally(points, queries, around, planes, most):
    """One query and one plane at a time."""
    lenders = []
    for query, row, size, limit in zip(queries, *around, most, strict=True):
        others = [i for i in row[:size] if (points[i] != query).any()]
        others = others[: max(1, size // 3)]
        total = sum(range(1, len(others) + 1))
        best = (True, np.inf), -1
        for i in row[:size]:
            if np.linalg.norm(query - planes.centroids[i]) > planes.radius[i]:
                continue
            if planes.scale[i] <= 0:
                continue
            deviation = planes.scale[i]

            def distance(point, i=i, deviation=deviation):
                return abs((point - planes.centroids[i]) @ planes.normals[i]) / deviation

            prior = np.log(deviation) - np.log(planes.kept[i])
            cost = prior + distance(query) ** 2 / 2  # minus the logarithm of a normal density
            for place, other in enumerate(others):
                weight = (len(others) - place) / total
                cost += weight * (prior + min(distance(points[other]), 3.0) ** 2 / 2)
            if not others:
                cost += prior
            last = not (deviation <= limit and distance(query) <= 3.0)
            if best[1] < 0 or (last, cost) < best[0]:
                best = (last, cost), i
        lenders.append(best[1])
    return np.array(lenders)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [2, 3, 5])
def test_the_lender_is_the_one_that_a_literal_loop_finds(d, kind):
    cloud = scene(kind, d)
    assert_array_equal(find_lenders(*cloud), literally(*cloud))


def test_the_scenes_hold_what_they_are_made_for():
    assert (find_lenders(*scene("far away", 3)) == -1).all()
    first = find_lenders(*scene("noisy ones last", 3))
    assert (first != find_lenders(*scene("plain", 3))).any()


def test_a_plane_must_explain_the_patch_and_not_the_point_alone():
    """A point on a floor near a wall, whose plane cuts the floor right below the point."""
    rng = np.random.default_rng(0)
    floor = rng.uniform(-1, 1, (40, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (40, 3)) * [0, 0, 1]
    floor = floor[np.argsort(np.linalg.norm(floor, axis=1))]
    query = np.array([[0.0, 0.0, 0.012]])
    planes = Planes.empty(40, 3)
    planes.centroids[:], planes.normals[:] = floor * [1, 1, 0], [0.0, 0.0, 1.0]
    planes.scale[:], planes.kept[:], planes.radius[:] = 0.01, 0.8, 2.0
    wall = 30  # explains the point to the last digit, and keeps all of its own neighborhood
    planes.centroids[wall], planes.normals[wall] = [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]
    planes.kept[wall] = 1.0
    around = Neighborhoods(np.arange(40, dtype=np.int32)[None], np.array([40]))
    assert find_lenders(floor, query, around, planes, np.array([0.05]))[0] != wall
    alone = np.abs((query - planes.centroids) * planes.normals).sum(axis=1) / planes.scale
    cost = alone**2 / 2 - np.log(planes.kept)
    assert cost.argmin() == wall
