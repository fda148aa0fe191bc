"""A spinning lidar: its rings, the truth of its points, and where its outliers lie."""

from functools import cache

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree
from scipy.stats import kstest

from scenes import scanned
from sklearn_mcmd.datasets import make_lidar_turn
from sklearn_mcmd.datasets._sensor_outliers import SENSOR_OUTLIERS


def elevations(scan):
    ray = (scan.true_points - scan.sensor_origins)[scan.target == 1]
    return np.degrees(np.arcsin(ray[:, 2] / np.linalg.norm(ray, axis=1)))


def test_rays_leave_in_rings_of_equal_elevation():
    scan, _ = scanned("make_lidar_turn")
    rings = np.unique(np.round(elevations(scan), 6))
    assert_allclose(rings, np.linspace(-30.67, 10.67, 32), atol=1e-6)


def test_points_of_a_ring_lie_at_equal_steps_of_azimuth():
    scan, _ = scanned("make_lidar_turn")
    ray = (scan.true_points - scan.sensor_origins)[scan.target == 1]
    ring = np.round(elevations(scan), 6)
    azimuth = np.sort(np.arctan2(ray[:, 1], ray[:, 0])[ring == np.unique(ring)[5]])
    steps = np.diff(azimuth)
    step = np.median(steps)
    assert_allclose(steps / step, np.round(steps / step), atol=1e-6)


def test_rings_are_told_of_regular_points_and_of_outliers_on_beams():
    scan = make_lidar_turn(20_000, outlier_share=0.2, random_state=0)
    angles = np.linspace(-30.67, 10.67, 32)
    ray = np.where((scan.target == 1)[:, None], scan.true_points, scan.data)
    ranges = np.linalg.norm(ray, axis=1)
    assert scan.ring.dtype == np.int64
    no_return = scan.outlier_kind == scan.outlier_kind_names.index("no_return")
    assert_array_equal(ranges == 0, no_return)
    assert len(np.unique(scan.ring[no_return])) == 32
    ray, ranges, ring = ray[~no_return], ranges[~no_return], scan.ring[~no_return]
    off = np.abs(np.degrees(np.arcsin(ray[:, 2] / ranges))[:, None] - angles)
    own = off[np.arange(len(ring)), ring]
    regular = scan.target[~no_return] == 1
    ghost = scan.outlier_kind[~no_return] == scan.outlier_kind_names.index("ghost")
    assert own[regular].max() < 1e-9
    assert own[~regular & ~ghost].max() < 0.01
    assert_array_equal(ring[ghost], off[ghost].argmin(axis=1))


def test_true_points_stay_whatever_the_noise():
    usual, _ = scanned("make_lidar_turn")
    loud = make_lidar_turn(20_000, noise=0.03, random_state=0)
    for array in ("true_points", "normals", "outlier_kind"):
        assert_array_equal(usual[array], loud[array])


def test_noise_is_gaussian_along_the_ray_and_grows_with_the_range():
    scan, _ = scanned("make_lidar_turn")
    regular = scan.target == 1
    ray = (scan.true_points - scan.sensor_origins)[regular]
    ranges = np.linalg.norm(ray, axis=1)
    error = (scan.data - scan.true_points)[regular] / scan.noise_scale[regular, None]
    along = np.einsum("ij,ij->i", error, ray) / ranges
    assert kstest(along, "norm").pvalue > 1e-3
    assert_allclose(error - along[:, None] * ray / ranges[:, None], 0, atol=1e-9)
    expected = 0.01 * (1 + 3 * ranges / 100)
    assert_allclose(scan.noise_scale[regular], expected, rtol=1e-12)


def test_later_echoes_lie_behind_earlier_ones_on_one_ray():
    scan, world = scanned("make_lidar_turn")
    regular = scan.target == 1
    ray = (scan.true_points - scan.sensor_origins)[regular]
    ranges = np.linalg.norm(ray, axis=1)
    beam = np.column_stack([scan.sensor_origins[regular], ray / ranges[:, None]])
    _, beam = np.unique(np.round(beam, 9), axis=0, return_inverse=True)
    order = np.lexsort([ranges, beam.ravel()])
    same = np.diff(beam.ravel()[order]) == 0
    echo = scan.echo[regular][order]
    assert same.sum() > 20
    assert (np.diff(echo)[same] > 0).all()
    # A beam goes on only behind what lets it through.
    front = world.through[scan.surface[regular][order][:-1][same]]
    assert front.all()


@cache
def with_outliers():
    return scanned("make_lidar_turn", outlier_share=0.1, outlier_kinds=tuple(SENSOR_OUTLIERS))


def with_kind(kind):
    """A scan with outliers of all kinds, and which are of one."""
    scan, _ = with_outliers()
    return scan, scan.outlier_kind == scan.outlier_kind_names.index(kind)


def test_mixed_pixels_lie_between_what_neighboring_beams_meet():
    scan, mine = with_kind("mixed_pixel")
    ranges = np.linalg.norm(scan.data, axis=1)
    direction = scan.data / np.fmax(ranges, 1e-9)[:, None]  # some have no return
    regular = np.flatnonzero(scan.target == 1)
    near = cKDTree(direction[regular]).query(direction[mine], k=12)[1]
    near, ranges = ranges[regular[near]], ranges[mine]
    between = (near.min(axis=1) < ranges) & (ranges < near.max(axis=1))
    # A few edges are seen by beams whose echoes were lost at random.
    assert between.mean() > 0.97


def test_range_errors_are_5_to_20_spacings_before_or_behind_what_their_beam_meets():
    scan, mine = with_kind("range_error")
    regular = scan.data[scan.target == 1]
    spacing = cKDTree(regular).query(regular, k=9)[0][:, 1:].mean(axis=1)
    ray = scan.data - scan.sensor_origins
    ranges = np.linalg.norm(ray, axis=1)
    direction = ray / np.fmax(ranges, 1e-9)[:, None]
    true = scan.target == 1
    angle, near = cKDTree(direction[true]).query(direction[mine])
    own = angle < 1e-6
    off = np.abs(ranges[mine] - ranges[true][near])[own] / spacing[near[own]]
    assert own.mean() > 0.9
    assert 4 < np.quantile(off, 0.05) < np.quantile(off, 0.95) < 21


def test_ghosts_are_balls_of_at_least_ten_points():
    scan, mine = with_kind("ghost")
    regular, points = scan.data[scan.target == 1], scan.data[mine]
    unit = np.median(cKDTree(regular).query(regular, k=9)[0][:, 1:].mean(axis=1))
    company = cKDTree(points).query_ball_point(points, 6.5 * unit, return_length=True)
    assert company.min() >= 10


def test_half_the_particles_are_within_four_meters_of_a_spinning_lidar():
    scan, mine = with_kind("particle")
    ranges = np.linalg.norm((scan.data - scan.sensor_origins)[mine], axis=1)
    assert 2.8 < np.median(ranges) < 4
    assert ranges.max() > 8
