"""A sensor with one position or many: scores and normals by tiles beside those in memory."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone

from benchmarks.simulators import make_lidar_turn, make_mobile_scan
from flights import flight, of
from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.io import PointCloud, Trajectory, read_points, sensor_origins, write_points
from sklearn_mcmd.io._sensor import place_words, rows_of_sensor
from sklearn_mcmd.tiling import _outliers, process_files
from tiled import values_of

DETECTOR = MCMDOutlierDetector(16, random_state=0)
NORMALS = RobustNormalEstimator(16, orientation="sensor", features="mean_curvature", random_state=0)


@pytest.fixture(scope="module")
def turn(tmp_path_factory):
    """A turn of a spinning sensor at the origin, in snow, with copies and echoes in one beam."""
    xyz = np.round(make_lidar_turn(4_000, snow=10.0, random_state=0).data, 3)
    xyz = np.vstack([xyz, xyz[:200], xyz[200:400] * 0.75])
    write_points(path := tmp_path_factory.mktemp("turn") / "a.las", PointCloud(xyz))
    return path


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A drive through a street, some places measured twice, and the way of the sensor."""
    scan = make_mobile_scan(4_000, random_state=0)
    xyz, times = np.round(scan.data, 3), scan.gps_time.copy()
    xyz[-60:], times[-60:] = xyz[:60], times[-60:]
    path = tmp_path_factory.mktemp("drive") / "a.las"
    write_points(path, PointCloud(xyz, {"gps_time": times}))
    return path, Trajectory(*scan.trajectory)


def scores_by_tiles(path, target, detector, **options):
    """Scores of a run by tiles, as files have them, which points are outliers, and the report."""
    report = process_files(path, target, detector, mode="mark", **options)
    paths = [target] if target.is_file() else sorted(target.iterdir())
    found = [read_points(one).attributes for one in paths]
    scores = np.concatenate([values["outlier_score"] for values in found])
    classes = np.concatenate([values["classification"] for values in found])
    return scores, np.isin(classes, (7, 18)), report


def assert_flags_are_nearly_those_of_memory(path, target, fitted, least=0, **options):
    """One tile has the scores of memory; returns the report of a run with several."""
    detector, is_outlier = clone(fitted), fitted.scores_ < fitted.offset_
    scores, flags, _ = scores_by_tiles(path, target, detector, **options)
    assert_array_equal(scores, -fitted.scores_.astype(np.float32))
    assert_array_equal(flags, is_outlier)
    _, flags, report = scores_by_tiles(path, target, detector, tile_size=1_200, **options)
    assert report.n_tiles > 3
    assert np.count_nonzero(is_outlier) >= least
    assert np.count_nonzero(flags != is_outlier) <= 0.25 * np.count_nonzero(is_outlier) + 2
    return report


@pytest.mark.parametrize(
    ("origin", "params"),
    [
        ("origin", {}),
        ([0.5, 0.0, -0.25], {"strictness": "isolated"}),
        ([300.0, 0.0, 20.0], {"contamination": 0.05}),
    ],
    ids=str,
)
def test_outliers_with_one_position_are_those_of_memory(turn, tmp_path, origin, params):
    fitted = clone(DETECTOR).set_params(sensor_origin=origin, **params).fit(read_points(turn).xyz)
    assert_flags_are_nearly_those_of_memory(turn, tmp_path / "b.las", fitted, 100)


@pytest.mark.parametrize("strictness", ["groups", None])
def test_a_turn_is_recognized_as_in_memory(tmp_path, strictness):
    path, xyz = tmp_path / "a.las", make_lidar_turn(4_000, random_state=0).data
    write_points(path, PointCloud(np.round(xyz[xyz.any(axis=1)], 3)))  # without silent rays
    detector = clone(DETECTOR).set_params(sensor_origin="auto", strictness=strictness)
    fitted = clone(detector).fit(read_points(path).xyz)
    words = "" if strictness is None else "0, 0, 0 (a turn about the origin)"
    assert (fitted.sensor_origin_ is None) == (strictness is None)
    report = assert_flags_are_nearly_those_of_memory(path, tmp_path / "b.las", fitted)
    assert report.sensor.get("sensor", "") == words


def test_intensity_with_rays_is_judged_as_in_memory(turn, tmp_path):
    xyz = np.unique(read_points(turn).xyz, axis=0)  # ranks of copies are those of memory nearly
    xyz = xyz[np.linalg.norm(xyz, axis=1) > 0.01]  # without silent rays
    light = np.random.default_rng(0).integers(0, 300, len(xyz)).astype(np.uint16)
    light[np.linalg.norm(xyz, axis=1) < 5] //= 3
    write_points(path := tmp_path / "a.las", PointCloud(xyz, {"intensity": light}))
    detector, xyz = clone(DETECTOR).set_params(sensor_origin="origin"), read_points(path).xyz
    fitted, without = (clone(detector).fit(xyz, intensity=given) for given in (light, None))
    assert (fitted.scores_ != without.scores_).any()
    assert_flags_are_nearly_those_of_memory(path, tmp_path / "b.las", fitted, 100, intensity=True)


def test_outliers_along_a_trajectory_are_those_of_memory(drive, tmp_path):
    path, trajectory = drive
    cloud = read_points(path)
    origins = sensor_origins(cloud, trajectory)
    fitted = clone(DETECTOR).fit(cloud.xyz, sensor_origin=origins)
    for given in (trajectory, origins):
        assert_flags_are_nearly_those_of_memory(
            path, tmp_path / "b.las", fitted, 30, sensor_origin=given
        )


def test_normals_look_at_where_the_sensor_was_for_each_copy_of_a_point(drive, tmp_path, by_tiles):
    path, trajectory = drive
    origins = sensor_origins(read_points(path), trajectory)
    fitted = clone(NORMALS).fit(read_points(path).xyz, sensor_origin=origins)
    values, proven, _, _ = by_tiles(path, NORMALS, tile_size=1_200, sensor_origin=trajectory)
    assert proven.mean() > 0.9
    assert_array_equal(values[proven], values_of(fitted)[proven])


def test_flight_lines_over_several_files_are_adjusted_together(tmp_path):
    xyz, _, given = flight(step=1.0)
    cloud = of(xyz, given)
    for name, rows in {"a": slice(0, 1_500), "b": slice(1_500, None)}.items():
        write_points(tmp_path / f"{name}.las", cloud.subset(rows))
    parts = [read_points(tmp_path / f"{name}.las") for name in "ab"]
    names = ("gps_time", "point_source_id", "scan_angle_rank")
    whole = PointCloud(
        np.vstack([part.xyz for part in parts]),
        {name: np.concatenate([part.attributes[name] for part in parts]) for name in names},
        {"las_header": parts[0].metadata["las_header"]},
    )
    origins = sensor_origins(whole)
    fitted = clone(DETECTOR).fit(whole.xyz, sensor_origin=origins)
    sources = [tmp_path / "a.las", tmp_path / "b.las"]
    assert_flags_are_nearly_those_of_memory(sources, tmp_path / "out", fitted, sensor_origin="auto")


def test_a_position_that_is_doubted_is_used_if_it_was_given_and_not_if_it_was_found(
    drive, tmp_path, monkeypatch
):
    xyz, _, given = flight(step=1.0)
    write_points(path := tmp_path / "a.las", of(xyz, given))
    monkeypatch.setattr(_outliers, "doubt_of", lambda *_: "it cannot be")
    fitted = clone(DETECTOR).fit(read_points(path).xyz)
    with pytest.warns(UserWarning, match="it cannot be. It is not used"):
        found = scores_by_tiles(path, tmp_path / "b.las", DETECTOR, sensor_origin="auto")
    assert_array_equal(found[0], -fitted.scores_.astype(np.float32))
    assert found[2].sensor == {"sensor": "not used", "doubt": "it cannot be"}


@pytest.mark.filterwarnings("ignore:.*outliers lie together")
def test_a_trajectory_along_the_ground_is_doubted_and_used_as_in_memory(drive, tmp_path):
    path, (times, positions) = tmp_path / "a.las", drive[1]
    write_points(path, cloud := read_points(drive[0]))
    low = Trajectory(times, positions * [1, 1, 0])
    origins = sensor_origins(cloud, low)
    with pytest.warns(UserWarning, match="would be sheets of rays"):
        fitted = clone(DETECTOR).fit(cloud.xyz, sensor_origin=origins)
    words = rows_of_sensor(
        place_words(origins, "trajectory"), fitted._cloud.ray_doubt, fitted.n_by_rays_
    )
    assert fitted.n_by_rays_ > 100
    for size in (None, 1_200):
        options = {"sensor_origin": low, "tile_size": size}
        with pytest.warns(UserWarning, match="would be sheets of rays"):
            report = scores_by_tiles(path, tmp_path / "b.las", DETECTOR, **options)[2]
        assert report.sensor.keys() == words.keys()
        assert size or report.sensor == words


@pytest.mark.parametrize(
    ("estimator", "given", "message"),
    [
        (DETECTOR, "here", "'here' must be 'auto'"),
        (DETECTOR, (0.0, 0.0, 10.0), r"shape \(n, 3\), got \(3,\); give one position"),
        (DETECTOR, np.full((4_400, 3), np.nan), "sensor_origin contains NaN"),
        (
            clone(DETECTOR).set_params(strictness=None),
            [[0, 0, 1.0]] * 4_400,
            "has no meaning where",
        ),
        (DETECTOR, np.zeros(3), r"shape \(n, 3\), got \(3,\)"),
        (DETECTOR, np.zeros((5, 3)), "has 5 positions, and the inputs have 4,400 points"),
        (DETECTOR, "auto", "no position of the sensor is known"),
        (DETECTOR, ([5.0, 6.0], np.zeros((2, 3))), "4,400 points were measured when there is no"),
        (clone(DETECTOR).set_params(sensor_origin="origin"), "auto", "given twice"),
        (clone(DETECTOR).set_params(sensor_origin=np.zeros((5, 3))), None, "is one position"),
        (RobustNormalEstimator(16, random_state=0), "auto", "orientation is not"),
        (NORMALS, None, "needs sensor_origin"),
        (SharpFeatureDetector(16, random_state=0), "auto", "no meaning for SharpFeatureDetector"),
    ],
    ids=str,
)
def test_wrong_positions_are_refused_and_nothing_is_left(turn, tmp_path, estimator, given, message):
    with pytest.raises(ValueError, match=message):
        process_files(turn, tmp_path / "b.las", estimator, sensor_origin=given)
    assert not list(tmp_path.iterdir())
