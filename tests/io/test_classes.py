"""Which points are used, by their classes; and which noise lies lower than all around it."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError
from sklearn_mcmd.io._classes import Choice, noise_classes
from sklearn_mcmd.outliers._lowest_points import LowestPoints

RNG = np.random.default_rng(0)


@pytest.fixture
def classified():
    classes = np.array([1, 2, 2, 6, 9, 2])
    withheld = np.array([0, 0, 1, 0, 0, 0])
    return PointCloud(
        np.eye(3)[[0, 1, 2, 0, 1, 2]], {"classification": classes, "withheld": withheld}
    )


@pytest.mark.parametrize(
    ("choice", "used"),
    [
        (Choice(), [1, 1, 0, 1, 1, 1]),
        (Choice(ignored=(6, 9)), [1, 1, 0, 0, 0, 1]),
        (Choice(only=(2, 6)), [0, 1, 0, 1, 0, 1]),
        (Choice(ignored=(2,), only=(2, 6)), [0, 0, 0, 1, 0, 0]),
    ],
)
def test_points_are_used_by_their_classes_unless_they_are_withheld(choice, used, classified):
    assert_array_equal(choice.of(classified), np.array(used, bool))


def test_a_cloud_without_classes_is_used_whole_unless_classes_are_asked_for():
    cloud = PointCloud(np.eye(3))
    assert Choice().of(cloud) is None
    with pytest.raises(PointFileError, match="has no classes"):
        Choice(ignored=(7,)).of(cloud)


def test_noise_under_the_ground_is_low_and_that_over_it_or_under_a_roof_is_high():
    ground = RNG.uniform(0, 30, (4_000, 3)) * [1, 1, 0.001]
    roof = RNG.uniform(10, 20, (1_500, 3)) * [1, 1, 0] + [0, 0, 6]
    outliers = np.array([[5, 5, -2], [15, 15, -0.5], [5, 5, 9], [15, 15, 8], [15, 15, 3]])
    xyz = np.vstack([ground, roof, outliers])
    is_outlier = np.arange(len(xyz)) >= len(xyz) - 5
    used = np.ones(len(xyz), bool)
    classes = noise_classes(
        PointCloud(xyz), is_outlier, is_outlier, used, LowestPoints(len(xyz), 50)
    )
    assert_array_equal(classes[-5:], [7, 7, 18, 18, 18])
    assert not classes[:-5].any()


def test_where_there_is_ground_low_noise_is_lower_than_the_ground_and_not_than_a_roof():
    ground = RNG.uniform(0, 30, (4_000, 3)) * [1, 1, 0.001]
    ground = ground[((ground[:, :2] < 10) | (ground[:, :2] > 20)).any(axis=1)]
    roof = RNG.uniform(10, 20, (1_500, 3)) * [1, 1, 0] + [0, 0, 6]
    outliers = np.array([[15, 15, 3], [15, 15, -2], [5, 5, -0.2]])
    xyz = np.vstack([ground, roof, outliers])
    is_outlier = np.arange(len(xyz)) >= len(xyz) - 3
    used = np.ones(len(xyz), bool)
    for ground_class, expected in ((2, [18, 7, 7]), (1, [7, 7, 7])):
        classes = np.repeat([ground_class, 6, 1], [len(ground), len(roof), 3])
        cloud = PointCloud(xyz, {"classification": classes})
        found = noise_classes(cloud, is_outlier, is_outlier, used, LowestPoints(len(xyz), 50))
        assert_array_equal(found[-3:], expected)
        # Ground that is not used counts as well.
        found = noise_classes(
            cloud, is_outlier, is_outlier, used & (classes != 2), LowestPoints(len(xyz), 50)
        )
        assert_array_equal(found[-3:], expected)
