"""Moments and medians of regions: exact in any order."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal, assert_equal

from sklearn_mcmd.segmentation._region_sums import (
    median_by_region,
    region_moments,
    sums_by_region,
)

N_REGIONS = 40


@pytest.fixture
def cloud():
    """Regions of one to many points, of sizes from millimeters to kilometers."""
    rng = np.random.default_rng(0)
    n = 5_000
    labels = rng.integers(-1, N_REGIONS - 1, n).astype(np.int32) // rng.integers(1, 4, n)
    labels[7] = N_REGIONS - 1
    size = 10.0 ** rng.uniform(-3, 3, N_REGIONS + 1)
    points = rng.normal(size=(n, 3)) * size[labels][:, None] * [1, 1, 1e-3] + [4e5, 5e6, 100]
    return points, labels, rng.uniform(0, 1, n)


def test_the_order_of_points_changes_no_bit(cloud):
    points, labels, values = cloud
    weights = np.arange(len(labels)) % 5 + 1

    def sums(order):
        P, L = points[order], labels[order]
        yield from region_moments(P, L, N_REGIONS)
        yield from region_moments(P, L, N_REGIONS, weights[order])
        yield sums_by_region(values[order], L, N_REGIONS)

    order = np.arange(len(labels))
    for _ in range(3):
        again = np.random.default_rng(0).permutation(order)
        for first, other in zip(sums(order), sums(again), strict=True):
            assert_array_equal(first, other)


def test_copies_count_as_often_as_they_are_there(cloud):
    points, labels, _ = cloud
    weights = np.arange(len(labels)) % 5 + 1
    weighted = region_moments(points, labels, N_REGIONS, weights)
    order = np.repeat(np.arange(len(labels)), weights)
    repeated = region_moments(points[order], labels[order], N_REGIONS)
    assert_array_equal(weighted.sizes, repeated.sizes)
    assert_allclose(weighted.centroids, repeated.centroids, rtol=1e-15)
    assert_allclose(weighted.covariances, repeated.covariances, rtol=1e-9)


def test_medians_are_the_upper_ones(cloud):
    _, labels, values = cloud
    values[labels == 1], values[labels == 2] = 0.5, np.rint(3 * values[labels == 2])
    medians = median_by_region(values, labels, N_REGIONS)
    for region in range(N_REGIONS):
        own = np.sort(values[labels == region])
        assert_equal(medians[region], own[len(own) // 2] if len(own) else np.nan)
