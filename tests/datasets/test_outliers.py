"""The kinds of outliers of a street: where they lie and how many they are."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial import cKDTree
from scipy.stats import kstest

from scenes import scene_of
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.datasets._outliers import cluster_sizes


def test_each_kind_of_outlier_has_its_equal_share():
    street = make_street(10_000, outlier_share=0.1003, random_state=6)
    assert_array_equal(np.bincount(street.outlier_kind), [8997, 251, 251, 251, 250])


def test_only_the_asked_kinds_are_made():
    street = make_street(2000, outlier_kinds=["ghost"], outlier_share=0.2, random_state=7)
    names = np.array(street.outlier_kind_names)[np.unique(street.outlier_kind)]
    assert_array_equal(names, ["regular", "ghost"])


def of_kind(street, kind):
    return street.data[street.outlier_kind == street.outlier_kind_names.index(kind)]


def test_gaussian_outliers_are_as_far_from_the_surfaces_as_their_law_says():
    street = make_street(
        30_000, noise=0, outlier_share=0.5, outlier_kinds=["gaussian"], random_state=8
    )
    points = of_kind(street, "gaussian")
    # Before the open road nothing else is near: |z| is half-normal with a scale of 0.2 m.
    above = points[(points[:, 1] > 0.8) & (points[:, 1] < 2.2)]
    above = above[np.abs(above[:, 0] - 2.5) < 1.5]
    height = scene_of(street).distance(above)
    assert len(above) > 1000
    assert np.median(height) == pytest.approx(0.2 * 0.6745, rel=0.08)
    assert height.max() < 1.1


def test_uniform_outliers_fill_the_bounding_box_evenly():
    street = make_street(
        10_000, noise=0, outlier_share=0.3, outlier_kinds=["uniform"], random_state=9
    )
    low, high = scene_of(street).bounds
    for column, a, b in zip(of_kind(street, "uniform").T, low, high, strict=True):
        assert kstest(column, "uniform", args=(a, b - a)).pvalue > 1e-3


def test_mixed_pixels_lie_behind_an_outline_and_before_a_background():
    street = make_street(10_000, outlier_kinds=["mixed_pixel"], random_state=10)
    scene = scene_of(street)
    scanner, points = street.sensor_origins[0], of_kind(street, "mixed_pixel")
    rng = np.random.default_rng(13)
    outlines = np.concatenate(
        [
            part.sample_outline(20_000, rng, scanner)
            for part in scene.parts
            if part.outline_length > 0
        ]
    )

    def direction(x):
        return (x - scanner) / np.linalg.norm(x - scanner, axis=1, keepdims=True)

    neighbors = cKDTree(direction(outlines)).query_ball_point(direction(points), 0.02)
    ranges = np.linalg.norm(outlines - scanner, axis=1)
    for point, found in zip(points, neighbors, strict=True):
        assert ranges[found].min() < np.linalg.norm(point - scanner)
    beyond = scanner + 4 * (points - scanner)
    meeting = scene.first_hit(beyond)
    assert (meeting > 0.25).all()
    assert np.isfinite(meeting).all()


def test_ghosts_are_dense_balls_off_the_surfaces():
    street = make_street(20_000, outlier_kinds=["ghost"], random_state=11)
    points = of_kind(street, "ghost")
    company = cKDTree(points).query_ball_point(points, 0.2, return_length=True)
    assert company.min() >= 10
    assert scene_of(street).distance(points).min() > 0.15 - 1e-9


@pytest.mark.parametrize("n", [10, 35, 52, 53, 70, 87, 88, 1234, 50_000])
def test_clusters_hold_10_to_60_points_and_all_together(n):
    for seed in range(5):
        sizes = cluster_sizes(n, np.random.default_rng(seed))
        assert sizes.sum() == n
        assert sizes.min() >= 10
        assert sizes.max() <= 60
