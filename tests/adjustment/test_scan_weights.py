"""Deviations of points against simulated ranges and angles, levels, and variance components."""

import numpy as np
import pytest

from sklearn_mcmd.adjustment import BaardaPlaneDetector, scan_weights, variance_components

STATION = np.array([-3.0, -2.0, 1.2])
ERRORS = {"range_error": 0.002, "range_ppm": 300.0, "angle_error": 0.03}


def scanned(seed, n=2_000, wall=None):
    """Points of a wall, measured with errors of a range and of a direction across the ray."""
    rng = np.random.default_rng(seed)
    wall = rng.uniform((0, 0, 0), (4, 0, 2.5), (n, 3)) if wall is None else wall
    rays = wall - STATION
    ranges = np.linalg.norm(rays, axis=1, keepdims=True)
    units = rays / ranges
    along = rng.normal(size=(n, 1)) * np.hypot(0.002, 300e-6 * ranges)
    across = rng.normal(size=(n, 3)) * np.radians(0.03) * ranges
    across -= np.sum(across * units, axis=1, keepdims=True) * units
    return wall + along * units + across


def judged(X, weights=None):
    return BaardaPlaneDetector(sigma0="auto", surface="orthogonal").fit(X, weights=weights)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (4.0, 0.0, 2.5)])
def test_deviations_are_those_of_simulated_ranges_and_angles(place):
    X = scanned(0, 40_000, np.tile(place, (40_000, 1)))
    told = scan_weights([place], STATION, normal=[0, 1, 0], **ERRORS).deviations[0]
    assert told == pytest.approx(X[:, 1].std(), rel=0.015)  # four standard errors


def test_a_clean_wall_seen_from_aside_has_flags_at_the_level_with_weights_only():
    flagged = []
    for seed in range(60):
        X = scanned(seed)
        weights = scan_weights(X, STATION, **ERRORS).weights
        flagged.append([(judged(X, p).labels_ == -1).any() for p in (None, weights)])
    without, with_weights = np.mean(flagged, axis=0)
    assert without > 0.15
    assert with_weights <= 0.13  # of .05, and three standard errors


def test_sigma0_is_the_median_deviation_and_units_change_nothing():
    X = scanned(0)
    told = scan_weights(X, STATION, **ERRORS)
    assert told.sigma0 == np.median(told.deviations)
    np.testing.assert_allclose(told.weights, (told.sigma0 / told.deviations) ** 2)
    in_mm = scan_weights(1000 * X, 1000 * STATION, **ERRORS | {"range_error": 2.0})
    np.testing.assert_allclose(in_mm.weights, told.weights, rtol=1e-9)


def test_variance_components_say_whether_weights_hold_by_range():
    X = scanned(1, 8_000)
    ranges = np.linalg.norm(X - STATION, axis=1)
    told = scan_weights(X, STATION, **ERRORS)
    plain = variance_components(judged(X), X, ranges)
    weighed = variance_components(judged(X, told.weights), X, ranges, sigma0=told.sigma0)
    noisy = variance_components(judged(X, told.weights), X, ranges, sigma0=told.sigma0 / 20)
    assert min(one.ratio for one in noisy) > 15
    assert sum(one.n_points for one in weighed) >= 7_990
    assert [one.low for one in weighed] == sorted(one.low for one in weighed)
    assert plain[-1].ratio > 1.15 > 0.9 > plain[0].ratio
    for one in weighed:
        assert one.ratio == pytest.approx(1, abs=0.06)
        assert one.usual[0] == pytest.approx(1 - 1.96 / np.sqrt(2 * 2000), abs=0.002)


def test_what_cannot_be_is_refused():
    X = scanned(0, 20)
    with pytest.raises(ValueError, match="row 3"):
        scan_weights(X, X[3], **ERRORS)
    with pytest.raises(ValueError, match="without an error across the plane"):
        scan_weights(X, STATION, range_error=0, angle_error=0)
    with pytest.raises(ValueError, match="station=\\[1, 2\\] is no place: give 3"):
        scan_weights(X, [1, 2], **ERRORS)
    with pytest.raises(ValueError, match="normal has no length"):
        scan_weights(X, STATION, **ERRORS, normal=[0, 0, 0])
    with pytest.raises(ValueError, match="a scan has 3 coordinates"):
        scan_weights(X[:, :2], STATION, **ERRORS)
    with pytest.raises(ValueError, match="'range_error' parameter"):
        scan_weights(X, STATION, range_error=-1, angle_error=0.03)
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        variance_components(judged(X), X, X[:5, 0])
    with pytest.raises(ValueError, match="by contains NaN"):
        variance_components(judged(X), X, np.full(20, np.nan))
