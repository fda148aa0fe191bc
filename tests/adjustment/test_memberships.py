"""Eqs 11-21 one by one, and the identity that leaves one formula of them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import reference_adjustment as reference
from adjustment_clouds import plane_with_outliers, random_case
from sklearn_mcmd.adjustment import _memberships as memberships


@pytest.mark.parametrize("width", [0.15, 1.25])
def test_a_residual_is_half_abnormal_one_width_beyond_the_critical_value(width):
    r = np.array([1.0, 0.25])
    statistic = 2 + width * np.sqrt(r)
    assert_allclose(memberships.abnormal_residual_membership(statistic, r, 2.0, width), 0.5)
    assert_allclose(memberships.normal_residual_membership(statistic, r, 2.0, width), 0.5)


def test_a_residual_up_to_the_critical_value_is_not_abnormal_at_all():
    statistic = np.array([0.0, 1.0, 2.0])
    assert_array_equal(memberships.abnormal_residual_membership(statistic, np.ones(3), 2.0, 1.0), 0)
    assert_array_equal(memberships.normal_residual_membership(statistic, np.ones(3), 2.0, 1.0), 1)


def test_abnormal_and_normal_memberships_add_to_one():
    rng = np.random.default_rng(0)
    arguments = rng.exponential(5, 1000), rng.uniform(0, 1, 1000), 2.0, 0.7
    total = memberships.abnormal_residual_membership(*arguments)
    total += memberships.normal_residual_membership(*arguments)
    assert_allclose(total, 1, rtol=1e-14)


@pytest.mark.parametrize("statistic", [1e9, 1e200, np.inf])
def test_a_gross_outlier_has_a_tiny_normal_membership_and_no_nan(statistic):
    normal = memberships.normal_residual_membership(np.array([statistic]), np.ones(1), 2.0, 1.0)
    assert 0 <= normal[0] <= 1.1e-18


def test_the_error_is_an_outlier_s_by_its_effect_on_normal_residuals_alone():
    # m_H = m_B always: Eqs 14, 15 and the max of Eq. 18 change nothing.
    for seed in range(100):
        X, p = random_case(seed)
        dense = reference.fuzzy(X, p, alpha=0.2, width=1.0)
        assert np.all(dense["m_B"] >= dense["m_A"] - 1e-12)


def test_small_functions_make_up_the_matrix_form():
    X = plane_with_outliers(80, 10, 8.0)
    dense = reference.fuzzy(X, alpha=0.05, width=1.0)
    relative = np.abs(reference.redundancy_matrix(X))
    effect = (relative / relative.max())[~dense["M5"]].max(axis=0)
    complement = memberships.normal_error_complement(effect, dense["m_N"])
    limit = memberships.defuzzification_complement(complement, effect, dense["m_N"], "ratio")
    assert_allclose(1 - complement, dense["m_H"], rtol=1e-12)
    assert_allclose(limit, dense["complement"], rtol=1e-9)
    assert_array_equal(complement <= limit, dense["labels"] == -1)


def test_the_ratio_has_no_bound_and_the_cut_has():
    effect, normal = np.array([0.1, 0.1]), np.array([1.0, 1e-8])
    ratio = memberships.defuzzification_weights(effect, normal, "ratio")
    cut = memberships.defuzzification_weights(effect, normal, "cut")
    assert ratio[1] > 1e7
    assert_allclose(cut, 0.9)


def test_a_point_without_any_normal_membership_takes_the_limit_and_makes_no_nan():
    effect, normal = np.array([1.0, 0.1]), np.array([1.0, 0.0])
    complement = memberships.normal_error_complement(effect, normal)
    assert memberships.defuzzification_complement(complement, effect, normal, "ratio") == 0
