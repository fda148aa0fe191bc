"""The stripe where the vehicle stood still."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from scenes import scanned
from sklearn_mcmd.datasets import make_mobile_scan


@pytest.mark.parametrize("ratio", [10.0, 4.0])
def test_lines_lie_as_many_times_as_dense_where_the_vehicle_stood(ratio):
    scan = make_mobile_scan(60_000, density_ratio=ratio, random_state=0)
    road = scan.data[scan.classification == 0]
    road = road[(road[:, 1] > -0.5) & (road[:, 1] < 0.5)]
    # The beam turns in a plane 25 degrees off the cross-section: where was the vehicle?
    x = road[:, 0] - np.tan(np.radians(25)) * (road[:, 1] + 1.5)
    dense = np.sum((x > 8.05) & (x < 8.75)) / 0.7
    usual = np.sum((x > 4) & (x < 7.5)) / 3.5
    assert dense / usual == pytest.approx(ratio, rel=0.1)


def test_the_stripe_is_labelled():
    scan, _ = scanned("make_mobile_scan")
    x = scan.viewpoints[:, 0]
    regular = scan.target == 1
    assert np.array_equal(scan.stretch[regular] == 1, (x >= 8.0)[regular] & (x < 8.8)[regular])


def test_points_lie_on_lines_across_the_street():
    scan, _ = scanned("make_mobile_scan")
    offset = (scan.true_points - scan.viewpoints)[scan.target == 1]
    assert np.allclose(offset[:, 0], np.tan(np.radians(25)) * offset[:, 1], atol=1e-9)
    assert len(np.unique(scan.viewpoints[:, 0])) < 300


def test_thin_things_are_scanned_with_few_points_in_a_row():
    scan, _ = scanned("make_mobile_scan", 60_000)
    names = np.array(scan.class_names)
    wire = scan.data[scan.classification == np.flatnonzero(names == "wire")[0]]
    assert 200 < len(wire) < 2000
    away = cKDTree(wire).query(wire, k=2)[0][:, 1]
    assert 0.005 < np.median(away) < 0.2


def test_the_density_ratio_is_at_least_one():
    with pytest.raises(ValueError, match="'density_ratio' parameter"):
        make_mobile_scan(100, density_ratio=0.5)
