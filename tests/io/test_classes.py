"""Which points are used, by their classes; and which noise lies lower than all around it."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError, write_points
from sklearn_mcmd.io._classes import Choice, LowestPoints, noise_classes

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


def are_above_literally(points, queries, n_usual):
    """Squares of all sides by dictionaries, from the finest that the points fill."""

    def squares(xyz, exponent):
        return [tuple(place) for place in np.floor(xyz[:, :2] / 2.0**exponent).astype(int)]

    for finest in range(-40, 40):
        if len(set(squares(points, finest))) <= max(1, len(points) // n_usual):
            break
    result = []
    for query in queries:
        lowest = points[:, 2].min()
        for exponent in range(finest, 40):
            there = np.array(
                [s == squares(query[None], exponent)[0] for s in squares(points, exponent)]
            )
            if there.sum() >= n_usual:
                lowest = points[there, 2].min()
                break
        result.append(query[2] < lowest)
    return np.array(result)


@pytest.mark.parametrize("middle", [0.0, -1e5, 362_000.3])
def test_low_is_what_lies_lower_than_all_in_its_square(middle):
    points = RNG.uniform(-40, 40, (400, 3)) * [1, 0.3, 0.05] + middle
    queries = RNG.uniform(-60, 60, (60, 3)) * [1, 1, 0.1] + middle
    queries[0] += 1e7
    lowest = LowestPoints(len(points), 8)
    lowest.add(points)
    expected = are_above_literally(points, queries, 8)
    assert 0 < expected.sum() < len(expected)
    assert_array_equal(lowest.are_above(queries), expected)


def test_few_points_all_around_the_origin_are_one_place():
    points = RNG.uniform(-1, 1, (150, 3))
    lowest = LowestPoints(len(points), 50)
    lowest.add(points)
    queries = points * [2, 2, 1.1]
    assert_array_equal(lowest.are_above(queries), queries[:, 2] < points[:, 2].min())


@pytest.mark.parametrize("n_parts", [1, 3, 40])
def test_neither_parts_nor_their_order_change_the_squares(n_parts):
    points = RNG.normal(0, [100, 20, 2], (2_000, 3))
    points[:40] *= 1e4
    queries = RNG.normal(0, [150, 30, 4], (300, 3))
    whole = LowestPoints(len(points), 20)
    whole.add(points)
    parted = LowestPoints(len(points), 20)
    for part in np.array_split(points[RNG.permutation(len(points))], n_parts):
        parted.add(part)
    assert parted.exponent == whole.exponent
    assert_array_equal(parted.are_above(queries), whole.are_above(queries))


def test_nothing_is_low_where_no_point_is_kept():
    lowest = LowestPoints(0, 50)
    lowest.add(np.empty((0, 3)))
    assert not lowest.are_above(np.eye(3)).any()


def test_noise_under_the_ground_is_low_and_that_over_it_or_under_a_roof_is_high():
    ground = RNG.uniform(0, 30, (4_000, 3)) * [1, 1, 0.001]
    roof = RNG.uniform(10, 20, (1_500, 3)) * [1, 1, 0] + [0, 0, 6]
    outliers = np.array([[5, 5, -2], [15, 15, -0.5], [5, 5, 9], [15, 15, 8], [15, 15, 3]])
    xyz = np.vstack([ground, roof, outliers])
    is_outlier = np.arange(len(xyz)) >= len(xyz) - 5
    used = np.ones(len(xyz), bool)
    classes = noise_classes(PointCloud(xyz), is_outlier, is_outlier, used, 50)
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
        found = noise_classes(cloud, is_outlier, is_outlier, used, 50)
        assert_array_equal(found[-3:], expected)
        # Ground that is not used counts as well.
        found = noise_classes(cloud, is_outlier, is_outlier, used & (classes != 2), 50)
        assert_array_equal(found[-3:], expected)


@pytest.mark.parametrize("noise", [np.array([7.0, 0, 0]), np.array([2, 0, 0]), np.array([7])])
def test_other_marks_than_classes_of_noise_are_refused(noise, tmp_path):
    with pytest.raises(ValueError, match="noise must be"):
        write_points(tmp_path / "a.csv", np.eye(3), noise=noise)
