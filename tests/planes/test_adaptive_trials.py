"""Adaptive trials: NumPy and compiled alike, a prefix of the table, and as robust as all of it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from adversarial import KINDS, neighborhoods
from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.datasets import make_contaminated_plane
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.planes._adaptive_trials import StopRule, adaptive_consistent_sets
from sklearn_mcmd.planes._consistent_set import (
    draw_trials,
    localize,
    maximum_consistent_sets,
    n_support_points,
    n_trials_needed,
)
from sklearn_mcmd.planes._plane import fit_planes

numba = pytest.importorskip("numba")

from sklearn_mcmd.planes._adaptive_trials_numba import (  # noqa: E402, after Numba is known
    adaptive_set_3d,
    adaptive_work_arrays,
)
from sklearn_mcmd.planes._consistent_set_numba import work_arrays  # noqa: E402


@numba.njit
def _sets_of(local, sizes, trials, n_support, checkpoints, least_inliers, scale_factor):
    n, k, _ = local.shape
    support = np.zeros((n, k), dtype=np.bool_)
    n_used = np.zeros(n, dtype=np.int64)
    arrays = work_arrays(trials.shape[0], k)
    blocks = adaptive_work_arrays(trials.shape[0], k, checkpoints)
    for i in range(n):
        arrays[0][:] = local[i].T
        _, n_used[i] = adaptive_set_3d(
            sizes[i],
            trials,
            n_support[i],
            arrays,
            blocks,
            checkpoints,
            least_inliers,
            scale_factor,
        )
        for j in range(sizes[i]):
            support[i, j] = arrays[6][j] == 1.0
    return support, n_used


def compiled_sets(points, trials, n_support, rule, sizes):
    local, _ = localize(points, sizes)
    rule = rule.checkpoints, rule.least_inliers, rule.scale_factor
    return _sets_of(local, sizes, trials, n_support, *rule)


def rule_of(k, n_trials=69, d=3, support_fraction=0.5):
    return StopRule.of(n_trials, n_support_points(support_fraction, np.arange(k + 1), d), 0.9999, d)


def planes(n, k, outlier_share, kind="clustered", noise=0.04, seed=0):
    """Planes z = 0 with outliers like those of Section 5.1, in units of their deviation."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, k, 3)) * [1, 1, noise]
    m = round(outlier_share * k)
    if kind == "clustered":
        points[:, k - m :] = [2.04, 1.63, 2.45] + rng.normal(size=(n, m, 3)) * [0.58, 0.58, 0.5]
    elif kind == "uniform":
        points[:, k - m :] = rng.uniform(-3.7, 3.7, (n, m, 3))
    elif kind == "step":  # a curb of 6 to 20 deviations of the noise along x = 0
        points[..., 0] = abs(points[..., 0])
        points[:, k - m :, 0] *= -1
        points[:, k - m :, 2] += rng.uniform(6, 20, (n, 1)) * noise
    # Each in its own order: the table of trials is one for all.
    order = rng.random((n, k)).argsort(axis=1)
    return np.take_along_axis(points, order[..., None], axis=1)


def tilts(points, support):
    _, _, axes = fit_planes(points, support)
    return bias_angle(axes[..., 0], [0, 0, 1])


@pytest.mark.parametrize("k", [50, 21])
@pytest.mark.parametrize("kind", KINDS)
def test_the_kernel_and_numpy_find_the_same_set_in_as_many_trials(kind, k):
    points = neighborhoods(kind, 300, k, seed=k)
    trials, sizes = draw_trials(69, k, random_state=0), np.full(300, k)
    h = n_support_points(0.5, sizes, 3)
    support, _, _, n_used = adaptive_consistent_sets(points, trials, h, rule_of(k), sizes)
    compiled, compiled_used = compiled_sets(points, trials, h, rule_of(k), sizes)
    assert_array_equal(compiled_used, n_used)
    assert_array_equal(compiled, support)


def test_the_kernel_and_numpy_agree_where_sizes_differ():
    points = planes(400, 50, 0.1)
    sizes = np.random.default_rng(0).integers(4, 51, 400)
    trials, h = draw_trials(69, 50, random_state=0), n_support_points(0.5, sizes, 3)
    support, _, _, n_used = adaptive_consistent_sets(points, trials, h, rule_of(50), sizes)
    compiled, compiled_used = compiled_sets(points, trials, h, rule_of(50), sizes)
    assert_array_equal(compiled_used, n_used)
    assert_array_equal(compiled, support)
    assert len(np.unique(n_used)) == 2


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
    points, sizes = planes(1000, 50, share, "uniform"), np.full(1000, 50)
    trials, h = draw_trials(69, 50, random_state=0), np.full(1000, 25)
    _, n_used = compiled_sets(points, trials, h, rule_of(50), sizes)
    assert n_used.mean() < most


@pytest.mark.parametrize("kind", ["clustered", "uniform"])
@pytest.mark.parametrize("share", [0.3, 0.4, 0.46, 0.48])
def test_breakdown_is_that_of_all_trials(kind, share):
    """2,000 neighborhoods: none that all trials keep within 5 degrees is lost.

    Stopping after 32 trials whatever they show loses 0.5 % at 48 % of clustered outliers.
    """
    points, sizes = planes(2000, 50, share, kind), np.full(2000, 50)
    trials, h = draw_trials(69, 50, random_state=0), np.full(2000, 25)
    support, n_used = compiled_sets(points, trials, h, rule_of(50), sizes)
    expected, _, _ = maximum_consistent_sets(points, trials, h)
    lost = (tilts(points, support) > 5) & (tilts(points, expected) <= 5)
    assert lost.sum() == 0
    if share >= 0.46:
        assert (n_used == 69).mean() > 0.99


def test_the_first_32_trials_alone_would_break_down():
    """What the test before would see if the rule let everything pass."""
    points, trials = planes(2000, 50, 0.48), draw_trials(32, 50, random_state=0)
    support, _, _ = maximum_consistent_sets(points, trials, 25)
    assert (tilts(points, support) > 5).sum() >= 5


@pytest.mark.parametrize("share", [0.3, 0.4, 0.46])
def test_a_ramp_over_a_step_settles_nothing(share):
    """At most 1 in 500 is lost that all trials keep."""
    points, sizes = planes(2000, 50, share, "step"), np.full(2000, 50)
    trials, h = draw_trials(69, 50, random_state=0), np.full(2000, 25)
    support, _ = compiled_sets(points, trials, h, rule_of(50), sizes)
    expected, _, _ = maximum_consistent_sets(points, trials, h)
    lost = (tilts(points, support) > 8) & (tilts(points, expected) <= 5)
    assert lost.sum() <= 4


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


def cloud(n=3000, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.uniform(0, 10, (n, 3)) * [1, 1, 0] + rng.normal(0, 0.01, (n, 3))
    X[: n // 10, 2] += rng.uniform(-1, 1, n // 10)
    return X


@pytest.mark.parametrize("method", ["mcmd_z", "mcmd_md"])
def test_row_order_does_not_change_labels(method):
    X, order = cloud(), np.random.default_rng(1).permutation(3000)
    detector = MCMDOutlierDetector(30, method=method, outlier_rate="auto", random_state=0)
    assert_array_equal(detector.fit_predict(X)[order], detector.fit_predict(X[order]))


def test_n_jobs_and_chunks_do_not_change_normals():
    X = cloud()
    normals = [
        RobustNormalEstimator(30, outlier_rate="auto", random_state=0, n_jobs=n).fit(X).normals_
        for n in (1, 2)
    ]
    assert_array_equal(*normals)
    estimator = RobustNormalEstimator(30, outlier_rate="auto", random_state=0).fit(X)
    whole = estimator.transform(X)
    assert_array_equal(whole[100:140], estimator.transform(X[100:140]))


def test_the_table_is_that_of_half_of_the_points_as_outliers():
    assert MCMDOutlierDetector(outlier_rate="auto", random_state=0).fit(cloud()).n_trials_ == 69


def test_normals_are_as_accurate_as_with_all_trials():
    X = cloud(6000)
    flat = np.arange(6000) >= 600
    errors = [
        bias_angle(
            RobustNormalEstimator(50, outlier_rate=rate, random_state=0).fit(X).normals_[flat],
            [0, 0, 1],
        ).mean()
        for rate in ("auto", 0.5)
    ]
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
