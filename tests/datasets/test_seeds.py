"""Seeds keep their clouds: numbers of clouds that were made before beams had a width."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sklearn_mcmd import datasets

FAR = {"outlier_share": 0.1, "far_share": 0.05}
ALL = ["mixed_pixel", "range_error", "ghost", "low", "high", "particle", "no_return"]
LINES = {"sampling": "scan_lines", "tree": True, "spacing": 0.12}

CASES = [
    ("make_street", 3000, {}, 0, (0.701556575, 3.103482865, 0.097770088), 18410.442623, 750),
    ("make_street", 5000, LINES, 1, (17.935052923, 2.311749935, -0.009401217), 91369.085801, 1250),
    ("make_mobile_scan", 5000, {**FAR, "outlier_kinds": ALL}, 0,
     (8.829294658, 0.10400707, 0.028100448), 92237.98514, 4119),
    ("make_airborne_scan", 5000, {"far_share": 0.05}, 0,
     (35.773295123, 1.746501107, -0.005876905), 349763.843307, 2475),
    ("make_depth_frame", 5000, {}, 0, (-0.123732252, 4.367026223, 1.45190041), 27639.866871, 150),
    # Then the sensor was 1.5 m above the origin.
    ("make_lidar_turn", 8000, {}, 0, (-3.602159455, 3.728378947, 1.379461983), 94408.381054, 1020),
]  # fmt: skip


@pytest.mark.parametrize(("name", "n", "parameters", "seed", "first", "total", "kinds"), CASES)
def test_a_seed_keeps_its_cloud(name, n, parameters, seed, first, total, kinds):
    scan = getattr(datasets, name)(n, random_state=seed, **parameters)
    points = scan.data + ([0, 0, 1.5] if name == "make_lidar_turn" else 0)
    assert_allclose(points[0], first, atol=2e-9)
    assert np.abs(points).sum() == pytest.approx(total, rel=1e-9)
    assert scan.outlier_kind.sum() == kinds
