"""Classes that are asked for, and which noise lies lower than all around it."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError
from sklearn_mcmd.io._classes import Choice, noise_classes
from sklearn_mcmd.outliers._lowest_points import LowestPoints

RNG = np.random.default_rng(0)


def test_a_cloud_without_classes_is_used_whole_unless_classes_are_asked_for():
    cloud = PointCloud(np.eye(3))
    assert Choice().of(cloud) is None
    with pytest.raises(PointFileError, match="has no classes"):
        Choice(ignored=(7,)).of(cloud)


GROUND = RNG.uniform(0, 30, (4_000, 3)) * [1, 1, 0.001]
ROOF = RNG.uniform(10, 20, (1_500, 3)) * [1, 1, 0] + [0, 0, 6]
OPEN = GROUND[((GROUND[:, :2] < 10) | (GROUND[:, :2] > 20)).any(axis=1)]


@pytest.mark.parametrize(
    ("ground", "outliers", "ground_class", "expected"),
    [  # without classes all points count, and where there is ground, it counts alone
        (GROUND, [[5, 5, -2], [15, 15, -0.5], [5, 5, 9], [15, 15, 8], [15, 15, 3]], None, 2),
        (OPEN, [[15, 15, -2], [5, 5, -0.2], [15, 15, 3]], 2, 2),
        (OPEN, [[15, 15, -2], [5, 5, -0.2], [15, 15, 3]], 1, 3),
    ],
)
def test_low_noise_lies_lower_than_the_ground_or_all_around(
    ground, outliers, ground_class, expected
):
    xyz, attributes = np.vstack([ground, ROOF, outliers]), {}
    if ground_class:
        sizes = len(ground), len(ROOF), len(outliers)
        attributes["classification"] = np.repeat([ground_class, 6, 1], sizes)
    is_outlier = np.arange(len(xyz)) >= len(xyz) - len(outliers)
    used = np.ones(len(xyz), bool)
    if ground_class == 2:  # that is not used counts as well
        used &= attributes["classification"] != 2
    lowest = LowestPoints(len(xyz), 50)
    classes = noise_classes(PointCloud(xyz, attributes), is_outlier, used, lowest)
    assert_array_equal(
        classes[-len(outliers) :], [7] * expected + [18] * (len(outliers) - expected)
    )
    assert not classes[: -len(outliers)].any()
