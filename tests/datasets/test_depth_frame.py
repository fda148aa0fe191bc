"""Depth in steps that grow with its square."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from scenes import scanned
from sklearn_mcmd.datasets import make_depth_frame

AXIS = np.array([0.0, np.cos(np.radians(8)), -np.sin(np.radians(8))])


def test_depths_are_levels_whose_steps_grow_with_the_square_of_depth():
    step = 0.01  # not the default
    scan = make_depth_frame(20_000, step=step, random_state=0)
    depth = (scan.data - scan.sensor_origins) @ AXIS
    level = 1 / (step * depth)
    assert_allclose(level, np.round(level), atol=1e-9)
    levels = np.unique(np.round(depth, 9))
    middle = (levels[:-1] + levels[1:]) / 2
    near = np.diff(levels) < 1.5 * step * middle**2
    assert near.sum() > 20
    assert_allclose(np.diff(levels)[near] / middle[near] ** 2, step, rtol=2e-2)


def test_errors_have_the_stated_scale_and_are_alike_in_neighboring_pixels():
    scan, _ = scanned("make_depth_frame", 60_000, outlier_share=0.0)
    ray = scan.true_points - scan.sensor_origins
    ranges = np.linalg.norm(ray, axis=1)
    error = np.einsum("ij,ij->i", scan.data - scan.true_points, ray) / ranges / scan.noise_scale
    assert error.std() == pytest.approx(1, rel=0.06)
    assert abs(error.mean()) < 0.1
    # Pixels of one row, from left to right.
    depth = ray @ AXIS
    row = np.round(ray @ [0, AXIS[2], -AXIS[1]] / depth, 9)
    order = np.lexsort([ray[:, 0] / depth, row])
    same = np.diff(row[order]) == 0
    left, right = error[order][:-1][same], error[order][1:][same]
    assert 0.3 < np.corrcoef(left, right)[0, 1] < 0.7


def test_without_noise_rounding_moves_depths_by_half_a_step_at_most():
    scan = make_depth_frame(5000, noise=0.0, outlier_share=0, random_state=0)
    depth, true = ((p - scan.sensor_origins) @ AXIS for p in (scan.data, scan.true_points))
    assert np.abs(1 / depth - 1 / true).max() <= 0.5 * 0.0029 + 1e-12


def test_through_the_door_part_of_the_image_is_out_of_reach():
    scan, _ = scanned("make_depth_frame")
    ranges = np.linalg.norm(scan.data - scan.sensor_origins, axis=1)
    assert ranges[scan.target == 1].max() < 6.2


def test_the_step_is_positive():
    with pytest.raises(ValueError, match="'step' parameter"):
        make_depth_frame(100, step=0.0)
