"""Adaptive trials: a prefix of the table, as robust as all of it; in 3D all of it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.datasets import make_contaminated_plane
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.planes._adaptive_trials import StopRule, adaptive_consistent_sets
from sklearn_mcmd.planes._consistent_set import (
    draw_trials,
    maximum_consistent_sets,
    n_support_points,
    n_trials_needed,
)
from sklearn_mcmd.planes._plane import fit_planes


def rule_of(k, n_trials=69, d=3, support_fraction=0.5):
    return StopRule.of(n_trials, n_support_points(support_fraction, np.arange(k + 1), d), 0.9999, d)


def planes(n, k, outlier_share, kind="clustered", noise=0.04, seed=0, d=3):
    """Planes with outliers like those of Section 5.1, in units of their deviation; the last axis
    is their normal."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, k, d))
    points[..., -1] *= noise
    m = round(outlier_share * k)
    if kind == "clustered":
        center, spread = [2.04, *[1.63] * (d - 2), 2.45], [*[0.58] * (d - 1), 0.5]
        points[:, k - m :] = center + rng.normal(size=(n, m, d)) * spread
    elif kind == "uniform":
        points[:, k - m :] = rng.uniform(-3.7, 3.7, (n, m, d))
    elif kind == "step":  # a curb of 6 to 20 deviations of the noise along x = 0
        points[..., 0] = abs(points[..., 0])
        points[:, k - m :, 0] *= -1
        points[:, k - m :, -1] += rng.uniform(6, 20, (n, 1)) * noise
    # Each in its own order: the table of trials is one for all.
    order = rng.random((n, k)).argsort(axis=1)
    return np.take_along_axis(points, order[..., None], axis=1)


def tilts(points, support):
    _, _, axes = fit_planes(points, support)
    return bias_angle(axes[..., 0], np.eye(points.shape[2])[-1])


@pytest.mark.parametrize("support_fraction", [0.5, 0.75])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.3])
def test_the_set_is_that_of_a_prefix_of_the_table(share, support_fraction):
    points, trials = planes(200, 50, share), draw_trials(69, 50, random_state=1)
    h = n_support_points(support_fraction, np.full(200, 50), 3)
    rule = rule_of(50, support_fraction=support_fraction)
    support, least, _, n_used = adaptive_consistent_sets(points, trials, h, rule)
    assert set(n_used) <= {32, 69}
    for used in np.unique(n_used):
        rows = n_used == used
        expected = maximum_consistent_sets(points[rows], trials[:used], h[rows])
        assert_array_equal(support[rows], expected[0])
        assert_allclose(least[rows], expected[1], rtol=1e-12)


def test_four_dimensions_stop_early_on_flat_neighborhoods_too():
    d = 4
    points = np.random.default_rng(0).normal(size=(60, 50, d))
    points[..., -1] *= 0.02
    n_trials = n_trials_needed(0.5, 0.9999, d)
    trials = draw_trials(n_trials, 50, random_state=0)
    _, _, _, n_used = adaptive_consistent_sets(points, trials, 25, rule_of(50, n_trials, d))
    assert n_used.max() <= n_trials
    assert (n_used < n_trials).mean() > 0.5


@pytest.mark.parametrize(("share", "most"), [(0.0, 38), (0.1, 38), (0.2, 40)])
def test_clean_neighborhoods_need_few_trials(share, most):
    points = planes(500, 50, share, "uniform")
    trials = draw_trials(69, 50, random_state=0)
    _, _, _, n_used = adaptive_consistent_sets(points, trials, 25, rule_of(50))
    assert n_used.mean() < most


@pytest.mark.parametrize("kind", ["clustered", "uniform"])
@pytest.mark.parametrize(("share", "d", "n"), [(0.3, 3, 1000), (0.46, 3, 1000), (0.48, 3, 1000),
                                               (0.3, 4, 400), (0.46, 4, 400)])  # fmt: skip
def test_breakdown_is_that_of_all_trials(kind, share, d, n):
    """None that all trials keep within 5 degrees is lost.

    Stopping after 32 trials whatever they show loses 0.5 % in 3D at 48 % of clustered outliers.
    """
    points, n_trials = planes(n, 50, share, kind, d=d), n_trials_needed(0.5, 0.9999, d)
    trials, rule = draw_trials(n_trials, 50, random_state=0), rule_of(50, n_trials, d)
    support, _, _, n_used = adaptive_consistent_sets(points, trials, 25, rule)
    expected, _, _ = maximum_consistent_sets(points, trials, 25)
    lost = (tilts(points, support) > 5) & (tilts(points, expected) <= 5)
    assert lost.sum() == 0
    if share >= 0.46:
        assert (n_used == n_trials).mean() > 0.99


def test_the_first_32_trials_alone_would_break_down():
    """What the test before would see if the rule let everything pass."""
    points, trials = planes(2000, 50, 0.48), draw_trials(32, 50, random_state=0)
    support, _, _ = maximum_consistent_sets(points, trials, 25)
    assert (tilts(points, support) > 5).sum() >= 5


@pytest.mark.parametrize("share", [0.3, 0.46])
def test_a_ramp_over_a_step_settles_nothing(share):
    """At most 1 in 500 is lost that all trials keep."""
    points, trials = planes(1000, 50, share, "step"), draw_trials(69, 50, random_state=0)
    support, _, _, _ = adaptive_consistent_sets(points, trials, 25, rule_of(50))
    expected, _, _ = maximum_consistent_sets(points, trials, 25)
    lost = (tilts(points, support) > 8) & (tilts(points, expected) <= 5)
    assert lost.sum() <= 2


def test_a_curved_surface_gets_all_trials():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (100, 50, 3))
    points[..., 2] = 0.3 * (points[..., 0] ** 2 + points[..., 1] ** 2)
    trials = draw_trials(69, 50, random_state=0)
    _, _, _, n_used = adaptive_consistent_sets(points, trials, 25, rule_of(50))
    assert (n_used == 69).mean() > 0.9


def test_perfect_planes_stop_at_the_checkpoint():
    points = planes(50, 50, 0.0, noise=0.0)
    trials = draw_trials(69, 50, random_state=0)
    _, _, _, n_used = adaptive_consistent_sets(points, trials, 25, rule_of(50))
    assert_array_equal(n_used, 32)


def test_eq_13_with_the_bound_of_the_outlier_share_sets_the_least_inliers():
    """38 of 50 leave at most 36 % of outliers (Wilson, 95 %), for which 32 trials suffice."""
    assert_array_equal(rule_of(50).least_inliers[:, 50], [38])
    assert n_trials_needed(0.36, 0.9999, 3) <= 32 < n_trials_needed(0.38, 0.9999, 3)


@pytest.mark.parametrize("size", [4, 19, 201, 250])
def test_neighborhoods_too_small_or_too_large_to_tell_get_all_trials(size):
    assert (rule_of(250).least_inliers[:, size] > size).all()


def test_a_table_little_longer_than_the_check_has_none():
    assert len(rule_of(50, n_trials=33).checkpoints) == 0


def cloud(n=1000, d=4, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.uniform(0, 10, (n, d))
    X[:, -1] = rng.normal(0, 0.01, n)
    X[: n // 10, -1] += rng.uniform(-1, 1, n // 10)
    return X


@pytest.mark.parametrize("method", ["mcmd_z", "mcmd_md"])
def test_row_order_does_not_change_labels(method):
    X, order = cloud(), np.random.default_rng(1).permutation(1000)
    form = {"method": method, "outlier_rate": "auto", "random_state": 0}
    labels = MCMDOutlierDetector(30, **form).fit_predict(X)
    assert_array_equal(labels[order], MCMDOutlierDetector(30, **form).fit_predict(X[order]))


def test_n_jobs_and_chunks_do_not_change_normals():
    X = cloud()
    one, two = (
        RobustNormalEstimator(30, outlier_rate="auto", random_state=0, n_jobs=n).fit(X)
        for n in (1, 2)
    )
    assert_array_equal(one.normals_, two.normals_)
    assert_array_equal(one.transform(X)[100:140], one.transform(X[100:140]))


@pytest.mark.parametrize(("d", "n_trials"), [(3, 69), (4, 143)])
def test_the_table_is_that_of_half_of_the_points_as_outliers(d, n_trials):
    estimator = RobustNormalEstimator(30, outlier_rate="auto", random_state=0)
    assert estimator.fit(cloud(d=d)).n_trials_ == n_trials


@pytest.mark.parametrize("n", [500, 2000])  # NumPy and compiled
def test_in_three_dimensions_all_trials_are_made(n):
    X = cloud(n, d=3)
    auto, all_trials = (
        RobustNormalEstimator(30, outlier_rate=rate, random_state=0).fit(X)
        for rate in ("auto", 0.5)
    )
    assert_array_equal(auto.normals_, all_trials.normals_)


def test_normals_are_as_accurate_as_with_all_trials():
    X, flat = cloud(2000), np.arange(2000) >= 200
    normals = [
        RobustNormalEstimator(50, outlier_rate=rate, random_state=0).fit(X).normals_[flat]
        for rate in ("auto", 0.5)
    ]
    assert (normals[0] != normals[1]).any()  # fewer trials were made indeed
    errors = [bias_angle(found, [0, 0, 0, 1]).mean() for found in normals]
    assert errors[0] < 1.02 * errors[1]


def test_a_stated_rate_still_withstands_70_percent_of_outliers():
    """support_fraction="auto" needs a number, and keeps its breakdown with one."""
    failures = 0
    for run in range(20):
        X, _ = make_contaminated_plane(100, outlier_share=0.7, random_state=run)
        estimator = RobustNormalEstimator(
            None,
            method="mcmd_md",
            support_fraction="auto",
            outlier_rate=0.7,
            refine=None,
            random_state=run,
        )
        failures += bias_angle(estimator.fit(X).normals_[0], [0, 0, 1]) > 5
    assert failures <= 2


@pytest.mark.parametrize("estimator", [MCMDOutlierDetector, RobustNormalEstimator])
def test_both_auto_is_an_error_that_names_both(estimator):
    with pytest.raises(ValueError, match=r"support_fraction='auto'.*outlier_rate='auto'"):
        estimator(outlier_rate="auto", support_fraction="auto").fit(cloud(100))
