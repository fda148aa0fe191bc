"""Flakes: their ranges against the stated density, explicit flakes in space, and real turns."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.integrate import trapezoid
from scipy.stats import kstest

from scenes import scanned
from sklearn_mcmd.datasets import make_lidar_turn
from sklearn_mcmd.datasets._snow import flake_echoes

REACH = 100.0


def shine(r):
    return 1 / (r**2 + 36)


def rate(r, power, snowfall):
    """Flakes a meter of beam that are brighter than this: the formulas of `make_lidar_turn`."""
    n0, slope = 2500 * snowfall**-0.94, 2.29 * snowfall**-0.45
    width = 0.01 + 0.002 * r
    diameter = 1e3 * width * np.sqrt(power / (0.9 * shine(r)))
    melted = diameter * 0.1 ** (1 / 3)
    return np.pi / 4 * width**2 * n0 / slope * np.exp(-slope * melted)


@pytest.mark.parametrize("snowfall", [0.5, 2.0])
def test_ranges_of_flakes_follow_the_stated_density(snowfall):
    n = 40_000
    beam, ranges = flake_echoes(np.full(n, np.inf), snowfall, REACH, 0.0, np.random.default_rng(0))
    assert (np.diff(beam) > 0).all()
    # The strongest of Poisson's flakes: at each power and range that there is one, and none above.
    r = np.linspace(0.9, REACH, 3000)
    powers = np.geomspace(0.8 * shine(REACH), 0.9 * shine(0.9), 600)
    rates = rate(r[None], powers[:, None], snowfall)
    above = trapezoid(rates, r, axis=1)
    none = np.exp(-above)
    density = ((none[1:] + none[:-1])[:, None] / 2 * -np.diff(rates, axis=0)).sum(axis=0)
    ways = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(r))])
    expected = 1 - none[0]
    assert ways[-1] == pytest.approx(expected, rel=0.01)
    error = np.sqrt(expected * (1 - expected) / n)
    assert len(beam) / n == pytest.approx(expected, abs=4 * error)
    assert kstest(ranges, lambda x: np.interp(x, r, ways / ways[-1])).pvalue > 1e-3


def test_snow_is_like_that_of_turns_that_others_simulated(shared_data):
    with np.load(shared_data / "snow_spinning_lidar" / "turn_000048.npz") as arrays:
        ranges, snow = np.linalg.norm(arrays["xyz"].astype(float), axis=1), arrays["snow"]
    beam, mine = flake_echoes(ranges[~snow], 2.0, REACH, 0.0, np.random.default_rng(0))
    assert len(beam) / np.sum(~snow) == pytest.approx(snow.mean(), abs=0.005)
    shares = (0.05, 0.25, 0.5, 0.75, 0.95)
    ratio = np.quantile(mine, shares) / np.quantile(ranges[snow], shares)
    assert 0.75 < ratio.min() < ratio.max() < 1.25


def test_flakes_take_the_place_of_echoes_and_keep_clear_of_surfaces():
    parameters = {"outlier_share": 0.02, "outlier_kinds": ("ghost",), "noise": 1e-4, "snow": 1.0}
    scan, world = scanned("make_lidar_turn", **parameters)
    kind = np.array(scan.outlier_kind_names)[scan.outlier_kind]
    snow = kind == "snow"
    assert np.sum(kind == "ghost") == 400
    assert 200 < snow.sum() < 5000
    assert_array_equal(scan.target == -1, kind != "regular")
    assert np.isnan(scan.true_points[snow]).all()
    assert world.distance(scan.data[snow]).min() > 0
    ranges = np.linalg.norm(scan.data, axis=1, keepdims=True)
    assert 0.8 < ranges[snow].min() < ranges[snow].max() < REACH
    # No beam has both: on the flakes' rays there is no other point.
    way = np.round(scan.data / ranges, 9)
    flakes, others = (set(map(tuple, way[of])) for of in (snow, kind == "regular"))
    assert not flakes & others


def test_clear_turns_have_no_such_kind():
    assert "snow" not in make_lidar_turn(500, random_state=0).outlier_kind_names
