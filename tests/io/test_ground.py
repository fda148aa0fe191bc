"""Heights over the ground."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError
from sklearn_mcmd.io._ground import Ground, ground_of, heights_over_ground

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_heights_are_over_the_three_nearest_ground_points(slope):
    plan, others = RNG.uniform(0, 40, (6_000, 2)), RNG.uniform(5, 35, (50, 3))
    xyz = np.vstack([np.column_stack([plan, slope * plan[:, 0]]), others])
    ground = np.arange(len(xyz)) < 6_000
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
