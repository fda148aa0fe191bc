"""Whose plane explains a point, against a loop taken literally."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from scenes import random_planes
from sklearn_mcmd.planes._explaining import explain
from sklearn_mcmd.planes._record import Neighborhoods

KINDS = ["plain", "ties", "sizes", "zero scales", "no planes", "unusable", "far away"]


def scene(kind, d, m=200, n=80, k=12, seed=0):
    """Queries, candidates, planes, usable and least."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(n, d))
    planes = random_planes(points, rng)
    usable = np.ones(n, dtype=bool)
    queries = rng.uniform(-0.1, 1.1, (m, d))
    indices = np.argsort(np.linalg.norm(queries[:, None] - points, axis=2), axis=1)[:, :k]
    sizes = np.full(m, k)
    least = rng.uniform(0, 0.02, m)
    if kind == "ties":  # of two copies of a plane the first candidate is the owner
        planes = planes.take(np.arange(n) // 2)
    elif kind == "sizes":
        sizes = rng.integers(1, k + 1, m)
        indices = np.where(np.arange(k) < sizes[:, None], indices, indices[:, :1])
    elif kind == "zero scales":
        planes.scale[::2], least[:] = 0.0, 0.0
        queries[::2] = planes.centroids[indices[::2, 0]]  # at distance 0 / 0
    elif kind == "no planes":
        planes.scale[::3] = -1.0
    elif kind == "unusable":
        usable = rng.random(n) < 0.25
    elif kind == "far away":
        queries += 10.0
    candidates = Neighborhoods(indices.astype(np.int32), sizes)
    return queries, candidates, planes, usable, least


def literally(queries, candidates, planes, usable, least, likely):
    """One query and one plane at a time."""
    owners, distances = [], []
    for query, row, size, add in zip(queries, *candidates, least, strict=True):
        best = np.inf, -1, np.inf
        for i in row[:size]:
            gap = query - planes.centroids[i]
            if not usable[i] or np.sqrt((gap**2).sum()) > planes.radius[i]:
                continue
            deviation = np.hypot(planes.scale[i], add)
            if deviation == 0 or (likely and planes.scale[i] <= 0):
                continue  # no distance is a number of its deviations
            distance = cost = abs(gap @ planes.normals[i]) / deviation
            if likely:  # minus the logarithm of a normal density, and of the share kept
                cost = np.log(deviation) + distance**2 / 2 - np.log(planes.kept[i])
            if cost < best[0]:
                best = cost, i, distance
        owners.append(best[1])
        distances.append(best[2])
    return np.array(owners), np.array(distances)


@pytest.mark.parametrize("likely", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [2, 3])
def test_the_owner_is_the_one_that_a_literal_loop_finds(d, kind, likely):
    found = explain(*scene(kind, d), likely)
    owners, distances = literally(*scene(kind, d), likely)
    assert_array_equal(found[0], owners)
    assert_allclose(found[1], distances, rtol=1e-9, atol=1e-12)


def test_the_scenes_hold_what_they_are_made_for():
    """Queries without an owner, near to its plane, and far from it."""
    owners, distances = explain(*scene("unusable", 3), True)
    assert (owners == -1).sum() > 5
    assert_array_equal(np.isinf(distances), owners == -1)
    assert (distances <= 3).sum() > 50
    assert ((distances > 3) & (owners >= 0)).sum() > 5
    assert (explain(*scene("far away", 3))[0] == -1).all()


def test_no_queries_have_no_owners():
    _, candidates, planes, usable, _ = scene("plain", 3)
    none = candidates.take(slice(0, 0))
    owners, distances = explain(np.empty((0, 3)), none, planes, usable, np.empty(0))
    assert owners.shape == distances.shape == (0,)
