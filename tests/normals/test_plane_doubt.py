"""Errors of normals with the doubt which plane is right, against a loop taken literally."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from normals.test_neighbor_planes import scene
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.normals._neighbor_planes import doubted_errors
from sklearn_mcmd.planes._record import Planes


def given(kind, d):
    """Points, queries, neighborhoods, their planes, the members' planes, and which bend."""
    points, queries, around, members, _ = scene(kind, d)
    rng = np.random.default_rng(1)
    members = members._replace(normal_error=rng.uniform(0.1, 8, len(points)))
    own = Planes.empty(*queries.shape)
    own.normals[:] = members.normals[around.indices[:, 0]] + 0.1 * rng.normal(size=queries.shape)
    own.normals[:] /= np.linalg.norm(own.normals, axis=1)[:, None]
    own.normal_error[:] = rng.uniform(0.1, 8, len(queries))
    return points, queries, around, own, members, rng.random(len(queries)) < 0.5


def literally(points, queries, around, own, members, bends):
    """One query at a time; the trend by `numpy.linalg.lstsq`."""
    errors = []
    for i, (query, row, size) in enumerate(zip(queries, *around, strict=True)):
        others = [j for j in row[:size] if (points[j] != query).any()][: max(1, size // 3)]
        patch = row[: min(len(others) + 1, size)]
        faces, normal = [], own.normals[i]
        for j in patch:
            away = query - members.centroids[j]
            if not (members.scale[j] > 0 and np.linalg.norm(away) <= members.radius[j]):
                continue
            away = [(p - members.centroids[j]) @ members.normals[j] for p in points[others]]
            distance = ((query - members.centroids[j]) @ members.normals[j] / members.scale[j]) ** 2
            weights = np.arange(len(others), 0, -1)
            off = np.minimum(np.square(away) / members.scale[j] ** 2, 9)
            mean = np.average(off, weights=weights) if len(others) else 0
            likely = 2 * np.log(members.kept[j] / members.scale[j]) - (distance + mean) / 2
            lean = members.normals[j] * (1 if members.normals[j] @ normal >= 0 else -1)
            flat = np.eye(len(normal)) - np.outer(normal, normal)
            faces.append((likely, flat @ (points[j] - query), flat @ lean, j))
        added = 0.0
        if faces:
            likely, place, lean, j = map(np.array, zip(*faces, strict=True))
            likely = np.exp(likely - likely.max())
            if bends[i] and np.linalg.matrix_rank(place, tol=1e-9) == len(normal) - 1:
                lean = lean - place @ np.linalg.lstsq(place, lean, rcond=1e-9)[0]
            angle = np.degrees(np.arcsin(np.minimum(np.linalg.norm(lean, axis=1), 1)))
            chance = 2 * (own.normal_error[i] ** 2 + members.normal_error[j] ** 2)
            added = np.average(np.maximum(angle**2 - chance, 0), weights=likely)
        errors.append(min(90.0, np.sqrt(own.normal_error[i] ** 2 + added)))
    return np.array(errors)


@pytest.mark.parametrize("kind", ["plain", "ties", "sizes", "zero scales", "no planes", "far away"])
@pytest.mark.parametrize("d", [2, 3])
def test_the_errors_are_those_of_a_literal_loop(d, kind):
    found = doubted_errors(*given(kind, d))
    assert_allclose(found, literally(*given(kind, d)), rtol=1e-7)


def test_where_no_plane_reaches_errors_stay():
    _, _, _, own, *_ = cloud = given("far away", 3)
    assert_array_equal(doubted_errors(*cloud), own.normal_error)


def two_walls(rng, n=4_000):
    """A corner of 90 degrees, with noise of a fifth of the spacing, and the true normals."""
    along, across = rng.random((2, n)) * [[8], [1]]
    first = np.arange(n) < n // 2
    noise = 0.2 * np.sqrt(16 / n) * rng.normal(size=n)
    X = np.where(first, [across, along, noise], [noise, along, across]).T
    return X, np.where(first[:, None], [0, 0, 1.0], [1.0, 0, 0]), across


def test_doubt_is_next_to_edges_and_not_on_planes():
    """Away from the edge no plane is in doubt: the median error is that of the noise, which covers
    95 % within 2 points; next to it errors are larger."""
    X, truth, away = two_walls(np.random.default_rng(0))
    found = RobustNormalEstimator(random_state=0).fit(X)
    inner = (away > 0.4) & (away < 0.9) & (X[:, 1] > 0.5) & (X[:, 1] < 7.5)
    covered = bias_angle(found.normals_, truth) <= 1.73 * found.normal_error_
    assert 0.92 < covered[inner].mean() < 0.99
    edge = away < 0.1
    assert np.mean(found.normal_error_[edge]) > 2 * np.mean(found.normal_error_[inner])
    assert covered[edge].mean() > 0.85


def test_a_cylinder_without_noise_has_no_doubt():
    """Its normals turn by 30 degrees within a neighborhood, as the quadric says."""
    rng = np.random.default_rng(0)
    turn, along = rng.uniform(0, 2 * np.pi, 6_000), rng.uniform(0, 6, 6_000)
    X = np.column_stack([np.cos(turn), np.sin(turn), along])
    X[:, :2] *= 1 + 0.002 * rng.normal(size=(6_000, 1))
    found = RobustNormalEstimator(random_state=0).fit(X)
    assert np.median(found.normal_error_) < 1.0
