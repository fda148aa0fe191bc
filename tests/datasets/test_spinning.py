"""Rings whose spacing grows with the range."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from scenes import scanned
from sklearn_mcmd.datasets import make_lidar_turn


def elevations(scan):
    ray = (scan.true_points - scan.sensor_origins)[scan.target == 1]
    return np.degrees(np.arcsin(ray[:, 2] / np.linalg.norm(ray, axis=1)))


@pytest.mark.parametrize("n_rings", [16, 32])
def test_rays_leave_in_rings_of_equal_elevation(n_rings):
    scan = make_lidar_turn(20_000, n_rings=n_rings, outlier_share=0, random_state=0)
    rings = np.unique(np.round(elevations(scan), 6))
    assert_allclose(rings, np.linspace(-30.67, 10.67, n_rings), atol=1e-6)


def test_rings_on_the_ground_part_a_hundredfold():
    scan, _ = scanned("make_lidar_turn", 60_000)
    ground = scan.true_points[scan.classification == 0]
    rings = np.unique(np.round(np.hypot(ground[:, 0], ground[:, 1]), 3))
    gaps = np.diff(rings)
    gaps = gaps[gaps > 0.01]
    assert gaps[0] == pytest.approx(0.140, abs=0.002)  # of rings at 30.67 and 29.34 degrees
    assert gaps.max() / gaps[0] > 100


def test_points_of_a_ring_lie_at_equal_steps_of_azimuth():
    scan, _ = scanned("make_lidar_turn")
    ray = (scan.true_points - scan.sensor_origins)[scan.target == 1]
    ring = np.round(elevations(scan), 6)
    azimuth = np.sort(np.arctan2(ray[:, 1], ray[:, 0])[ring == np.unique(ring)[5]])
    steps = np.diff(azimuth)
    step = np.median(steps)
    assert_allclose(steps / step, np.round(steps / step), atol=1e-6)


def test_there_are_at_least_two_rings():
    with pytest.raises(ValueError, match="'n_rings' parameter"):
        make_lidar_turn(100, n_rings=1)


def test_the_sensor_is_the_origin_above_the_ground():
    scan, world = scanned("make_lidar_turn")
    assert_array_equal(scan.sensor_origins, 0.0)
    ground = scan.true_points[scan.classification == 0]
    assert_allclose(ground[:, 2], -1.5, atol=1e-12)
    assert world.distance(np.zeros((1, 3)))[0] == pytest.approx(1.5)


def test_rings_are_told_of_regular_points_and_of_outliers_on_beams():
    scan = make_lidar_turn(20_000, n_rings=16, outlier_share=0.2, random_state=0)
    angles = np.linspace(-30.67, 10.67, 16)
    ray = np.where((scan.target == 1)[:, None], scan.true_points, scan.data)
    ranges = np.linalg.norm(ray, axis=1)
    assert scan.ring.dtype == np.int64
    no_return = scan.outlier_kind == scan.outlier_kind_names.index("no_return")
    assert_array_equal(ranges == 0, no_return)
    assert len(np.unique(scan.ring[no_return])) == 16
    off = np.abs(np.degrees(np.arcsin(ray[:, 2][~no_return] / ranges[~no_return]))
                 - angles[scan.ring[~no_return]])  # fmt: skip
    regular = scan.target[~no_return] == 1
    assert off[regular].max() < 1e-9
    ghost = scan.outlier_kind[~no_return] == scan.outlier_kind_names.index("ghost")
    assert off[~regular & ~ghost].max() < 0.01
    assert (scan.ring[~no_return][ghost] == np.abs(
        np.degrees(np.arcsin(ray[:, 2] / np.where(ranges, ranges, 1)))[~no_return][ghost][:, None]
        - angles
    ).argmin(axis=1)).all()  # fmt: skip
