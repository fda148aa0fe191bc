"""The floor of sigma0 is what float64 rounds, not more."""

from fractions import Fraction

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector
from sklearn_mcmd.adjustment._least_squares import (
    adjust_plane,
    residual_rounding,
    rounding_errors,
)

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
        bound = residual_rounding(rounding_errors(X), plane.direction)
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
    assert largest < residual_rounding(rounding_errors(X), plane.direction) < 30 * largest


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
