"""The floor of sigma0 is what float64 and the file round, not more."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector, compare_planes
from sklearn_mcmd.adjustment._least_squares import adjust_plane, rounding_of
from sklearn_mcmd.adjustment._report import text_report
from sklearn_mcmd.planes._resolution import rounding_in_common

OFFSETS = [0.0, 1e3, 5e6, 1e9]


def exact_plane(offset, d=3, n=200, seed=0, stretch=1.0):
    rng = np.random.default_rng(seed)
    regressors = rng.uniform(0, 10, (n, d - 1)) * stretch ** np.arange(d - 1) + offset
    return np.column_stack([regressors, regressors @ rng.uniform(-2, 2, d - 1) + 7])


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("stretch", [1.0, 0.1])
@pytest.mark.parametrize("d", [2, 3, 5])
def test_no_residual_of_an_exact_plane_exceeds_the_bound(offset, surface, stretch, d):
    for seed in range(5):
        X = exact_plane(offset, d, seed=seed, stretch=stretch)
        plane = adjust_plane(X, surface=surface)
        bound = rounding_of(X, surface).error_of_float64(plane.direction)
        assert np.abs(plane.evaluate(X)[0]).max() <= bound


@pytest.mark.parametrize("offset", OFFSETS)
def test_the_bound_is_within_thirty_times_of_what_coordinates_are_rounded_by(offset):
    X = exact_plane(offset)
    plane = adjust_plane(X)
    # The truth, from exact arithmetic on the rounded coordinates.
    slopes = np.random.default_rng(0)
    slopes.uniform(0, 10, (200, 2))
    a, b = (Fraction(value) for value in slopes.uniform(-2, 2, 2))
    off = [Fraction(z) - a * Fraction(x) - b * Fraction(y) - 7 for x, y, z in X.tolist()]
    largest = float(max(map(abs, off)))
    bound = rounding_of(X, "vertical").error_of_float64(plane.direction)
    assert largest < bound < 30 * largest


@pytest.mark.parametrize("offset", OFFSETS)
@pytest.mark.parametrize(
    "detector",
    [
        BaardaPlaneDetector(sigma0="auto"),
        BaardaPlaneDetector(sigma0="auto", surface="orthogonal", robust_start=True),
        BaardaPlaneDetector(test="tau"),
        BaardaPlaneDetector(test="t", elimination="all", surface="orthogonal"),
        BaardaPlaneDetector(sigma0="auto", robust_start=True, elimination="all"),
        FuzzyPlaneDetector(sigma0="auto"),
        FuzzyPlaneDetector(sigma0="auto", weighting="cut"),
        FuzzyPlaneDetector(test="tau", surface="orthogonal"),
    ],
    ids=lambda d: repr(d),
)
def test_a_point_a_thousand_steps_off_an_exact_plane_is_its_only_outlier(offset, detector):
    X = exact_plane(offset)
    assert (detector.fit(X).labels_ == 1).all()
    assert detector.variance_factor_ <= detector.sigma0_**2
    # As 9.3e-7 at 5e6, where the scale was once held at 5e-7 or more.
    X[17, 2] += 1000 * np.spacing(offset + 10)
    assert_array_equal(np.flatnonzero(detector.fit(X).labels_ == -1), [17])


@pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])
def test_a_sigma0_below_the_rounding_of_float64_is_raised_with_a_warning(detector):
    X = exact_plane(5e6)
    with pytest.warns(UserWarning, match=r"sigma0=1e-12 is less than what float64 may add"):
        fitted = detector(sigma0=1e-12).fit(X)
    assert (fitted.labels_ == 1).all()
    assert fitted.sigma0_ > 1e-9
    assert detector(sigma0=1e-12).fit(exact_plane(0.0)).sigma0_ == 1e-12  # resolved, and kept


STEP = 0.01  # of a file, in meters


def floors(noise, n_floors=20, height=None, seed=0):
    """Level floors of a file, and their heights."""
    rng = np.random.default_rng(seed)
    for _ in range(n_floors):
        z = rng.uniform(-STEP / 2, STEP / 2) if height is None else height
        X = np.column_stack([rng.uniform(0, 4, (2000, 2)), rng.normal(z, noise, 2000)])
        yield np.round(X, 2), z


def judged(X):
    settings = {"sigma0": "auto", "surface": "orthogonal", "robust_start": True}
    return BaardaPlaneDetector(**settings, random_state=0).fit(X)


@pytest.mark.parametrize("noise", [0.001, 0.002, 0.003, 0.004, 0.005])
def test_a_floor_in_steps_loses_no_points_and_its_errors_hold_its_height(noise):
    lost, held = [], []
    for X, z in floors(noise):
        detector, middle = judged(X), np.array([[2.0, 2.0, z]])
        lost.append(np.mean(detector.labels_ == -1))
        held.append(abs(detector.residuals(middle)[0]) < detector.band(middle)[0][0])
        assert detector.sigma0_ >= 0.9999 * STEP / np.sqrt(12)
    assert np.mean(lost) < 0.001  # .035 to .325 were lost
    assert np.mean(held) > 0.8  # three standard errors of 20 floors below .95


@pytest.mark.parametrize("places", ["exact", "millimeters", "raster"])
def test_heights_alone_may_be_rounded(places):
    lost = []
    for X, _ in floors(0.003, 10):
        rng = np.random.default_rng(int(1e6 * X[0, 0]))
        xy = rng.uniform(0, 4, (2000, 2))
        if places == "millimeters":
            xy = np.round(xy, 3)
        elif places == "raster":
            xy = 0.5 * np.column_stack([*np.divmod(np.arange(2000), 40)])
        X[:, :2] = xy
        for detector in (judged(X), BaardaPlaneDetector(sigma0="auto", robust_start=True).fit(X)):
            assert detector.sigma0_ >= 0.9999 * STEP / np.sqrt(12)
            lost.append(np.mean(detector.labels_ == -1))
    assert np.mean(lost) < 0.001


def test_places_of_rasters_are_not_rounded():
    x, y = np.meshgrid(np.arange(60.0), np.arange(40.0))
    rng, near = np.random.default_rng(0), np.abs(x - 1.5 * y) < 6  # a diagonal strip
    for heights in (x[near] + rng.normal(0, 0.01, near.sum()), np.full(near.sum(), 12.3)):
        X = np.column_stack([x[near], y[near], heights])
        assert BaardaPlaneDetector(sigma0="auto", surface="orthogonal").fit(X).sigma0_ < 0.02


def test_a_fuzzy_test_of_a_floor_in_steps_rejects_its_level():
    lost = [
        np.mean(FuzzyPlaneDetector(sigma0="auto", surface="orthogonal").fit_predict(X) == -1)
        for X, _ in floors(0.003, 5)
    ]
    assert np.mean(lost) < 0.05


@pytest.mark.parametrize("gap", [0.0, 0.0027, 0.0054])
def test_the_error_of_an_offset_of_floors_holds_that_each_is_rounded_to_a_level(gap):
    pair = [next(floors(0.002, height=0.005 + z))[0] for z in (-gap / 2, gap / 2)]
    offset = compare_planes(*map(judged, pair)).offset
    assert abs(offset.value - gap) < 1.96 * offset.error
    assert 0.0001 < offset.error < 0.006  # it was 4e-19


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
def test_what_rounding_does_to_all_points_is_told_from_how_they_lie(noise):
    rng, gaps = np.random.default_rng(1), []
    for z in rng.uniform(-0.5, 0.5, 300):
        levels = np.round(rng.normal(z, noise, 5000))
        told = rounding_in_common(levels.std(keepdims=True), np.ones(1), np.ones(1))
        gaps.append([abs(levels.mean() - z), 1.96 * np.hypot(told, levels.std() / np.sqrt(5000))])
    error, limit = np.transpose(gaps)
    assert np.mean(error <= limit) > 0.93
    if noise == 0.5:
        assert limit.max() < 0.05


def test_the_step_of_a_file_is_told_and_a_smaller_sigma0_is_warned_of():
    X = next(floors(0.0))[0]
    words = "that of coordinates in steps of 0.01 m, at least"
    assert words in text_report(judged(X), X, unit="m")
    with pytest.warns(UserWarning, match=r"sigma0=0.001 is less than what coordinates in steps"):
        detector = BaardaPlaneDetector(sigma0=0.001).fit(X)
    assert detector.sigma0_ == pytest.approx(STEP / np.sqrt(12))
