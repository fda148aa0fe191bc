"""Regions are those of the paper's rules taken literally: growth against loops over points."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.metrics import adjusted_rand_score

from growth import changed, fitted_without
from sklearn_mcmd.segmentation._estimator import GrowthSteps
from sklearn_mcmd.segmentation._graph import GrowthLimits


def columns_of(X, normals, rng):
    """What the transformer would give, with exact normals and a curvature without ties."""
    d = X.shape[1]
    eigenvalues = np.tile(np.r_[1e-6, np.full(d - 1, 1e-2)], (len(X), 1))
    eigenvalues[:, 0] *= rng.uniform(0.5, 2.0, len(X))
    variation = eigenvalues[:, 0] / eigenvalues.sum(axis=1)
    offset, scale = rng.normal(0, 5e-4, len(X)), rng.uniform(1.0, 1.5, len(X))
    scale *= np.sqrt(eigenvalues[:, 0])
    return np.column_stack([X, normals, variation, eigenvalues, offset, scale])


def corner(n, d, rng, noise=0.002):
    """Two faces at right angles in d dimensions, with their normals turned by some degrees."""
    X = rng.uniform(0, 1, (n, d))
    normals = np.zeros((n, d))
    face = rng.integers(2, size=n)
    X[np.arange(n), face] = 0.0
    normals[np.arange(n), face] = 1.0
    X += rng.normal(0, noise, X.shape)
    normals += rng.normal(0, 0.1, X.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return X, normals * rng.choice([-1, 1], n)[:, None], face


def grown_by_loops(columns, d, k, max_angle, max_distance, max_gap, mutual):
    """Section 5.2.3 point by point, with the departures that the docstring names."""
    X, normals, variation = columns[:, :d], columns[:, d : 2 * d], columns[:, 2 * d]
    offsets, noise = columns[:, 3 * d + 1 :].T
    n = len(X)
    hoods, limits, grows = [], np.empty(n), np.ones(n, dtype=bool)
    for i in range(n):
        distances = np.sqrt(((X - X[i]) ** 2).sum(axis=1))
        near = np.argsort(distances, kind="stable")[:k]
        gap = max_gap
        if gap is None:  # the median of the k - 1 others, the lower one of two
            gap = np.sort(distances[near[1:]])[(k - 2) // 2]
            near = near[distances[near] <= gap]
        hoods.append((near, distances[near] <= gap))
        heights = (X[near] - X[i]) @ normals[i]
        if max_distance is not None:
            limits[i] = max_distance
        else:
            away = abs(heights - offsets[i])
            limits[i] = np.median(away) + 2 * 1.4826 * np.median(abs(away - np.median(away)))
        if mutual:
            usual = np.sort(noise[near])[len(near) // 4]
            bent = np.radians(max_angle) * distances[near].max() / 8
            grows[i] = noise[i] <= (1 + 3 / np.sqrt(2 * k)) * np.hypot(usual, bent)
    links = []
    for i, (near, reached) in enumerate(hoods):
        away = abs((X[near] - X[i]) @ normals[i] - offsets[i])
        turn = np.degrees(np.arccos(np.minimum(abs(normals[near] @ normals[i]), 1)))
        fits = (away <= limits[i]) & (turn <= max_angle) & reached & grows[i]
        if mutual:
            back = np.einsum("nd,nd->n", X[i] - X[near], normals[near]) - offsets[near]
            fits &= abs(back) <= limits[near]
        links.append(set(near[1:][fits[1:]]))
    labels, region = np.full(n, -1), 0
    for seed in np.argsort(variation, kind="stable"):
        if labels[seed] >= 0:
            continue
        seeds, labels[seed] = [seed], region
        while seeds:
            for j in links[seeds.pop(0)]:
                if labels[j] < 0:
                    labels[j] = region
                    seeds.append(j)
        region += 1
    return labels


@pytest.mark.parametrize(("n", "d"), [(300, 2), (400, 3), (500, 4), (1500, 3)])
@pytest.mark.parametrize(
    ("k", "max_angle", "max_distance", "max_gap", "mutual"),
    [(30, 15, None, None, True), (17, 20, None, None, False), (20, 10, 0.004, 0.12, True)],
)
def test_regions_are_those_of_the_rules_taken_literally(
    n, d, k, max_angle, max_distance, max_gap, mutual
):
    rng = np.random.default_rng(n + d)
    X, normals, _ = corner(n, d, rng)
    columns = columns_of(X, normals, rng)
    limits = {"max_angle": max_angle, "max_distance": max_distance, "max_gap": max_gap}
    steps = GrowthSteps._fields[1 if mutual else 0 :]
    growing = fitted_without(
        columns, *steps, n_neighbors=k, min_region_size=1, normals="precomputed", **limits
    )
    if not mutual:  # the parameter leaves out all
        assert_array_equal(growing.labels_, growing.set_params(refine=False).fit(columns).labels_)
    expected = grown_by_loops(columns, d, k, max_angle, max_distance, max_gap, mutual)
    assert growing.n_regions_ == expected.max() + 1 > 1
    assert adjusted_rand_score(expected, growing.labels_) == 1.0


def test_growth_notices_an_edited_limit():
    """Constants that a kernel imports are frozen when it is compiled, and in Numba's cache."""
    X, normals, _ = corner(1500, 3, np.random.default_rng(0))
    columns, found = columns_of(X, normals, np.random.default_rng(0)), []
    for n_deviations in (2.0, -0.5):
        with changed(GrowthLimits, n_deviations=n_deviations):
            growing = fitted_without(columns, *GrowthSteps._fields, normals="precomputed")
        found.append(np.count_nonzero(growing.labels_ < 0))
    assert found[1] > 10 * found[0]
