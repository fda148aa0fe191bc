"""Creases: against the literal oracle, and each step against planes that meet in a known line."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from reference_edges import LiteralCreases
from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.edges._crease_distance import find_creases
from sklearn_mcmd.planes._columns import split_columns
from sklearn_mcmd.planes._neighborhoods import NeighborIndex


def fold(n, angle, noise, seed=0):
    x, y = np.random.default_rng(seed).uniform(-1, 1, (2, n))
    return np.column_stack([x, y, np.tan(np.radians(angle / 2)) * np.abs(x)]), noise


def corner(n, noise):
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 1, (n, 3))
    points[np.arange(n), rng.integers(0, 3, n)] = 0
    return points, noise


def half_pole(n, noise):
    turn, z = np.random.default_rng(2).uniform(0, [[np.pi], [2]], (2, n))
    return np.column_stack([0.3 * np.cos(turn), 0.3 * np.sin(turn), z]), noise


def rounded_fold(n, noise):
    """A right angle rounded by a radius of a quarter."""
    s, y = np.random.default_rng(3).uniform([[-1], [0]], [[1], [2]], (2, n))
    r, length = 0.25, 0.25 * np.pi / 4
    turn = np.clip(s / r, -np.pi / 4, np.pi / 4)
    rest = np.sign(s) * np.maximum(np.abs(s) - length, 0)
    x = r * np.sin(turn) + rest * np.cos(turn)
    return np.column_stack([x, y, r * np.cos(turn) - rest * np.sin(turn)]), noise


def bend(n, noise):
    t = np.random.default_rng(4).uniform(-1, 1, n)
    return np.column_stack([t, np.maximum(t, 0)]), noise


CLOUDS = {
    "fold": (fold(200, 60, 0.01), 20),
    "blunt fold": (fold(200, 35, 0.03), 24),
    "corner": (corner(300, 0.01), 24),
    "half pole": (half_pole(200, 0.02), 20),
    "rounded fold": (rounded_fold(300, 0.002), 24),
    "bend": (bend(80, 0.005), 12),
    "too few for a quadric": (fold(80, 60, 0.01), 7),
}


def fitted(points, noise, k):
    points = points + np.random.default_rng(9).normal(0, noise, points.shape)
    normals = RobustNormalEstimator(k, tangents=False, random_state=0)
    columns = split_columns(normals.fit_transform(points), points.shape[1])
    index = NeighborIndex(points, k)
    on_surface = on_surface_of(points)
    planes = columns.planes(index.rows)
    creases, distances = find_creases(index, planes, 20.0, on_surface[index.rows])
    return columns, creases, distances[index.places]


def on_surface_of(points):
    """Three of ten, so that some points have few neighbors on surfaces."""
    return (np.random.default_rng(8).random(len(points)) < 0.3).astype(float)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in ("half pole", "corner") else [])
        for name in CLOUDS
    ],
)
def test_distances_and_evidence_are_those_of_the_oracle(name):
    cloud, k = CLOUDS[name]
    columns, creases, distances = fitted(*cloud, k)
    points = columns.coordinates
    planes = columns.planes(np.arange(len(points)))
    oracle = LiteralCreases(points, planes, k, 20.0, on_surface_of(points))
    evidence = np.empty(len(points))
    evidence[creases.meeting.index.rows] = creases.evidence
    assert np.isfinite(evidence).mean() > 0.05
    assert_allclose(evidence, oracle.evidence, rtol=1e-5, atol=1e-5)
    assert_allclose(distances, oracle.scores, rtol=1e-5)
