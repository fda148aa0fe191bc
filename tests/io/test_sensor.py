"""Positions of the sensor that files tell, and that they do not claim what they do not know."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from e57_files import write_scans
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, sensor_origins, write_points

POINTS = np.array([[1.0, 0, 0], [2, 0, 3]])
TURNED = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])


def at(x, y, z, **options):
    return POINTS, {}, {"translation": np.array([x, y, z], float), **options}


def test_each_point_of_e57_has_the_position_of_its_scan(tmp_path):
    write_scans(tmp_path / "a.e57", at(10, 0, 1), at(0, 7, 2, rotation=TURNED))
    cloud = read_points(tmp_path / "a.e57")
    expected = np.repeat([[10.0, 0, 1], [0, 7, 2]], 2, axis=0)
    turned = [[11, 0, 1], [12, 0, 4], [0, 8, 2], [0, 9, 5]]  # x to y, in the second scan
    assert_allclose(cloud.xyz, turned, atol=1e-12)
    assert_array_equal(cloud.attributes["scan_index"], [0, 0, 1, 1])
    assert_allclose(sensor_origins(cloud), expected, atol=1e-12)
    assert_allclose(sensor_origins(cloud.subset(np.array([3, 0]))), expected[[3, 0]], atol=1e-12)
    write_scans(tmp_path / "a.e57", at(10, 0, 1))
    assert_array_equal(sensor_origins(read_points(tmp_path / "a.e57")), [[10, 0, 1]] * 2)


def test_a_pose_that_moves_nothing_counts_only_with_a_grid(tmp_path):
    grid = {name: np.arange(2) for name in ("rowIndex", "columnIndex")}
    write_scans(tmp_path / "a.e57", (POINTS, grid, {}))
    assert_array_equal(sensor_origins(read_points(tmp_path / "a.e57")), np.zeros((2, 3)))
    write_scans(tmp_path / "a.e57", (POINTS, {}, {}))
    write_points(tmp_path / "b.e57", POINTS + 50)  # which claims no setup at its center
    for name in ("a.e57", "b.e57"):
        with pytest.raises(PointFileError, match="not all of the scans have a pose"):
            sensor_origins(read_points(tmp_path / name))


def test_points_that_lost_the_number_of_their_scan_have_no_position():
    with pytest.raises(PointFileError, match="lost the attribute scan_index"):
        sensor_origins(PointCloud(POINTS, {}, {"sensor_origins": np.eye(2, 3)}))


def test_the_viewpoint_of_pcd_is_the_position_unless_it_is_the_usual_zeros():
    cloud = PointCloud(POINTS, {}, {"pcd_viewpoint": (1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0)})
    assert_array_equal(sensor_origins(cloud), [[1, 2, 3]] * 2)
    cloud.metadata["pcd_viewpoint"] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    with pytest.raises(PointFileError, match="also written where it is not known"):
        sensor_origins(cloud)


@pytest.mark.parametrize("numbers", [b"nan 2 3 1 0 0 0", b"1 2 3 1 -inf 0 0"])
def test_a_viewpoint_that_is_not_finite_is_not_known(tmp_path, numbers):
    write_points(tmp_path / "a.pcd", PointCloud(POINTS))
    data = (tmp_path / "a.pcd").read_bytes()
    data = re.sub(rb"VIEWPOINT.*", b"VIEWPOINT " + numbers, data, count=1)
    (tmp_path / "a.pcd").write_bytes(data)
    with pytest.warns(UserWarning, match="a.pcd: VIEWPOINT has numbers that are not finite"):
        cloud = read_points(tmp_path / "a.pcd")
    with pytest.raises(PointFileError, match=r"no position .* VIEWPOINT has numbers that are n"):
        sensor_origins(cloud)


def test_other_files_tell_no_position():
    with pytest.raises(PointFileError, match=r"only PCD's VIEWPOINT, .* tell it; give a"):
        sensor_origins(PointCloud(POINTS))


def test_a_trajectory_that_is_no_pair_is_refused():
    cloud = PointCloud(POINTS, {"gps_time": np.zeros(len(POINTS))})
    with pytest.raises(PointFileError, match=r"a trajectory is as read_trajectory gives it, got"):
        sensor_origins(cloud, "tr.csv")
