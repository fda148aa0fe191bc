"""mcmd plan: what it prints and what it refuses."""

import pytest

from commands import done, error_line, run
from sklearn_mcmd.adjustment import BaardaPlaneDetector, plan_plane

FAST = ("plan", "--points", 20, "--repetitions", 500)


def test_the_table_is_that_of_plan_plane():
    result = done(*FAST, "--sigma0", 0.004, "--unit", "m", "--outlier-rate", 0.1)
    detector = BaardaPlaneDetector(sigma0=0.004, robust_start=True)
    plan = plan_plane(20, detector, outlier_rate=0.1, n_repetitions=500, random_state=0)
    rows = dict(line.strip().split("  ", 1) for line in result.stdout.splitlines()[1:])
    assert rows["outliers"].strip() == "2"
    assert rows["detectable bias"].strip().startswith(f"{plan.minimal_bias:.4g} m")
    for name in ("found", "missed", "wrongly_excluded", "over_excluded", "false_alarm"):
        value, error = getattr(plan, name)
        assert rows[name.replace("_", " ")].strip().startswith(f"{value:.4f} ± {error:.4f}")
    assert float(rows["bias"].split()[0]) == pytest.approx(plan.bias[0], abs=1e-4)


def test_a_power_that_needs_no_bias_is_one_line():
    result = run(*FAST, "--power", 1e-6)
    assert result.exit_code == 1
    assert "--power 1e-06 is not above the level" in error_line(result)
