"""The fuzzy detector against the n x n form of Eqs 9-21."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import reference_adjustment as reference
from adjustment_clouds import plane_with_outliers, random_case
from sklearn_mcmd.adjustment import FuzzyPlaneDetector, _effects


@pytest.mark.filterwarnings("ignore:The points that pass are as thick as they are wide")
@pytest.mark.filterwarnings("ignore:The tests reject")
@pytest.mark.parametrize("surface", ["vertical", "orthogonal"])
@pytest.mark.parametrize("weighting", ["ratio", "cut"])
@pytest.mark.parametrize(
    ("test", "width"), [("w", 0.15), ("w", 1.0), ("w", 1.25), ("tau", 0.3), ("t", 0.3)]
)
def test_labels_and_limits_are_those_of_the_matrix_form(surface, weighting, test, width):
    flagged = 0
    for seed in range(16):
        X, p = random_case(seed)
        options = {"width": width, "weighting": weighting, "surface": surface, "test": test}
        expected = reference.fuzzy(X, p, alpha=0.15, **options)
        detector = FuzzyPlaneDetector(0.15, **options).fit(X, weights=p)
        # So Eqs 14, 15 and the larger of both in Eq. 18 change nothing.
        assert np.all(expected["m_B"] >= expected["m_A"] - 1e-12)
        assert_array_equal(detector.labels_, expected["labels"])
        # Heavy-tailed regressors have condition numbers up to 1e4: their square times 1e-16.
        assert_allclose(detector.membership_, expected["m_H"], rtol=0, atol=1e-8)
        assert_allclose(detector.membership_residual_, expected["m_M"], rtol=0, atol=1e-8)
        if expected["M5"].any():
            assert_allclose(
                detector.defuzzification_complement_, expected["complement"], rtol=1e-6, atol=1e-12
            )
            assert_allclose(
                detector.defuzzification_limit_, 1 - expected["complement"], rtol=1e-6, atol=1e-8
            )
            flagged += (expected["labels"] == -1).sum()
    assert flagged > 30


def test_many_regressors_go_without_a_hull_and_agree():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(120, 9))
    X[:10, -1] += 8
    assert X.shape[1] - 1 > _effects.MAX_DIMENSIONS
    expected = reference.fuzzy(X, alpha=0.05, width=1.0)
    assert_array_equal(FuzzyPlaneDetector().fit(X).labels_, expected["labels"])


@pytest.mark.filterwarnings("ignore:The tests reject")
@pytest.mark.parametrize("test", ["w", "tau", "t"])
def test_labels_are_the_predictions_of_the_training_points(test):
    for seed in range(10):
        X, _ = random_case(seed)
        detector = FuzzyPlaneDetector(0.15, test=test).fit(X)
        assert_array_equal(detector.labels_, detector.predict(X))
        assert_allclose(detector.score_samples(X), 1 - detector.membership_, atol=1e-9)


def test_without_an_abnormal_residual_no_point_is_an_outlier():
    X = plane_with_outliers(500, 0)
    detector = FuzzyPlaneDetector(1e-6).fit(X)
    assert (detector.labels_ == 1).all()
    assert np.isnan(detector.defuzzification_limit_)


def test_a_detector_fitted_on_clean_points_still_rejects_a_bad_one():
    X = plane_with_outliers(500, 0)
    detector = FuzzyPlaneDetector(1e-6).fit(X)
    new = np.array([[5.0, 5.0, 60.0], [5.0, 5.0, -0.5], [9.9, 0.1, 6.9]])
    assert_array_equal(detector.predict(new), [-1, 1, 1])


def test_without_a_normal_residual_all_points_are_outliers():
    X = np.column_stack([np.arange(6.0), [0, 100, 0, 100, 0, 100.0]])
    with pytest.warns(UserWarning, match="reject 6 of 6 points, .* Check sigma0=1.0") as caught:
        detector = FuzzyPlaneDetector(width=0.1).fit(X)
    assert caught[0].filename == __file__
    assert (detector.membership_residual_ >= 0.5).all()
    assert (detector.labels_ == -1).all()


@pytest.mark.parametrize("test", ["w", "tau", "t"])
def test_a_new_point_far_outside_has_the_deviation_of_an_added_one(test):
    X = plane_with_outliers(100, 5, 12.0)
    detector = FuzzyPlaneDetector(test=test).fit(X)
    far = np.array([[500.0, 500.0, 0.0]])
    far[0, 2] = far[0, :2] @ detector.coef_ + detector.intercept_ + 5
    # Five sigma off, but the plane is known to some ten there.
    assert detector.predict(far)[0] == 1
