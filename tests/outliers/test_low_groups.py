"""Groups that lie far below the ground."""

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io._ground import Ground
from sklearn_mcmd.outliers._groups import depths_of_groups

RNG = np.random.default_rng(0)


def on_ground(others, n=6_000):
    """Level ground of six points a square meter, others, and a mask of the ground."""
    ground = RNG.uniform(0, 40, (n, 3)) * [1, 1, 0]
    return np.vstack([ground, others]), np.arange(n + len(others)) < n


def test_a_dense_cluster_far_below_ground_is_deep_and_what_reaches_up_or_spreads_is_not():
    n = 800
    cluster = RNG.normal([20, 20, -9], 0.5, (n, 3))
    shaft = np.column_stack([RNG.normal([10, 10], 0.3, (n, 2)), RNG.uniform(-6, -0.1, n)])
    water = np.column_stack([RNG.uniform(0, 40, n), RNG.uniform(30, 40, n), np.full(n, -2.0)])
    beside = RNG.normal([60, 20, -3], 0.2, (n, 3))  # 20 m away from the ground
    xyz, ground = on_ground(np.vstack([cluster, shaft, water, beside]))
    depths = depths_of_groups(xyz, Ground(xyz[ground]), ~ground)
    assert not depths[ground].any()
    parts = depths[~ground].reshape(4, n)
    assert (parts[0] > 10).all()
    assert np.unique(parts[0]).size == 1
    assert (parts[1:3] < 1).all()
    assert not parts[3].any()


def test_points_that_are_no_candidates_are_in_no_group():
    xyz, ground = on_ground(RNG.normal([20, 20, -9], 0.5, (40, 3)))
    assert not depths_of_groups(xyz, Ground(xyz[ground]), ground).any()


def test_a_single_point_is_as_large_as_the_spacing_of_the_ground_over_it():
    xyz, ground = on_ground(np.array([[20.0, 20.0, -3.0]]))
    away = np.sort(np.linalg.norm(xyz[ground][:, :2] - [20, 20], axis=1))[2]
    assert_allclose(depths_of_groups(xyz, Ground(xyz[ground]), ~ground)[-1], 3 / away, rtol=1e-12)


def test_depths_do_not_depend_on_the_order_of_points():
    steps = RNG.integers(0, 8, (500, 3)) * [0.25, 0.25, 0.5] + [20, 20, -9]
    xyz, ground = on_ground(np.vstack([steps, steps[:50]]))
    order = RNG.permutation(len(xyz))
    depths = depths_of_groups(xyz, Ground(xyz[ground]), ~ground)
    assert depths.any()
    assert_array_equal(
        depths_of_groups(xyz[order], Ground(xyz[ground]), ~ground[order]), depths[order]
    )
