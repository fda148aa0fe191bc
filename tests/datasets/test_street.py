"""The street: statistics against their laws, truth against brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.stats import kstest

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.datasets._street import _street
from sklearn_mcmd.datasets._surfaces import Foliage


@pytest.fixture(scope="module")
def street():
    return make_street(30_000, noise_growth=4, tree=True, random_state=0)


def test_points_without_noise_lie_on_the_surface_that_they_are_labelled_with(street):
    scene = _street(tree=True)
    assert_array_equal(street.sensor_origins, np.tile(scene.scanner, (30_000, 1)))
    for number, part in enumerate(scene.parts):
        mine = street.surface == number
        assert_allclose(part.distance(street.true_points[mine]), 0, atol=1e-9)
        lacks = isinstance(part, Foliage)
        edges = np.nan if lacks else part.edge_distance(street.true_points[mine])
        assert_array_equal(street.edge_distance[mine], edges)


def test_the_spacing_is_that_of_the_road_where_the_scanner_is_nearest():
    street = make_street(60_000, outlier_share=0, noise=0, random_state=4)
    x, y, _ = street.data[street.surface == 0].T
    # An open rectangle of the road, without shadows; the camber adds under 0.1 % of area.
    window = (x > 1) & (x < 4) & (y > 0.5) & (y < 2.5)
    expected = 2 * 3 / street.spacing**2
    assert window.sum() == pytest.approx(expected, abs=5 * np.sqrt(expected) + 0.01 * expected)


def test_noise_is_gaussian_and_grows_linearly_with_the_range(street):
    regular = street.target == 1
    noise = (street.data - street.true_points)[regular] / street.noise_scale[regular, None]
    for column in noise.T:
        assert kstest(column, "norm").pvalue > 1e-3
    ranges = np.linalg.norm(street.true_points[regular] - street.sensor_origins[regular], axis=1)
    scale = street.noise_scale[regular]
    # A straight line from 0.005 at the nearest point to nearly 0.02 at the farthest.
    slope, start = np.polyfit(ranges, scale, 1)
    assert_allclose(scale, start + slope * ranges, rtol=1e-6)
    assert scale.min() == pytest.approx(0.005, rel=0.02)
    assert 0.017 < scale.max() <= 0.02


def test_outliers_have_no_truth_and_keep_clear_of_all_surfaces(street):
    outlier = street.target == -1
    assert_array_equal(np.bincount(street.outlier_kind), [27_000, *4 * [750]])
    assert (street.surface[outlier] == -1).all()
    for name in ("normals", "true_points", "edge_distance"):
        assert np.isnan(street[name][outlier]).all()
    assert_array_equal(street.outlier_kind > 0, outlier)
    distance = _street(tree=True).distance(street.data[outlier])
    assert (distance > 4 * street.noise_scale[outlier]).all()
    assert 0 < outlier[:200].sum() < 60  # rows are shuffled


def test_normals_face_the_scanner_and_only_foliage_lacks_them_and_edges(street):
    foliage = street.surface == street.surface_names.index("foliage")
    assert foliage.sum() > 500
    has = (street.target == 1) & ~foliage
    for name in ("normals", "edge_distance"):
        lacks = np.isnan(street[name].reshape(len(has), -1)).any(axis=1)
        assert_array_equal(lacks, ~has)
    assert_allclose(np.linalg.norm(street.normals[has], axis=1), 1, rtol=1e-12)
    view = street.sensor_origins[has] - street.true_points[has]
    assert (np.einsum("ij,ij->i", street.normals[has], view) > 0).all()


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
    height = _street(tree=False).distance(above)
    assert len(above) > 1000
    assert np.median(height) == pytest.approx(0.2 * 0.6745, rel=0.08)
    assert height.max() < 1.1


def test_uniform_outliers_fill_the_bounding_box_evenly():
    street = make_street(
        10_000, noise=0, outlier_share=0.3, outlier_kinds=["uniform"], random_state=9
    )
    low, high = _street(tree=False).bounds
    for column, a, b in zip(of_kind(street, "uniform").T, low, high, strict=True):
        assert kstest(column, "uniform", args=(a, b - a)).pvalue > 1e-3


def test_mixed_pixels_lie_behind_an_outline_and_before_a_background():
    street = make_street(10_000, outlier_kinds=["mixed_pixel"], random_state=10)
    scene = _street(tree=False)
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


def test_scanned_points_lie_on_vertical_lines_of_equal_azimuth_at_equal_steps():
    cloud = make_street(20_000, sampling="scan_lines", noise=0, outlier_share=0, random_state=0)
    x, y, z = (cloud.data - cloud.sensor_origins[0]).T
    elevation = np.arctan2(z, np.hypot(x, y))
    for angle in (np.arctan2(y, x), elevation):
        levels = np.unique(np.round(angle, 9))
        steps = np.diff(levels)
        step = np.median(steps)
        assert len(levels) < 1500  # of 20 000 points
        assert_allclose(steps / step, np.round(steps / step), atol=1e-4)
    assert elevation.min() >= -np.radians(60)
