"""The contaminated plane of Section 5.1: statistics against their laws."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import kstest

from sklearn_mcmd.datasets import make_contaminated_plane


@pytest.mark.parametrize(("regular", "outlier"), [(6, 2), (2, 1), (15, 10)])  # Table 2
def test_both_laws_have_the_means_and_variances_that_are_stated(regular, outlier):
    own = {} if regular == 6 else {"regular_variances": (regular, regular, 0.01)}
    own |= {} if outlier == 2 else {"outlier_variances": (outlier, outlier, 1.5)}
    X, y = make_contaminated_plane(40_000, outlier_share=0.5, random_state=0, **own)
    laws = {1: ([2, 2, 2], [regular, regular, 0.01]), -1: ([7, 6, 8], [outlier, outlier, 1.5])}
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


def test_the_normal_is_the_axis_of_least_variance():
    cloud = make_contaminated_plane(regular_variances=(1, 0.1, 2), return_X_y=False)
    assert_array_equal(cloud.normal, [0, 1, 0])
