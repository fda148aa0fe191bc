"""Ranks among numbers in parts are those of NumPy among all of them."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.tiling._quantiles import evenly_along_x, exceeded_by


@pytest.mark.parametrize("share", [0.001, 0.03, 0.0725, 0.5])
@pytest.mark.parametrize("n", [1, 2, 77, 4_001])
def test_the_number_that_a_share_exceeds_is_that_of_numpy(share, n):
    rng = np.random.default_rng(n)
    numbers = np.exp(rng.normal(0, 20, n))
    numbers[rng.random(n) < 0.2] = 0.0
    numbers[: n // 3] = np.round(numbers[: n // 3], 1)
    numbers[rng.random(n) < 0.1] = np.finfo(float).max
    parts = np.array_split(numbers, 3)
    assert exceeded_by(lambda: iter(parts), share) == -np.percentile(-numbers, 100 * share)


@pytest.mark.parametrize("digits", [0, 1, 9])
@pytest.mark.parametrize("step", [1, 7, 400])
def test_points_are_taken_evenly_in_the_order_of_their_coordinates(digits, step):
    rng = np.random.default_rng(step)
    xyz = np.unique(np.round(rng.normal(0, 3, (2_000, 3)), digits), axis=0)
    ordered = xyz.copy()
    rng.shuffle(xyz)
    assert_array_equal(xyz[evenly_along_x(xyz, step)], ordered[::step])
