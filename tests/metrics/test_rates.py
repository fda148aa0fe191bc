"""Measures against hand-made truth, high-precision arithmetic and scikit-learn."""

from decimal import Decimal, getcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.exceptions import UndefinedMetricWarning

from sklearn_mcmd.metrics import bias_angle, outlier_scores

UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize("degrees", [1e-12, 1e-9, 1e-6, 1e-3, 1.0, 30.0, 60.0, 89.0, 89.999999])
def test_the_bias_angle_is_the_angle_by_which_a_normal_was_turned(degrees):
    angle = np.radians(degrees)
    turned = [np.sin(angle), 0.0, np.cos(angle)]
    assert_allclose(bias_angle(UP, turned), degrees, rtol=1e-12)


def test_tiny_angles_in_general_position_agree_with_50_digit_arithmetic():
    getcontext().prec = 50
    a = [0.3, -0.5, 0.81]
    b = [0.3 + 1e-9, -0.5, 0.81 - 3e-10]
    x, y = [Decimal(v) for v in a], [Decimal(v) for v in b]
    cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]
    sine = (sum(c * c for c in cross) / (sum(v * v for v in x) * sum(v * v for v in y))).sqrt()
    # The angle is 1e-9: sine and angle agree to 1e-18, the unit vectors' rounding gives 1e-7.
    assert_allclose(bias_angle(a, b), np.degrees(float(sine)), rtol=5e-7)


@given(st.lists(st.floats(-1e150, 1e150), min_size=2, max_size=6), st.floats(1e-3, 1e3))
def test_parallel_normals_of_any_length_have_no_angle_and_no_nan(normal, factor):
    normal = np.array(normal)
    if np.abs(normal).max() < 1e-150:
        return
    assert bias_angle(normal, -factor * normal) < 1e-13


def test_one_normal_is_compared_with_many():
    many = np.array([[0, 0, 1], [0, 1, 0], [1, 0, 1]])
    assert_allclose(bias_angle(many, UP), [0, 90, 45])
    assert_allclose(bias_angle(-UP, many), [0, 90, 45])
    assert isinstance(bias_angle(UP, UP), float)


def test_missing_normals_give_nan_and_leave_the_others_alone():
    assert_array_equal(bias_angle([[np.nan] * 3, [0, 1, 0]], UP), [np.nan, 90.0])


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (UP, [[0, 0, 0], [0, 0, 1]], "normals_b holds 1 zero vectors"),
        (UP, [1.0], "normals_a has 3 coordinates and normals_b 1"),
        (np.ones((2, 3)), np.ones((4, 3)), "do not broadcast"),
        ([np.inf, 0, 0], UP, "infinity"),
    ],
)
def test_bad_normals_are_refused_by_name(a, b, message):
    with pytest.raises(ValueError, match=message):
        bias_angle(a, b)


# 10 outliers of which 7 are found; 40 inliers of which 4 are swamped.
Y_TRUE = np.repeat([-1, 1], [10, 40])
Y_PRED = np.repeat([-1, 1, -1, 1], [7, 3, 4, 36])


def test_outlier_scores_are_the_ratios_of_counts_of_their_equations():
    assert outlier_scores(Y_TRUE, Y_PRED) == {
        "true_positive_rate": 0.7,
        "true_negative_rate": 0.9,
        "swamping_rate": 0.1,
        "masking_rate": 0.3,
        "accuracy": 43 / 50,
    }


@pytest.mark.parametrize(
    ("label", "undefined", "missing"),
    [
        (1, ("true_positive_rate", "masking_rate"), "outlier"),
        (-1, ("true_negative_rate", "swamping_rate"), "inlier"),
    ],
)
def test_rates_of_a_class_are_nan_with_a_warning_where_there_is_none(label, undefined, missing):
    with pytest.warns(UndefinedMetricWarning, match=f"holds no {missing}"):
        scores = outlier_scores([label, label], [1, -1])
    assert {name for name, value in scores.items() if np.isnan(value)} == {*undefined}


@pytest.mark.parametrize(
    ("y_true", "y_pred", "message"),
    [
        ([1, 1, -1], [0, 1, 1], r"y_pred holds the values .*np\.where"),
        ([1, 1, -1], [True, False, True], r"y_pred holds the values .*np\.where"),
        ([1, 1, -1], ["in", "out", "in"], r"y_pred holds the values .*np\.where"),
        ([1, -1], [1, -1, 1], "inconsistent numbers of samples"),
        ([], [], "y_true is empty"),
    ],
)
def test_bad_labels_are_refused_with_the_remedy(y_true, y_pred, message):
    with pytest.raises(ValueError, match=message):
        outlier_scores(y_true, y_pred)
