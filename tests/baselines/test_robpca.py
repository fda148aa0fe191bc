"""ROBPCA and its parts: the MCD against scikit-learn and brute force, planted outliers,
breakdown."""

from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from sklearn_mcmd.baselines import Robpca
from sklearn_mcmd.baselines._mcd import fit_mcd, mcd_support_size, univariate_mcd
from sklearn_mcmd.baselines._robpca import stahel_donoho


def plane_with_outliers(n_sets=30, n=60, n_outliers=15, d=3, seed=0):
    """Planes z = 0 with a cluster of outliers in the first rows."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n_sets, n, d))
    points[..., -1] *= 0.05
    points[:, :n_outliers, -1] += 3
    return points


def starts(n, d, n_trials=200, seed=0):
    rng = np.random.default_rng(seed)
    return np.array([rng.permutation(n)[: d + 1] for _ in range(n_trials)])


def log_volumes(points, support):
    chosen = (part[rows] for part, rows in zip(points, support, strict=True))
    return [np.linalg.slogdet(np.cov(part.T, bias=True))[1] for part in chosen]


def test_the_subset_is_the_best_of_all_where_all_can_be_tried():
    points = np.random.default_rng(0).normal(size=(5, 11, 2)) ** 3
    mcd = fit_mcd(points, starts(11, 2), 0.5, np.full(5, 1e-12))
    h = mcd_support_size(0.5, 11, 2)
    assert h == 7
    for p, best in zip(points, log_volumes(points, mcd.support), strict=True):
        volumes = [
            np.linalg.slogdet(np.cov(p[list(rows)].T, bias=True))[1]
            for rows in combinations(range(11), h)
        ]
        assert_allclose(best, min(volumes), rtol=1e-9)


def test_many_members_go_through_scikit_learns_nested_subsets():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1, 3000, 3)) * [1, 2, 0.1] + [5, 5, 5]
    points[:, :900] += [0, 0, 4]
    fit = Robpca(consistency="quantile").fit(points, random_state=0)
    assert not fit.inliers[0, :900].any()
    assert 0.95 < fit.inliers[0, 900:].mean() < 0.99
    assert abs(fit.scale[0] / 0.1 - 1) < 0.1
    assert_allclose(fit.cutoff, np.sqrt(stats.chi2.ppf(0.975, 3)))


def test_the_univariate_mcd_is_the_run_of_least_variance():
    values = np.random.default_rng(0).standard_t(2, size=(6, 25))
    location, scale = univariate_mcd(values, 15)
    # The variance of a normal variable within the central 15 of 25, as a share of all.
    within = stats.truncnorm(-(limit := stats.norm.ppf(0.8)), limit).var()
    for row, mean, deviation in zip(values, location, scale, strict=True):
        runs = [np.sort(row)[i : i + 15] for i in range(11)]
        best = min(runs, key=np.var)
        assert_allclose(mean, best.mean(), rtol=1e-10, atol=1e-12)
        assert_allclose(deviation**2, best.var() / within, rtol=1e-9)


@pytest.mark.parametrize("n", [60, 120])
def test_covariances_of_clean_samples_are_right_on_average(n):
    """With both factors; of 30 points the formula leaves a quarter too much."""
    points = np.random.default_rng(0).normal(size=(600, n, 3)) * [3, 2, 1]
    mcd = fit_mcd(points, starts(n, 3, 60), 0.5, np.full(600, 1e-12))
    variances = mcd.covariances.diagonal(axis1=1, axis2=2).mean(axis=0)
    assert_allclose(variances, [9, 4, 1], rtol=0.15)


@pytest.mark.parametrize("projection", [False, True])
def test_it_withstands_less_than_half_and_no_more(projection):
    """60 members: the subset of 32 (31 by projection pursuit) has no room for 29 outliers."""
    method = Robpca(projection=projection, n_components=2)
    for n_outliers, withstood in ((25, True), (35, False)):
        fit = method.fit(plane_with_outliers(20, n_outliers=n_outliers), random_state=0)
        regular = fit.inliers[:, n_outliers:].mean() > fit.inliers[:, :n_outliers].mean()
        assert regular == withstood


def test_few_members_for_their_dimensions_begin_with_projection_pursuit():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(10, 24, 6)) * [1, 1, 1, 1, 1, 0.05]
    points[:, :6, -1] += 10
    fit = Robpca().fit(points, random_state=0)
    assert not fit.inliers[:, :6].any()
    tilt = np.degrees(np.arccos(np.abs(fit.normals[:, -1])))
    assert np.median(tilt) < 5


def test_outlyingness_is_the_largest_over_directions():
    points = np.random.default_rng(0).normal(size=(2, 20, 3))
    pairs = starts(20, 1, 30)
    outlyingness = stahel_donoho(points, pairs, 12, np.full(2, 1e-12))
    for b in range(2):
        worst = np.zeros(20)
        for i, j in pairs:
            direction = points[b, j] - points[b, i]
            projections = points[b] @ direction / np.linalg.norm(direction)
            location, scale = univariate_mcd(projections, 12)
            worst = np.maximum(worst, np.abs(projections - location) / scale)
        assert_allclose(outlyingness[b], worst, rtol=1e-8)


def test_both_cutoffs_keep_their_shares_of_regular_members():
    """97.5 % of the score distances and, by Wilson and Hilferty, of the orthogonal ones."""
    points = np.random.default_rng(0).normal(size=(200, 200, 3)) * [3, 2, 0.1]
    method = Robpca(n_components=2, n_trials=30, orthogonal_scale="mad")
    # Both are about 95.7 %, and a little less as few of 30 trials find the best subset.
    assert 0.93 < method.fit(points, random_state=0).inliers.mean() < 0.97


def test_perfect_planes_are_no_trouble():
    points = plane_with_outliers(4)
    points[:, 15:, 2] = 0
    for projection in (False, True):
        fit = Robpca(projection=projection).fit(points, random_state=0)
        assert np.isfinite(fit.scores).all()
        assert not fit.inliers[:, :15].any()
        assert_allclose(np.abs(fit.normals[:, 2]), 1, atol=1e-6)


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"n_components": 4}, "more than 3 features"),
        ({"support_fraction": 0.4}, "'support_fraction' parameter of Robpca"),
        ({"orthogonal_scale": "sd"}, "'orthogonal_scale' parameter"),
        ({"consistency": "none"}, "'consistency' parameter"),
        ({"n_trials": 0}, "'n_trials' parameter"),
    ],
)
def test_wrong_parameters_are_named(params, message):
    with pytest.raises(ValueError, match=message):
        Robpca(**params).fit(plane_with_outliers(1))
