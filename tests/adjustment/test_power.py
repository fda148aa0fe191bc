"""Noncentralities against SciPy's distributions and simulations."""

import pytest
from scipy import stats

from sklearn_mcmd.adjustment import noncentrality


@pytest.mark.parametrize("dof", [1e9, 1e20, 1e58])
def test_a_scale_of_very_many_degrees_of_freedom_is_a_known_one(dof):
    known = noncentrality(0.01, 0.8, 2)
    assert noncentrality(0.01, 0.8, 2, dof_scale=dof) == pytest.approx(known, rel=1e-6)


def test_baardas_own_noncentrality_is_17():
    assert noncentrality(0.001, 0.8) == pytest.approx(17.075, abs=5e-4)


@pytest.mark.parametrize(("level", "power"), [(0.05, 0.8), (1e-7, 0.8), (0.001, 0.99), (0.2, 0.3)])
@pytest.mark.parametrize("dof", [1, 2, 100, 1e6])
def test_a_test_of_this_noncentrality_has_the_power(level, power, dof):
    limit = stats.chi2.isf(level, dof)
    assert stats.ncx2.sf(limit, dof, noncentrality(level, power, dof)) == pytest.approx(power)


@pytest.mark.parametrize("dof", [1, 2])
@pytest.mark.parametrize("dof_scale", [1, 6, 96, 10_000])
def test_so_has_a_test_with_an_estimated_scale(dof, dof_scale):
    nc = noncentrality(0.001, 0.8, dof, dof_scale)
    limit = stats.f.isf(0.001, dof, dof_scale)
    # ncf loses digits where few degrees of freedom make the limit large.
    assert stats.ncf.sf(limit, dof, dof_scale, nc) == pytest.approx(0.8, abs=1e-4)


def test_a_power_below_the_level_is_refused():
    with pytest.raises(ValueError, match=r"power=0.01 is not above the level 0.05"):
        noncentrality(0.05, 0.01)
