"""Flakes: their ranges against the stated density, explicit flakes in space, and real turns."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.integrate import trapezoid
from scipy.stats import ks_2samp, kstest

from scenes import scanned
from sklearn_mcmd.datasets import make_lidar_turn, make_street
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


def test_flakes_are_those_of_explicit_flakes_in_space():
    # A tube around each beam, filled with flakes of all sizes, up to 12 m away.
    rng, n, far, radius, snowfall = np.random.default_rng(1), 1500, 12.0, 0.018, 1.0
    per_volume, slope = 2500 / 2.29, 2.29
    found = []
    for _ in range(n):
        m = rng.poisson(per_volume * np.pi * radius**2 * far)
        r, off = far * rng.random(m), radius * np.sqrt(rng.random(m))
        diameter = rng.exponential(1 / slope, m) / 0.1 ** (1 / 3) / 1e3
        width = 0.01 + 0.002 * r
        power = np.where(off < width / 2, 0.9 * np.minimum(diameter / width, 1) ** 2 * shine(r), 0)
        power[r < 0.9] = 0
        if m and power.max() > 0.3 * shine(far):
            found.append(r[np.argmax(power)])
    _, ranges = flake_echoes(np.full(20 * n, far), snowfall, REACH, 0.0, np.random.default_rng(0))
    share = len(ranges) / (20 * n)
    assert len(found) / n == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / n))
    assert ks_2samp(found, ranges).pvalue > 1e-3


def test_flakes_stand_before_what_the_beam_meets_and_outshine_it():
    rng = np.random.default_rng(0)
    target = np.repeat([3.0, 10.0, 50.0, np.inf], 20_000)
    beam, ranges = flake_echoes(target, 2.0, REACH, 0.0, rng)
    assert (ranges < target[beam]).all()
    assert ranges.min() > 0.9
    share = np.bincount(beam // 20_000, minlength=4) / 20_000
    assert (np.diff(share) > 0).all()  # farther surfaces outshine fewer


def test_more_snow_ends_more_beams():
    target = np.full(20_000, 12.0)
    counts = [
        len(flake_echoes(target, snowfall, REACH, 0.0, np.random.default_rng(0))[0])
        for snowfall in (0.2, 1.0, 5.0)
    ]
    assert (np.diff(counts) > 0).all()


def test_snow_is_like_that_of_turns_that_others_simulated(shared_data):
    with np.load(shared_data / "snow_spinning_lidar" / "turn_000048.npz") as arrays:
        ranges, snow = np.linalg.norm(arrays["xyz"].astype(float), axis=1), arrays["snow"]
    beam, mine = flake_echoes(ranges[~snow], 2.0, REACH, 0.0, np.random.default_rng(0))
    assert len(beam) / np.sum(~snow) == pytest.approx(snow.mean(), abs=0.005)
    shares = (0.05, 0.25, 0.5, 0.75, 0.95)
    ratio = np.quantile(mine, shares) / np.quantile(ranges[snow], shares)
    assert 0.75 < ratio.min() < ratio.max() < 1.25


@pytest.mark.parametrize("name", ["make_mobile_scan", "make_lidar_turn"])
def test_flakes_take_the_place_of_echoes(name):
    scan, _ = scanned(name, outlier_share=0.02, outlier_kinds=("ghost",), far_share=0.0, snow=1.0)
    kind = np.array(scan.outlier_kind_names)[scan.outlier_kind]
    assert np.sum(kind == "ghost") == 400
    snow = kind == "snow"
    assert 200 < snow.sum() < 5000
    assert_array_equal(scan.target == -1, kind != "regular")
    assert np.isnan(scan.true_points[snow]).all()
    ray = scan.data - scan.sensor_origins
    ranges = np.linalg.norm(ray, axis=1, keepdims=True)
    # No beam has both: on the flakes' rays there is no other point.
    way = np.column_stack([scan.sensor_origins, ray / ranges])[kind != "ghost"]
    _, count = np.unique(np.round(way, 9), axis=0, return_counts=True)
    assert count.max() <= 5  # echoes of one beam
    flakes = {tuple(row) for row in np.round(way[snow[kind != "ghost"]], 9)}
    others = {tuple(row) for row in np.round(way[~snow[kind != "ghost"]], 9)}
    assert not flakes & others


def test_flakes_keep_clear_of_surfaces_but_for_their_noise():
    scan, world = scanned("make_lidar_turn", outlier_share=0.0, snow=2.0, noise=1e-4)
    snow = scan.target == -1
    assert world.distance(scan.data[snow]).min() > 0


def test_a_street_in_snow_has_its_points_and_kinds():
    street = make_street(
        10_000, sampling="scan_lines", spacing=0.09, outlier_share=0.05, snow=0.5, random_state=0
    )
    kind = np.array(street.outlier_kind_names)[street.outlier_kind]
    assert len(street.data) == 10_000
    assert np.sum((kind != "regular") & (kind != "snow")) == 500
    snow = kind == "snow"
    assert snow.sum() > 300
    assert (street.bay[snow] == -1).all()
    ranges = np.linalg.norm((street.data - street.sensor_origins)[snow], axis=1)
    assert 0.8 < ranges.min() < ranges.max() < REACH
    # Flakes cost points of surfaces: the spacing that is told is that of what is left.
    clear = make_street(
        10_000, sampling="scan_lines", spacing=0.09, outlier_share=0.05, random_state=0
    )
    wall = [np.sum(s.surface == s.surface_names.index("wall")) for s in (street, clear)]
    assert street.length == clear.length
    assert wall[0] / wall[1] == pytest.approx((clear.spacing / street.spacing) ** 2, rel=0.1)


def test_turns_in_snow_are_reproducible_and_those_without_have_no_such_kind():
    first, again, clear = (make_lidar_turn(500, snow=snow, random_state=0) for snow in (1, 1, 0))
    assert_array_equal(first.data, again.data)
    assert_array_equal(first.outlier_kind, again.outlier_kind)
    snow = first.outlier_kind_names.index("snow")
    assert (first.outlier_kind == snow).sum() > 10
    assert "snow" not in clear.outlier_kind_names
