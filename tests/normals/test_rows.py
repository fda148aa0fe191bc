"""Neighborhoods of one row of a scan are warned of, and their normals are in doubt."""

import numpy as np
import pytest

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street


def ground(gap, jitter=0.0, n=2_500, noise=0.1):
    """Level ground in rows that are `gap` times as far apart as points in them."""
    rng, side = np.random.default_rng(5), np.sqrt(n)
    n_rows = int(side / np.sqrt(gap))
    each = n // n_rows
    x = np.tile(np.arange(each) * side / each, n_rows)
    y = np.repeat((np.arange(n_rows) + 0.5) * side / n_rows, each)
    X = np.column_stack([x, y, np.zeros(len(x))])
    X[:, 0] += rng.uniform(-0.3, 0.3, len(X)) * side / each
    return X + rng.normal(size=X.shape) * [0, jitter, noise]


def tilts(estimator):
    return np.degrees(np.arccos(np.minimum(np.abs(estimator.normals_[:, 2]), 1)))


@pytest.mark.parametrize(("gap", "jitter"), [(25, 0.0), (36, 0.0), (36, 0.1)])
def test_a_normal_that_a_row_leaves_open_is_warned_of_and_has_a_large_error(gap, jitter):
    X = ground(gap, jitter)
    estimator = RobustNormalEstimator(random_state=0)
    with pytest.warns(UserWarning, match=r"n_neighbors=50 nearest of \d+ % of the points lie in"):
        estimator.fit(X)
    off = tilts(estimator)
    assert np.mean(off > 10) > 0.5
    assert np.mean(off <= 1.73 * estimator.normal_error_) > 0.85


def test_as_many_neighbors_as_the_warning_names_see_the_ground():
    X = ground(25)
    with pytest.warns(UserWarning, match="'auto', or 286"):
        RobustNormalEstimator(random_state=0).fit(X)
    for n_neighbors in (286, "auto"):
        assert np.mean(tilts(RobustNormalEstimator(n_neighbors, random_state=0).fit(X)) < 5) > 0.99


@pytest.mark.parametrize("sampling", ["uniform", "scan_lines"])
def test_streets_and_rows_four_steps_apart_are_not_warned_of(sampling):
    street = make_street(8_000, sampling=sampling, random_state=0)
    RobustNormalEstimator(random_state=0).fit(street.data)  # a warning is an error
    RobustNormalEstimator(random_state=0).fit(ground(9))
