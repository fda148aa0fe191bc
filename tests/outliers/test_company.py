"""Density: what keeps company among rejected points, and what only lies together by chance."""

import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.outliers._company import Company

K = 50
# Of k points on a surface that has one point in each square of side 1, on average: the mean
# distance of a disk's points from its center is two thirds of its radius.
USUAL = 2 / 3 * np.sqrt(K / np.pi)


def company(points, alone=None):
    alone = np.zeros(len(points), dtype=bool) if alone is None else alone
    return Company(points, K, 2 * K, alone)


def isolation(points, gap, spacing=USUAL):
    """Of the points in the middle, all as far from what is explained."""
    middle = points[np.linalg.norm(points, axis=1) < np.ptp(points, axis=0).max() / 4]
    m = len(middle)
    return np.median(company(points).isolation(middle, np.full(m, spacing), np.full(m, gap)))


def ball(density, radius, rng):
    points = rng.uniform(-radius, radius, (int(density * (2 * radius) ** 3), 3))
    return points[np.linalg.norm(points, axis=1) < radius]


def strip(density, length, rng):
    """Of a face one fourth as wide as long, with noise of a fifth of a spacing."""
    points = rng.uniform(-0.5, 0.5, (int(density * length**2 / 4), 3)) * [length, length / 4, 0]
    return points + rng.normal(0, 0.2, points.shape) * [0, 0, 1]


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_a_crown_as_dense_as_surfaces_keeps_company(rng):
    assert isolation(ball(1.0, 5, rng), gap=1) < 1


def test_a_sparse_ball_keeps_none(rng):
    # Spacing 4 times that of surfaces.
    assert isolation(ball(1 / 64, 20, rng), gap=1) > 1


def test_far_from_what_is_explained_points_need_closer_company(rng):
    points = ball(0.25, 8, rng)
    near, far = isolation(points, gap=1), isolation(points, gap=30)
    assert near < 1 < far


def test_a_strip_of_surface_may_be_sparser_than_a_ball(rng):
    # As far from their nearest companions: a strip is an object, a ball is not.
    flat = strip(1 / 8, 60, rng)
    round_ = ball(1 / 22, 12, rng)
    assert isolation(flat, gap=10) < 1 < isolation(round_, gap=10)


def test_what_lies_on_an_explained_surface_is_no_strip_of_its_own(rng):
    flat = strip(1 / 9, 60, rng)
    assert isolation(flat, gap=2) < 1 < isolation(flat, gap=1)


def test_a_small_group_is_no_company(rng):
    points = ball(1.0, 5, rng)
    lonely = company(points, np.ones(len(points), dtype=bool))
    gaps, usual = np.ones(len(points)), np.full(len(points), USUAL)
    assert_array_equal(lonely.isolation(points, usual, gaps), np.inf)


def test_a_few_points_are_no_company(rng):
    points = rng.normal(size=(8, 3))
    assert_array_equal(company(points).isolation(points, np.ones(8), np.ones(8)), np.inf)


def test_copies_of_one_point_around_are_nothing_to_compare_with(rng):
    points = ball(1.0, 5, rng)
    found = company(points).isolation(points, np.zeros(len(points)), np.ones(len(points)))
    assert_array_equal(found, np.inf)


def test_large_groups_are_looked_at_in_parts(rng):
    # All groups of 4,000 queries, of 1,000 points each, would be some 100 MB an array.
    points = rng.uniform(size=(4000, 3))
    lonely = Company(points, 500, 1000, np.zeros(len(points), dtype=bool))
    gaps, usual = np.zeros(len(points)), np.ones(len(points))
    expected = lonely.isolation(points[:50], usual[:50], gaps[:50])
    tracemalloc.start()
    found = lonely.isolation(points, usual, gaps)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30e6
    assert_array_equal(found[:50], expected)


@pytest.mark.parametrize("unit", [2.0**-300, 2.0**300])
def test_company_does_not_depend_on_units(rng, unit):
    points = ball(0.25, 8, rng)
    found = isolation(unit * points, gap=unit * 2, spacing=unit * USUAL)
    assert_allclose(found, isolation(points, gap=2), rtol=1e-12)


def test_points_on_one_line_keep_company(rng):
    points = rng.uniform(-40, 40, (80, 1)) * [1, 0, 0]
    assert isolation(points, gap=5) < 1
