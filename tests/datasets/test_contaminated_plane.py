"""The contaminated plane of Section 5.1: statistics against their laws."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import kstest

from reference import pca_normal
from sklearn_mcmd.datasets import make_contaminated_plane
from sklearn_mcmd.metrics import bias_angle


def test_both_laws_have_the_means_and_variances_that_are_stated():
    X, y = make_contaminated_plane(40_000, outlier_share=0.5, random_state=0)
    laws = {1: ([2, 2, 2], [6, 6, 0.01]), -1: ([7, 6, 8], [2, 2, 1.5])}
    for label, (mean, variances) in laws.items():
        points = X[y == label]
        # Five standard errors: of a mean sqrt(v/n), of a variance v sqrt(2/n).
        error = np.abs(points.mean(axis=0) - mean)
        assert (error < 5 * np.sqrt(np.array(variances) / 20_000)).all()
        assert_allclose(points.var(axis=0), variances, rtol=5 * np.sqrt(2 / 20_000))


def test_uniform_outliers_fill_their_range_on_every_axis():
    X, y = make_contaminated_plane(10_000, outlier_share=0.5, outliers="uniform", random_state=2)
    for column in X[y == -1].T:
        assert kstest(column, "uniform", args=(-9, 18)).pvalue > 1e-3


@pytest.mark.parametrize(
    ("outliers", "paper_mean", "paper_std"),
    [("clustered", 34.483, 3.973), ("uniform", 27.593, 16.231)],
)
def test_pca_has_the_bias_angle_of_table_1(outliers, paper_mean, paper_std):
    clouds = [
        make_contaminated_plane(outliers=outliers, return_X_y=False, random_state=seed)
        for seed in range(1000)
    ]
    angles = [bias_angle(pca_normal(c.data), pca_normal(c.clean)) for c in clouds]
    # Both means come from 1000 runs: four standard errors of their difference.
    assert abs(np.mean(angles) - paper_mean) < 4 * paper_std * np.sqrt(2 / 1000)
    assert_allclose(np.std(angles), paper_std, rtol=0.15)


def test_the_clean_twin_differs_exactly_where_the_outliers_are():
    cloud = make_contaminated_plane(return_X_y=False, random_state=3)
    assert_array_equal((cloud.data != cloud.clean).all(axis=1), cloud.target == -1)
    assert_array_equal((cloud.data != cloud.clean).any(axis=1), cloud.target == -1)


@pytest.mark.parametrize("n_samples", [20, 1000])
@pytest.mark.parametrize("percent", [1, 5, 45, 80])
def test_the_number_of_outliers_is_the_nearest_to_the_share(n_samples, percent):
    X, y = make_contaminated_plane(n_samples, outlier_share=percent / 100, random_state=0)
    assert X.shape == (n_samples, 3)
    assert abs((y == -1).sum() - percent * n_samples / 100) <= 0.5
    assert (np.diff(y) <= 0).all()  # outliers come last


@pytest.mark.parametrize("variances", [(2, 1), (15, 10)])
def test_the_variances_of_table_2_can_be_made(variances):
    regular, outlier = variances
    X, y = make_contaminated_plane(
        20_000,
        outlier_share=0.5,
        regular_variances=(regular, regular, 0.01),
        outlier_variances=(outlier, outlier, 1.5),
        random_state=5,
    )
    assert_allclose(X[y == 1, :2].var(axis=0), regular, rtol=5 * np.sqrt(2 / 10_000))
    assert_allclose(X[y == -1, :2].var(axis=0), outlier, rtol=5 * np.sqrt(2 / 10_000))


def test_a_larger_share_replaces_points_and_leaves_the_others():
    few = make_contaminated_plane(100, outlier_share=0.1, random_state=6)[0]
    many = make_contaminated_plane(100, outlier_share=0.4, random_state=6)[0]
    assert_array_equal(few[:60], many[:60])


def test_the_normal_is_the_axis_of_least_variance():
    cloud = make_contaminated_plane(regular_variances=(1, 0.1, 2), return_X_y=False)
    assert_array_equal(cloud.normal, [0, 1, 0])


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"outliers": "none"}, "'outliers' parameter"),
        ({"outlier_share": 1.2}, "'outlier_share' parameter"),
        ({"n_samples": 0}, "'n_samples' parameter"),
        ({"regular_variances": (1, 1, -1)}, "regular_variances=.*not negative"),
        ({"regular_variances": (1, 1, 1)}, "no single least value"),
        ({"outlier_variances": (1, np.nan, 1)}, "outlier_variances=.*finite"),
        ({"outlier_variances": (1, 1)}, "outlier_variances=.*three"),
    ],
)
def test_bad_parameters_of_the_plane_are_named(parameters, message):
    with pytest.raises(ValueError, match=message):
        make_contaminated_plane(**parameters)
