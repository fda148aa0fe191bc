"""Hull vertices bound all members, however these lie."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd.adjustment._effects import hull_vertices
from sklearn_mcmd.adjustment._least_squares import adjust_plane


def clouds(seed, q):
    rng = np.random.default_rng(seed)
    n = 5000 if q < 4 else 800
    yield rng.uniform(size=(n, q))
    yield rng.normal(size=(n, q))
    yield rng.integers(0, 12, size=(n, q)).astype(float)
    yield np.repeat(rng.normal(size=(40, q)), n // 40, axis=0)  # many duplicates
    ring = rng.normal(size=(n, q))
    yield ring / np.linalg.norm(ring, axis=1, keepdims=True)  # all points are vertices
    yield rng.uniform(size=(n, q)) + 1e6


@pytest.mark.parametrize("q", [1, 2, 3, 4, 6])
def test_no_member_reaches_farther_than_the_vertices(q):
    for A in clouds(0, q):
        rng = np.random.default_rng(1)
        X = np.column_stack([A, rng.normal(size=len(A))])
        plane = adjust_plane(X)
        members = np.flatnonzero(rng.uniform(size=len(A)) < 0.7)
        vertices = hull_vertices(plane, X, members)
        assert np.isin(vertices, members).all()
        G = plane.design(plane.whiten(X)[0])
        directions = G[rng.integers(0, len(A), 50)]
        reach = np.abs(G[members] @ directions.T).max(axis=0)
        assert_allclose(np.abs(G[vertices] @ directions.T).max(axis=0), reach, rtol=1e-12)
