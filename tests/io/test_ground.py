"""Heights over the ground, and groups that lie far below it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError
from sklearn_mcmd.io._ground import Ground, depths_of_groups, ground_of, heights_over_ground

RNG = np.random.default_rng(0)


def on_ground(others, slope=0.0, n=6_000, side=40.0):
    """Ground of six points a square meter, others, and a mask of the ground."""
    plan = RNG.uniform(0, side, (n, 2))
    ground = np.column_stack([plan, slope * plan[:, 0]])
    return np.vstack([ground, others]), np.arange(n + len(others)) < n


@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_heights_are_over_the_three_nearest_ground_points(slope):
    others = RNG.uniform(5, 35, (50, 3))
    xyz, ground = on_ground(others, slope)
    heights = heights_over_ground(xyz, ground)[~ground]
    away = np.linalg.norm(xyz[ground][:, None, :2] - others[None, :, :2], axis=2)
    near = np.argsort(away, axis=0)[:3]
    assert_allclose(heights, others[:, 2] - xyz[ground, 2][near].mean(axis=0), rtol=1e-12)
    # The nearest three lie within a meter, so a slope moves heights by less.
    assert_allclose(heights, others[:, 2] - slope * others[:, 0], atol=slope * 1.0 + 1e-12)


def test_ground_is_class_2_unless_it_is_withheld():
    classes, withheld = np.array([2, 2, 1, 2, 2]), np.array([0, 1, 0, 0, 0])
    cloud = PointCloud(RNG.random((5, 3)), {"classification": classes, "withheld": withheld})
    assert_array_equal(ground_of(cloud), [True, False, False, True, True])
    with pytest.raises(PointFileError, match="fewer than 3 points have the class 2"):
        ground_of(cloud.subset(slice(0, 3)))


def test_a_dense_cluster_far_below_ground_is_deep_and_what_reaches_up_or_spreads_is_not():
    n = 800
    cluster = RNG.normal([20, 20, -9], 0.5, (n, 3))
    shaft = np.column_stack([RNG.normal([10, 10], 0.3, (n, 2)), RNG.uniform(-6, -0.1, n)])
    water = np.column_stack([RNG.uniform(0, 40, n), RNG.uniform(30, 40, n), np.full(n, -2.0)])
    beside = RNG.normal([60, 20, -3], 0.2, (n, 3))  # 20 m away from the ground
    xyz, ground = on_ground(np.vstack([cluster, shaft, water, beside]))
    depths = depths_of_groups(xyz, ground, ~ground)
    assert not depths[ground].any()
    parts = depths[~ground].reshape(4, n)
    assert (parts[0] > 10).all()
    assert np.unique(parts[0]).size == 1
    assert (parts[1:3] < 1).all()
    assert not parts[3].any()


def test_points_that_are_no_candidates_are_in_no_group():
    xyz, ground = on_ground(RNG.normal([20, 20, -9], 0.5, (40, 3)))
    assert not depths_of_groups(xyz, ground, ground).any()


def test_a_single_point_is_as_large_as_the_spacing_of_the_ground_over_it():
    xyz, ground = on_ground(np.array([[20.0, 20.0, -3.0]]))
    away = np.sort(np.linalg.norm(xyz[ground][:, :2] - [20, 20], axis=1))[2]
    assert_allclose(depths_of_groups(xyz, ground, ~ground)[-1], 3 / away, rtol=1e-12)


def test_of_equally_distant_ground_points_the_lowest_count_in_any_order():
    plan = np.indices((12, 12)).reshape(2, -1).T.astype(float)
    ground = np.column_stack([np.tile(plan, (5, 1)), RNG.random(5 * len(plan))])
    queries = np.column_stack([RNG.integers(0, 23, (400, 2)) / 2, RNG.random(400)])
    away = np.linalg.norm(ground[:, None, :2] - queries[None, :, :2], axis=2)
    order = np.lexsort((np.broadcast_to(ground[:, 2, None], away.shape), away), axis=0)[:3]
    for rows in (slice(None), RNG.permutation(len(ground))):
        distances, heights = Ground(ground[rows]).nearest(queries)
        assert_allclose(distances, np.take_along_axis(away, order, axis=0).T, rtol=1e-15)
        assert_array_equal(heights, ground[order, 2].T)


def test_depths_do_not_depend_on_the_order_of_points():
    steps = RNG.integers(0, 8, (500, 3)) * [0.25, 0.25, 0.5] + [20, 20, -9]
    xyz, ground = on_ground(np.vstack([steps, steps[:50]]))
    order = RNG.permutation(len(xyz))
    depths = depths_of_groups(xyz, ground, ~ground)
    assert depths.any()
    assert_array_equal(depths_of_groups(xyz[order], ground[order], ~ground[order]), depths[order])
