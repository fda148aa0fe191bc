"""RANSAC and MSAC against a literal loop, and both of their forms against each other."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.baselines import Msac, Ransac, fit_neighborhoods
from sklearn_mcmd.baselines._ransac import (
    best_planes,
    least_median_scales,
    trials_to_stop,
)
from sklearn_mcmd.datasets import make_contaminated_plane


def noisy_planes(n_sets, n=50, d=3, seed=0, n_outliers=10):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n_sets, n, d))
    points[..., -1] *= 0.02
    points[:, :n_outliers, -1] += rng.uniform(0.5, 2, (n_sets, n_outliers))
    return points


def literal_search(points, table, threshold, probability, truncated_loss):
    """Trials one after another until the consensus says that there were enough."""
    n, d = points.shape
    best, winner, needed = np.inf, None, np.inf
    for t, row in enumerate(table):
        if t >= needed:
            break
        subset = points[row]
        normal = np.linalg.svd(subset[1:] - subset[0])[2][-1]
        squares = ((points - subset[0]) @ normal / threshold) ** 2
        count = int(np.sum(squares < 1))
        loss = np.minimum(squares, 1).sum() if truncated_loss else n - count
        if loss < best:
            best, winner = loss, (subset[0], normal)
            clean = np.prod([(count - i) / (n - i) for i in range(d)])
            needed = np.inf if clean <= 0 else 1
            if 0 < clean < 1:
                needed = max(1, np.ceil(np.log(1 - probability) / np.log(1 - clean)))
    return winner


@pytest.mark.parametrize("truncated_loss", [False, True])
@pytest.mark.parametrize("d", [2, 3, 4])
def test_the_search_is_that_of_one_trial_after_another(d, truncated_loss):
    points = noisy_planes(30, d=d)
    rng = np.random.default_rng(1)
    table = np.array([rng.permutation(50)[:d] for _ in range(200)])
    stops = trials_to_stop(50, d, 0.99)
    centers, normals = best_planes(points, table, np.full(30, 0.05), stops, truncated_loss)
    for i in range(30):
        center, normal = literal_search(points[i], table, 0.05, 0.99, truncated_loss)
        assert_allclose(centers[i], center)
        assert_allclose(abs(normals[i] @ normal), 1, rtol=1e-12)


def test_the_scale_is_the_least_median_of_all_trials():
    points = noisy_planes(5)
    rng = np.random.default_rng(1)
    table = np.array([rng.permutation(50)[:3] for _ in range(60)])
    for i, scale in enumerate(least_median_scales(points, table)):
        medians = []
        for row in table:
            normal = np.linalg.svd(points[i, row[1:]] - points[i, row[0]])[2][-1]
            medians.append(np.median(np.abs((points[i] - points[i, row[0]]) @ normal)))
        assert_allclose(scale, 1.4826 * (1 + 5 / 47) * min(medians))


@pytest.mark.parametrize("kind", [Ransac, Msac])
@pytest.mark.parametrize("noise_scale", [None, 0.02])
def test_compiled_and_numpy_forms_agree(kind, noise_scale):
    points = noisy_planes(300, seed=2)
    method = kind(noise_scale=noise_scale)
    tables, sizes = method.tables(0), np.repeat([50, 30], 150)
    ours, theirs = (
        method.fit_sizes(points, sizes, tables, compiled=compiled) for compiled in (True, False)
    )
    assert_allclose(ours.scale, theirs.scale, rtol=1e-10)
    assert_allclose(ours.scores, theirs.scores, rtol=1e-6, atol=1e-8)
    assert_array_equal(ours.inliers, theirs.inliers)


def test_forms_agree_on_neighborhoods_without_a_plane():
    line = np.linspace(0, 1, 20)[:, None] * [1.0, 2.0, 3.0]
    points = np.stack([line, np.zeros((20, 3))])
    for compiled in (True, False):
        method = Ransac()
        found = method.fit_sizes(points, np.array([20, 20]), method.tables(0), compiled=compiled)
        assert (found.scale < 0).all()
        assert found.inliers.all()


def test_msac_prefers_the_nearer_of_two_planes_with_equal_consensus():
    X = np.stack([make_contaminated_plane(50, random_state=run)[0] for run in range(300)])
    losses = {}
    for method in ("ransac", "msac"):
        found = fit_neighborhoods(method, X, random_state=0, noise_scale=0.3, n_refits=0)
        mean_square = np.where(found.inliers, found.scores**2, 0).sum(axis=1)
        losses[method] = (mean_square / found.inliers.sum(axis=1)).mean()
    assert losses["msac"] < losses["ransac"]


def test_the_estimated_scale_is_that_of_the_noise():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(400, 50, 3)) * [1, 1, 0.02]
    found = fit_neighborhoods("ransac", points, random_state=0)
    # The least of many medians errs to small scales, Rousseeuw and Leroy's factor to large ones.
    assert 0.8 < np.median(found.scale) / 0.02 < 1.1
    points[:, :15, 2] += 1
    found = fit_neighborhoods("ransac", points, random_state=0)
    # The median is then the 0.71 quantile of the regular distances, 1.58 times the median.
    assert 1.3 < np.median(found.scale) / 0.02 < 2.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("noise_scale", 0.0),
        ("noise_scale", "pooled"),
        ("quantile", 1.0),
        ("degrees_of_freedom", 1.5),
        ("max_trials", 0),
        ("stop_probability", 1),
        ("n_refits", -1),
    ],
)
def test_wrong_parameters_are_named(name, value):
    with pytest.raises(ValueError, match=f"'{name}' parameter of Ransac must be"):
        Ransac(**{name: value})
