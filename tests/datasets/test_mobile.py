"""The stripe where the vehicle stood still."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from scenes import scanned, with_outliers
from sklearn_mcmd.datasets import make_mobile_scan
from sklearn_mcmd.io import PointCloud, read_trajectory, sensor_origins


def test_lines_lie_as_many_times_as_dense_where_the_vehicle_stood():
    scan = make_mobile_scan(60_000, density_ratio=4.0, random_state=0)
    road = scan.data[scan.classification == 0]
    road = road[(road[:, 1] > -0.5) & (road[:, 1] < 0.5)]
    # The beam turns in a plane 25 degrees off the cross-section: where was the vehicle?
    x = road[:, 0] - np.tan(np.radians(25)) * (road[:, 1] + 1.5)
    dense = np.sum((x > 8.05) & (x < 8.75)) / 0.7
    usual = np.sum((x > 4) & (x < 7.5)) / 3.5
    assert dense / usual == pytest.approx(4.0, rel=0.1)


def test_the_stripe_is_labelled():
    scan, _ = scanned("make_mobile_scan")
    x = scan.sensor_origins[:, 0]
    regular = scan.target == 1
    assert np.array_equal(scan.stretch[regular] == 1, (x >= 8.0)[regular] & (x < 8.8)[regular])


def test_points_lie_on_lines_across_the_street():
    scan, _ = scanned("make_mobile_scan")
    offset = (scan.true_points - scan.sensor_origins)[scan.target == 1]
    assert np.allclose(offset[:, 0], np.tan(np.radians(25)) * offset[:, 1], atol=1e-9)
    assert len(np.unique(scan.sensor_origins[:, 0])) < 300


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


@pytest.mark.parametrize("name", ["make_mobile_scan", "make_airborne_scan"])
def test_times_and_trajectory_say_where_the_sensor_was(name, tmp_path):
    scan, _ = with_outliers(name)
    cloud = PointCloud(scan.data, {"gps_time": scan.gps_time})
    positions = sensor_origins(cloud, scan.trajectory)
    assert np.abs(positions - scan.sensor_origins).max() < 1e-9
    table = np.column_stack(scan.trajectory)
    np.savetxt(tmp_path / "drive.csv", table, "%.17g", ",", header="time,x,y,z", comments="")
    again = sensor_origins(cloud, read_trajectory(tmp_path / "drive.csv"))
    assert np.abs(again - scan.sensor_origins).max() < 1e-9


def test_times_follow_the_turning_beam():
    scan, _ = scanned("make_mobile_scan")
    regular = np.flatnonzero(scan.target == 1)
    order = regular[np.argsort(scan.gps_time[regular])]
    ray = (scan.true_points - scan.sensor_origins)[order]
    across = np.hypot(ray[:, 0], ray[:, 1]) * np.sign(ray[:, 1])
    angle = np.arctan2(ray[:, 2], across)
    angle[angle < -np.pi / 2] += 2 * np.pi  # from 60 degrees below ahead, up and over
    x = scan.sensor_origins[order, 0]
    assert (np.diff(x) >= 0).all()
    assert (np.diff(angle)[np.diff(x) == 0] > -1e-9).all()
