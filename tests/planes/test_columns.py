"""Columns of a transformer, read back."""

import numpy as np
import pytest

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.planes._columns import split_columns


@pytest.mark.parametrize("features", [None, "all"])
@pytest.mark.parametrize("d", [2, 3, 4])
def test_columns_tell_how_many_dimensions_there_are(d, features):
    rng = np.random.default_rng(0)
    X = rng.uniform(size=(60, d)) * [*([1] * (d - 1)), 0.01]
    estimator = RobustNormalEstimator(20, features=features, max_outlier_rate=0.1, random_state=0)
    columns = split_columns(estimator.fit_transform(X))
    np.testing.assert_array_equal(columns.coordinates, X)
    np.testing.assert_array_equal(columns.normals, estimator.normals_)


def test_three_features_behind_the_columns_of_3d_make_no_fourth_dimension():
    rng = np.random.default_rng(0)
    floor = np.stack(np.meshgrid(*[np.arange(40) * 0.01] * 2), axis=-1).reshape(-1, 2)
    floor = np.column_stack([floor, rng.normal(0, 3e-4, 1600)])
    features = ["sphericity", "omnivariance", "anisotropy"]
    columns = RobustNormalEstimator(30, features=features, random_state=0).fit_transform(floor)
    assert split_columns(columns).coordinates.shape == (1600, 3)
