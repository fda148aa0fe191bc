"""Moments and medians of regions: exact in any order, and in any parts."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.segmentation import _parts, _region_sums
from sklearn_mcmd.segmentation._region_sums import (
    median_by_region,
    region_moments,
    relabeled,
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


def test_neither_order_nor_parts_nor_threads_change_a_bit(cloud, monkeypatch):
    points, labels, values = cloud
    expected = (
        *region_moments(points, labels, N_REGIONS),
        sums_by_region(values, labels, N_REGIONS),
    )
    weights = np.arange(len(labels)) % 5 + 1
    weighted = region_moments(points, labels, N_REGIONS, weights)
    for part in (2**18, 617):
        set_parts(monkeypatch, part)
        order = np.random.default_rng(part).permutation(len(labels))
        P, L = points[order], labels[order]
        found = (
            *region_moments(P, L, N_REGIONS, n_jobs=2),
            sums_by_region(values[order], L, N_REGIONS),
        )
        for a, b in zip(found, expected, strict=True):
            assert_array_equal(a, b)
        for a, b in zip(region_moments(P, L, N_REGIONS, weights[order]), weighted, strict=True):
            assert_array_equal(a, b)


def test_moments_are_those_of_each_region(cloud):
    points, labels, _ = cloud
    found = region_moments(points, labels, N_REGIONS)
    for region in range(N_REGIONS):
        own = points[labels == region]
        assert found.sizes[region] == len(own)
        if not len(own):
            continue
        assert_allclose(found.centroids[region], own.mean(axis=0), rtol=1e-15)
        assert_array_equal(found.low[region], own.min(axis=0))
        assert_array_equal(found.high[region], own.max(axis=0))
        gaps = own - own.mean(axis=0)
        expected = gaps.T @ gaps / len(own)
        assert_allclose(found.covariances[region], expected, atol=1e-12 * expected.max())


@pytest.mark.parametrize("part", [2**18, 999, 30, 1])
@pytest.mark.parametrize("samples", [64, 3, 1])
def test_medians_are_the_upper_ones_whatever_parts_are(cloud, part, samples, monkeypatch):
    _, labels, values = cloud
    labels = relabeled(labels.copy(), np.append(np.arange(N_REGIONS) // 2, -1))
    n_regions = labels.max() + 1
    values[labels == 1], values[labels == 2] = 0.5, np.rint(3 * values[labels == 2])
    monkeypatch.setattr(_region_sums, "SAMPLES", samples)
    set_parts(monkeypatch, part)
    found = median_by_region(values, labels, n_regions)
    for region in range(n_regions):
        own = np.sort(values[labels == region])
        assert found[region] == own[len(own) // 2]


def set_parts(monkeypatch, size):
    for module in (_parts, _region_sums):
        monkeypatch.setattr(module, "PART", size)
