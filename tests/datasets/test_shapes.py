"""Box and crown roof: what is said about their points against brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from sklearn_mcmd.datasets import make_box, make_crown_roof
from sklearn_mcmd.datasets._shapes import box_scene, crown_roof_scene

SCENES = {make_box: box_scene(0.1), make_crown_roof: crown_roof_scene()}


@pytest.mark.parametrize("make", SCENES)
def test_points_lie_on_surfaces_that_are_seen_and_outliers_off_them(make):
    cloud, scene = make(4000, outlier_share=0.2, noise=0.004, random_state=0), SCENES[make]
    for number, part in enumerate(scene.parts):
        assert_allclose(part.distance(cloud.true_points[cloud.surface == number]), 0, atol=1e-9)
    outlier = cloud.target == -1
    assert outlier.sum() == 800
    assert scene.visible(cloud.true_points[~outlier], tolerance=1e-6).all()
    view = cloud.sensor_origins[0] - cloud.true_points[~outlier]
    assert (np.einsum("ij,ij->i", cloud.normals[~outlier], view) > 0).all()
    assert_allclose(np.linalg.norm(cloud.normals[~outlier], axis=1), 1, rtol=1e-12)
    noise = (cloud.data - cloud.true_points)[~outlier]
    assert_allclose(noise.std(axis=0), 0.004, rtol=0.06)
    assert (scene.distance(cloud.data[outlier]) > 4 * 0.004).all()
    assert_array_equal(np.isnan(cloud.edge_distance), outlier)


def test_the_edge_distance_of_the_box_is_that_of_its_three_edges():
    box = make_box(2000, random_state=0)
    far = np.sort(1 - box.true_points, axis=1)  # the face's own coordinate is 1
    assert_allclose(far[:, 0], 0, atol=1e-12)
    assert_allclose(box.edge_distance, far[:, 1], atol=1e-12)


def test_the_edge_distance_of_the_roof_is_that_to_its_four_ridges():
    roof = make_crown_roof(2000, random_state=0)
    t = np.linspace(0, 1, 4001)[:, None]
    center = np.array([1, 1, 0.9])
    gables = np.array([(1, 0, 0.6), (2, 1, 0.6), (1, 2, 0.6), (0, 1, 0.6)])
    ridges = np.concatenate([center + t * (g - center) for g in gables])
    assert_allclose(roof.edge_distance, cKDTree(ridges).query(roof.true_points)[0], atol=2e-4)
