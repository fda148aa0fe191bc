"""A sensor with one position or many: scores and normals by tiles beside those in memory."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone

from benchmarks.simulators import make_lidar_turn, make_mobile_scan
from sklearn_mcmd.io import PointCloud, Trajectory, read_points, sensor_origins
from sklearn_mcmd.io._sensor import place_words, rows_of_sensor
from sklearn_mcmd.tiling import _outliers
from tiled import ESTIMATOR, OUTLIERS, but, values_of, written


@pytest.fixture(scope="module")
def turn(tmp_path_factory):
    """A turn of a spinning sensor at the origin, in snow, with copies and echoes in one beam."""
    xyz = np.round(make_lidar_turn(4_000, outlier_share=0.05, random_state=0).data, 3)
    return written(tmp_path_factory.mktemp("turn"), [*xyz, *xyz[:200], *(xyz[200:400] * 0.75)])


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A drive through a street, some places measured twice, and the way of the sensor."""
    scan = make_mobile_scan(4_000, random_state=0)
    xyz, times = np.round(scan.data, 3), scan.gps_time.copy()
    xyz[-60:], times[-60:] = xyz[:60], times[-60:]
    path = written(tmp_path_factory.mktemp("drive"), PointCloud(xyz, {"gps_time": times}))
    return path, Trajectory(*scan.trajectory)


@pytest.fixture
def assert_nearly_memory(by_tiles):
    """A function that asserts that one tile has the scores of memory, to the last bit, and that
    several flag nearly the same points; returns the report of these."""

    def assert_flags(path, fitted, least=0, **options):
        is_outlier = fitted.scores_ < fitted.offset_
        assert np.count_nonzero(is_outlier) >= least
        for size in (None, 1_200):
            values, _, verb, report = by_tiles(path, clone(fitted), tile_size=size, **options)
            n_differ = np.count_nonzero((values[:, 0] > verb.cutoff) != is_outlier)
            assert report.n_outliers == np.count_nonzero(values[:, 0] > verb.cutoff)
            if size is None:
                assert_array_equal(values, values_of(fitted))
                assert n_differ == 0
        assert report.n_tiles > 3
        assert n_differ <= 0.25 * np.count_nonzero(is_outlier) + 2
        return report

    return assert_flags


@pytest.mark.parametrize(
    "params",
    [
        {"sensor_origin": "origin"},
        {"sensor_origin": [0.5, 0.0, -0.25], "strictness": "isolated"},
        {"sensor_origin": [300.0, 0.0, 20.0], "contamination": 0.05},
    ],
    ids=str,
)
def test_outliers_with_one_position_are_those_of_memory(turn, assert_nearly_memory, params):
    assert_nearly_memory(turn, but(OUTLIERS, **params).fit(read_points(turn).xyz), 100)


@pytest.mark.usefixtures("measured")
@pytest.mark.parametrize("strictness", ["groups", None])
def test_a_turn_is_recognized_as_in_memory(tmp_path, assert_nearly_memory, strictness):
    xyz = make_lidar_turn(4_000, random_state=0).data
    path = written(tmp_path, np.round(xyz[xyz.any(axis=1)], 3))  # without silent rays
    detector = but(OUTLIERS, sensor_origin="auto", strictness=strictness)
    fitted = detector.fit(read_points(path).xyz)
    words = "" if strictness is None else "0, 0, 0 (a turn about the origin)"
    assert (fitted.sensor_origin_ is None) == (strictness is None)
    assert assert_nearly_memory(path, fitted).sensor.get("sensor", "") == words


@pytest.mark.usefixtures("measured")
def test_intensity_with_rays_is_judged_as_in_memory(turn, tmp_path, assert_nearly_memory):
    xyz = np.unique(read_points(turn).xyz, axis=0)  # ranks of copies are those of memory nearly
    xyz = xyz[np.linalg.norm(xyz, axis=1) > 0.01]  # without silent rays
    light = np.random.default_rng(0).integers(0, 300, len(xyz)).astype(np.uint16)
    light[np.linalg.norm(xyz, axis=1) < 2.9] //= 3  # flakes: no ground is so near
    path = written(tmp_path, PointCloud(xyz, {"intensity": light}))
    detector, xyz = but(OUTLIERS, sensor_origin="origin"), read_points(path).xyz
    fitted, without = (clone(detector).fit(xyz, intensity=given) for given in (light, None))
    assert (fitted.scores_ != without.scores_).any()
    assert_nearly_memory(path, fitted, 100, intensity=True)


def test_outliers_along_a_trajectory_are_those_of_memory(drive, assert_nearly_memory):
    path, trajectory = drive
    cloud = read_points(path)
    origins = sensor_origins(cloud, trajectory)
    fitted = clone(OUTLIERS).fit(cloud.xyz, sensor_origin=origins)
    assert_nearly_memory(path, fitted, 30, sensor_origin=trajectory)


@pytest.mark.usefixtures("measured")
def test_normals_look_at_where_the_sensor_was_for_each_copy_of_a_point(drive, by_tiles):
    path, trajectory = drive
    estimator = but(ESTIMATOR, orientation="sensor", features="mean_curvature")
    origins = sensor_origins(read_points(path), trajectory)
    values, proven, _, _ = by_tiles(path, estimator, tile_size=1_200, sensor_origin=trajectory)
    fitted = estimator.fit(read_points(path).xyz, sensor_origin=origins)
    assert proven.mean() > 0.9
    assert_array_equal(values[proven], values_of(fitted)[proven])


def test_a_position_that_was_found_is_not_used_if_it_is_doubted(tmp_path, by_tiles, monkeypatch):
    xyz = make_lidar_turn(4_000, random_state=0).data
    path = written(tmp_path, np.round(xyz[xyz.any(axis=1)], 3))
    monkeypatch.setattr(_outliers, "doubt_of", lambda *_: "it cannot be")
    with pytest.warns(UserWarning, match="it cannot be. It is not used"):
        values, _, _, report = by_tiles(path, but(OUTLIERS, sensor_origin="auto"))
    assert_array_equal(values, values_of(clone(OUTLIERS).fit(read_points(path).xyz)))
    assert report.sensor == {"sensor": "not used", "doubt": "it cannot be"}


@pytest.mark.filterwarnings("ignore:.*outliers lie together")
def test_a_trajectory_along_the_ground_is_doubted_and_used_as_in_memory(drive, by_tiles):
    path, (times, positions) = drive
    cloud, low = read_points(path), Trajectory(times, positions * [1, 1, 0])
    origins = sensor_origins(cloud, low)
    with pytest.warns(UserWarning, match="would be sheets of rays"):
        fitted = clone(OUTLIERS).fit(cloud.xyz, sensor_origin=origins)
    where, n = place_words(origins, "trajectory"), fitted.n_by_rays_
    words = rows_of_sensor(where, fitted._cloud.ray_doubt, n)
    assert n > 100
    for size in (None, 1_200):
        with pytest.warns(UserWarning, match="would be sheets of rays"):
            *_, report = by_tiles(path, OUTLIERS, sensor_origin=low, tile_size=size)
        assert report.sensor.keys() == words.keys()
        assert size or report.sensor == words
