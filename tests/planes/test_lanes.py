"""The inner loops of the screening against NumPy."""

import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.planes import _lanes_numba as lanes

N_LANES = 24


@numba.njit
def _distances(planes, features, n_rows, distances, total):
    lanes.lane_distances(planes, features, n_rows, distances, total)


@numba.njit
def _levels(bits, base, n_rows, levels):
    lanes.lane_levels(bits, base, n_rows, levels)


@numba.njit
def _limits(levels, n_rows, wanted, counts, limits):
    lanes.lane_limits(levels, n_rows, wanted, counts, limits)


@numba.njit
def _moments(distances, limits, features, n_rows, moments):
    lanes.lane_moments(distances, limits, features, n_rows, moments)


def floats(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def test_distances_of_all_lanes_and_their_sums():
    planes, features = floats(4, N_LANES), floats(17, lanes.FEATURES, seed=1)
    distances, total = np.full((17, N_LANES), -1, dtype=np.float32), floats(N_LANES)
    _distances(planes, features, 16, distances, total)
    expected = np.abs(features[:16, :3] @ planes[:3] + planes[3])
    assert_allclose(distances[:16], expected, rtol=1e-4, atol=1e-5)
    assert_allclose(total, expected.sum(axis=0), rtol=1e-5)
    assert (distances[16] == -1).all()


def test_levels_are_leading_bits_between_their_ends():
    distances = np.abs(floats(50, N_LANES)) * 10.0 ** np.linspace(-7, 2, 50)[:, None]
    bits = distances.astype(np.float32).view(np.int32)
    base = (np.float32([0.5]).view(np.int32)[0] >> lanes.SHIFT) - np.arange(N_LANES) * 300
    levels = np.zeros((50, N_LANES), dtype=np.int16)
    _levels(bits, base.astype(np.int32), 50, levels)
    expected = np.clip((bits >> lanes.SHIFT) - base, 0, lanes.MOST_LEVEL)
    assert_array_equal(levels, expected)
    assert expected.min() == 0
    assert expected.max() == lanes.MOST_LEVEL


@pytest.mark.parametrize("high", [3, 100, lanes.MOST_LEVEL + 1])  # many ties, some, few
@pytest.mark.parametrize("wanted", [1, 13, 40])
def test_no_more_than_the_wanted_rows_are_below_the_limit_and_more_below_the_next(high, wanted):
    shape = 40, 32
    levels = np.random.default_rng(wanted).integers(0, high, shape).astype(np.int16)
    counts, limits = np.full((2, shape[1]), -1, dtype=np.int16)
    _limits(levels, 40, wanted, counts, limits)
    below = (levels < limits).sum(axis=0)
    assert (below <= wanted).all()
    more = (levels <= limits).sum(axis=0) > wanted
    assert (more | (limits == lanes.MOST_LEVEL)).all()


def test_moments_are_sums_over_the_rows_below_the_limit():
    distances, features = np.abs(floats(24, N_LANES)), floats(24, lanes.FEATURES, seed=1)
    distances[21:], features[21:] = np.inf, 0.0  # rows that pad
    limits = np.linspace(0, 2, N_LANES).astype(np.float32)
    limits[3] = distances[5, 3]  # a row at the limit is not below it
    distances[7, 4] = np.nan
    moments = floats(10, N_LANES)
    _moments(distances, limits, features, 24, moments)
    member = (distances < limits).astype(float)
    assert_array_equal(moments[0], member.sum(axis=0))
    assert_allclose(moments[1:], features.T.astype(float) @ member, rtol=1e-4, atol=1e-5)
    assert member[:, 0].sum() == 0
