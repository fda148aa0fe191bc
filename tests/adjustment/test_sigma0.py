"""A known sigma0 of another magnitude than the points is warned of."""

import numpy as np
import pytest

from sklearn_mcmd.adjustment import BaardaPlaneDetector, FuzzyPlaneDetector

NOISE = 0.003


def floor(unit=1.0, n=500):
    rng = np.random.default_rng(0)
    X = np.c_[3 * rng.random((n, 2)), NOISE * rng.normal(size=n)]
    X[: n // 20, 2] += 0.05
    return unit * X


DETECTORS = pytest.mark.parametrize("detector", [BaardaPlaneDetector, FuzzyPlaneDetector])


@DETECTORS
@pytest.mark.parametrize(("unit", "noise"), [(1.0, r"0\.00[34]\d*"), (0.001, r"[34][\d.]*e-06")])
def test_a_sigma0_far_above_the_noise_is_warned_of_with_what_the_noise_is(detector, unit, noise):
    words = rf"sigma0=1.0 is far above the deviation .* plane, {noise} in units of X.* 'auto'"
    with pytest.warns(UserWarning, match=words):
        found = detector().fit_predict(floor(unit))
    assert (found == 1).all()


def test_a_sigma0_far_below_the_noise_is_warned_of_once():
    with pytest.warns(
        UserWarning, match=r"sigma0=1e-05 is far below .* plane, 0\.00[34]"
    ) as caught:
        BaardaPlaneDetector(sigma0=1e-5).fit(floor())
    assert len(caught) == 1
    with pytest.warns(UserWarning, match="Check sigma0=1e-05 against the noise") as caught:
        FuzzyPlaneDetector(sigma0=1e-5).fit(floor())
    assert len(caught) == 1


def test_weights_count_as_they_do_in_the_test():
    X, weights = floor(), np.full(500, 1e-6)
    # Of unit weight the noise is a thousandth of 0.003.
    BaardaPlaneDetector(sigma0=NOISE / 1000).fit(X, weights=weights)
    with pytest.warns(UserWarning, match="far above"):
        BaardaPlaneDetector(sigma0=NOISE).fit(X, weights=weights)


@pytest.mark.parametrize(
    "detector",
    [
        BaardaPlaneDetector(sigma0=NOISE),
        BaardaPlaneDetector(sigma0=20 * NOISE),
        BaardaPlaneDetector(sigma0=NOISE / 20),
        BaardaPlaneDetector(sigma0="auto"),
        BaardaPlaneDetector(test="tau"),
        BaardaPlaneDetector(test="t"),
        FuzzyPlaneDetector(sigma0=NOISE),
        FuzzyPlaneDetector(sigma0="auto"),
        FuzzyPlaneDetector(test="t"),
    ],
)
def test_a_sigma0_that_may_be_or_is_not_used_is_silent(detector):
    detector.fit(floor())


def test_a_few_huge_outliers_do_not_hide_or_make_the_warning():
    X = floor()
    X[:5, 2] = 1e6
    BaardaPlaneDetector(sigma0=NOISE, robust_start=True, random_state=0).fit(X)
    with pytest.warns(UserWarning, match="far above"):
        BaardaPlaneDetector(robust_start=True, random_state=0).fit(X)
