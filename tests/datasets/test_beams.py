"""Beams of some width: their echoes against brute force, and the truth of what they met."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import norm

from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.datasets._beams import MIXED
from sklearn_mcmd.datasets._scan import scan_lines
from sklearn_mcmd.datasets._scene import Scene
from sklearn_mcmd.datasets._street import _street
from sklearn_mcmd.datasets._surfaces import Cylinder, Patch, Soft, first_hits

WIDTH = 0.008


def test_ranges_at_an_outline_follow_the_energy_on_either_side():
    # A plate before a wall, seen by beams of all offsets from its upright side.
    plate = Patch("plate", (-3, 4, -1), (3, 0, 0), (0, 0, 2))
    wall = Patch("wall", (-3, 6, -1.5), (6, 0, 0), (0, 0, 3))
    scene, rng = Scene([plate, wall], scanner=(0, 0, 0)), np.random.default_rng(0)

    def noise_at(ranges):
        return np.full(len(ranges), 0.005)

    points, places, _, kind = scan_lines(scene, 40_000, rng, noise_at, WIDTH)
    x, y, z = points.T
    near = (np.abs(x / y) < WIDTH) & (np.abs(z / y) < 0.2)
    sideways, depth = (x / y)[near], y[near]
    share = norm.cdf(-sideways / (WIDTH / 4))  # of the energy, on the plate
    ranges = (share / 4 + (1 - share) / 6) / (share / 16 + (1 - share) / 36)
    assert near.sum() > 200
    assert len(np.unique(np.round(sideways, 9))) > 3
    assert np.abs(depth - ranges).max() < 0.25  # a step of one in 19 rays is up to 0.17 m
    assert np.abs(depth - ranges).mean() < 0.06
    mixed = (depth > 4.02) & (depth < 5.98)
    assert_array_equal(kind[near] == MIXED, mixed)
    assert_allclose(places[near][~mixed, 1], np.where(depth[~mixed] < 5, 4.0, 6.0))


@pytest.fixture(scope="module")
def street():
    parameters = {"tree": True, "outlier_share": 0.02, "outlier_kinds": ["ghost"]}
    return make_street(
        20_000, sampling="scan_lines", beam_divergence=WIDTH, random_state=1, **parameters
    )


def test_mixed_pixels_come_besides_those_that_are_asked_for(street):
    kinds = np.bincount(street.outlier_kind, minlength=5)
    names = street.outlier_kind_names
    assert kinds[names.index("ghost")] == 400
    assert kinds[names.index("mixed_pixel")] > 100
    assert_array_equal(street.outlier_kind > 0, street.target == -1)
    away = _street(tree=True).distance(street.data[street.target == -1])
    assert away.min() > 0  # but for their noise, mixed pixels are four deviations off
    outlier = street.target == -1
    assert_array_equal(street.surface == -1, outlier)
    for array in ("true_points", "edge_distance"):
        lacks = np.isnan(street[array].reshape(len(outlier), -1)).any(axis=1)
        assert lacks[outlier].all()


def test_ranges_of_a_street_are_those_of_many_random_rays(street):
    scene, rng = _street(tree=True), np.random.default_rng(0)
    solid = [part for part in scene.parts if not isinstance(part, Soft)]
    leaves = next(part for part in scene.parts if isinstance(part, Soft))
    mixed = street.outlier_kind == street.outlier_kind_names.index("mixed_pixel")
    away = np.linalg.norm(street.data - leaves.center, axis=1) > 1.5  # leaves stop rays by chance
    sample = np.concatenate(
        [
            rng.permutation(np.flatnonzero(chosen & away))[:n]
            for chosen, n in ((mixed, 60), (street.target == 1, 60))
        ]
    )
    ray = street.data[sample] - street.sensor_origins[sample]
    ranges = np.linalg.norm(ray, axis=1)
    mean, spread = np.empty((2, len(sample)))
    for i, axis in enumerate(ray / ranges[:, None]):
        ways = axis + rng.normal(0, WIDTH / 4, (1500, 3)) @ (np.eye(3) - np.outer(axis, axis))
        ends = street.sensor_origins[sample[i]] + 20 * ways
        met = 20 * np.min([p.hit(street.sensor_origins[sample[i]], ends) for p in solid], axis=0)
        met = met[np.isfinite(met)]
        mean[i], spread[i] = np.sum(1 / met) / np.sum(1 / met**2), np.ptp(met)
    error = np.abs(ranges - mean)
    assert (error < 0.1 * spread + 5 * street.noise_scale[sample]).mean() > 0.97
    assert np.median(error / street.noise_scale[sample]) < 3


def test_truth_is_that_of_the_surface_that_a_wide_beam_met(street):
    scene = _street(tree=True)
    for number, part in enumerate(scene.parts):
        mine = street.surface == number
        true = street.true_points[mine]
        assert_allclose(part.distance(true), 0, atol=1e-9)
        assert (part.distance(street.data[mine]) < 10 * street.noise_scale[mine]).all()
        if not isinstance(part, Soft):
            across = np.einsum("ij,ij->i", part.normals(true), street.normals[mine])
            assert_allclose(np.abs(across), 1, atol=1e-9)
            assert_allclose(street.edge_distance[mine], part.edge_distance(true), atol=1e-9)


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


def test_what_is_beside_the_axis_of_a_beam_is_met_by_its_other_rays():
    knob = Cylinder("knob", (10, 0.04, -0.01), (0, 0, 0.02), 0.01)
    ends = np.array([[20.0, 0, 0], [20, 0.08, 0]])  # the axis first
    _, met = first_hits([knob], np.zeros(3), ends, np.random.default_rng(0), bundle=2, apart=0.1)
    assert_array_equal(met, [-1, 0])
