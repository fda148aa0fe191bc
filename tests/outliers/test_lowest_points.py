"""Which points lie lower than all around them, in squares in plan."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sklearn_mcmd.outliers._lowest_points import LowestPoints

RNG = np.random.default_rng(0)


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
