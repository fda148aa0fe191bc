"""Critical values and local levels against their definitions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from sklearn_mcmd.adjustment import critical_value, local_level


def test_w_has_the_three_critical_values_of_table_1_at_once():
    c = critical_value("w", 0.01, 5)
    assert_allclose(c, stats.norm.isf(0.005), rtol=1e-12)
    assert_allclose(c**2, stats.chi2(1).isf(0.01), rtol=1e-12)
    assert_allclose(c**2, stats.f(1, 1e9).isf(0.01), rtol=1e-6)


def test_t_and_tau_have_the_critical_values_of_table_1():
    for f in (2, 3, 10, 1000):
        t = stats.t(f - 1).isf(0.005)
        assert_allclose(critical_value("t", 0.01, f), t, rtol=1e-9)
        tau = np.sqrt(f * t**2 / (f - 1 + t**2))
        assert_allclose(critical_value("tau", 0.01, f), tau, rtol=1e-9)
        assert critical_value("tau", 0.01, f) <= np.sqrt(f)


def test_tau_rejects_a_clean_residual_with_its_level():
    # tau^2 / f of one residual is Beta(1/2, (f - 1)/2) distributed (Pope).
    f, level = 12, 0.03
    c = critical_value("tau", level, f)
    assert_allclose(stats.beta(0.5, (f - 1) / 2).sf(c**2 / f), level, rtol=1e-9)


@pytest.mark.parametrize(
    ("test", "dof", "expected"),
    [("tau", 0, np.inf), ("t", 0, np.inf), ("tau", 1, 1.0), ("t", 1, np.inf)],
)
def test_without_redundancy_nothing_can_be_rejected(test, dof, expected):
    assert critical_value(test, 0.05, dof) == expected


def test_sidak_keeps_the_level_of_the_whole():
    for n in (1, 7, 10**9):
        local = local_level(0.05, n)
        assert_allclose(-np.expm1(n * np.log1p(-local)), 0.05, rtol=1e-12)
