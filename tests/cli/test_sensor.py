"""Where the sensor stood, as options tell it."""

import numpy as np
import pytest
import typer
from numpy.testing import assert_array_equal

from commands import error_line, run
from sklearn_mcmd.cli._sensor import (
    _position,
    _scans,
    check_one_position,
    intensity_of,
    sensor_of_options,
    sensor_of_rays,
    work_if_seen,
)
from sklearn_mcmd.datasets import make_lidar_turn
from sklearn_mcmd.io import PointCloud, PointFileError, read_points, write_points

TIMED = PointCloud(np.eye(3), {"time": np.array([0.0, 1, 2])})
VIEWED = PointCloud(np.eye(3), {}, {"pcd_viewpoint": (1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0)})


def test_a_position_is_three_numbers_or_auto():
    assert _position("auto") == "auto"
    assert _position("0,-1.5, 2e3") == (0.0, -1.5, 2000.0)


@pytest.mark.parametrize("text", ["", "1,2", "1,2,3,4", "1,2,x", "0,0,nan", "origin"])
def test_other_positions_are_wrong_usage(text):
    with pytest.raises(typer.BadParameter, match="is neither auto nor a position, such as 0,0,0"):
        _position(text)


def test_options_tell_one_position_or_one_for_each_point_or_none(setups, tmp_path):
    (tmp_path / "path.csv").write_text("time,x,y,z\n0,0,0,5\n2,4,0,5\n")
    assert sensor_of_options("a.e57", setups, None, None) == (None, "", "")
    found, words, _ = sensor_of_options("a.e57", setups, (4.0, 5.0, 6.0), None)
    assert_array_equal(found, [4, 5, 6])
    assert words == "given"
    found, words, _ = sensor_of_options("a.e57", setups, "auto", None)
    assert_array_equal(found, setups.metadata["sensor_origins"][setups.attributes["scan_index"]])
    assert words == "poses of the scans"
    found, words, _ = sensor_of_options("a.csv", TIMED, None, tmp_path / "path.csv")
    assert_array_equal(found, [[0, 0, 5], [2, 0, 5], [4, 0, 5]])
    assert words == "trajectory"


def test_a_position_and_a_trajectory_are_wrong_usage(tmp_path):
    with pytest.raises(typer.BadParameter, match="exclude each other"):
        check_one_position((0.0, 0.0, 0.0), tmp_path / "path.csv")


def test_errors_name_the_file_of_the_points(tmp_path):
    with pytest.raises(PointFileError, match=r"a\.csv: no position of the sensor is known"):
        sensor_of_options("a.csv", TIMED, "auto", None)
    (tmp_path / "path.csv").write_text("time,x,y,z\n0,0,0,5\n2,4,0,5\n")
    with pytest.raises(PointFileError, match=r"a\.pcd: points have no times"):
        sensor_of_options("a.pcd", VIEWED, None, tmp_path / "path.csv")


@pytest.mark.parametrize(
    ("extension", "extra"),
    [("laz", "laspy"), ("pcd", "pypcd4"), ("ply", "plyfile"), ("e57", "pye57"), ("csv", None),
     ("npz", None)],
)  # fmt: skip
def test_formats_keep_intensity(extension, extra, tmp_path):
    if extra:
        pytest.importorskip(extra)
    path, light = tmp_path / f"a.{extension}", np.array([3, 250, 17], np.uint16)
    write_points(path, PointCloud(np.eye(3), {"intensity": light}))
    assert_array_equal(intensity_of(path, read_points(path)), light)


def test_intensity_goes_by_the_names_that_files_have_for_it(tmp_path):
    for name in ("Intensity", "scalar_Intensity", "reflectance", "column_4"):
        assert_array_equal(intensity_of("a", PointCloud(np.eye(3), {name: [1, 2, 4]})), [1, 2, 4])
    np.save(tmp_path / "kitti.npy", np.column_stack([np.eye(3), [0.1, 0.2, 0.4]]))
    table = read_points(tmp_path / "kitti.npy")
    assert_array_equal(intensity_of("kitti.npy", table), [0.1, 0.2, 0.4])


@pytest.mark.parametrize(
    "attributes",
    [
        {},
        {"time": [1, 2, 3]},
        {"column_4": [1, 2, 3], "column_5": [1, 2, 3]},
        {"intensity": [0] * 3},
    ],
)
def test_a_file_without_intensity_is_named(attributes):
    with pytest.raises(ValueError, match=r"a\.las: --intensity: the file has none, or the same"):
        intensity_of("a.las", PointCloud(np.eye(3), attributes))


def told(cloud, rows=slice(None), **options):
    used = np.zeros(len(cloud), bool)
    used[rows] = True
    return sensor_of_rays("a.e57", cloud, used, **options)


@pytest.fixture(scope="module")
def setups():
    """Two turns, each about a position of its own, that a file states."""
    positions = np.array([[500.0, 0, 2], [530.0, 7, 2]])
    turn = make_lidar_turn(4_000, random_state=0).data
    index = np.repeat([0, 1], len(turn))
    cloud = PointCloud(np.vstack([turn, turn]) + positions[index], {"scan_index": index})
    cloud.metadata["sensor_origins"] = positions
    return cloud


def test_positions_that_a_file_states_are_used_where_points_look_measured_from_there(setups):
    half = slice(None, None, 2)
    positions, words, doubt = told(setups, half, recognize=True)
    assert_array_equal(
        positions, setups.metadata["sensor_origins"][setups.attributes["scan_index"]][half]
    )
    assert words == "from 500, 0, 2 to 530, 7, 2 (poses of the scans)"
    assert doubt == ""
    one = setups.subset(slice(0, 4_000))
    one.attributes.pop("scan_index")
    one.metadata["sensor_origins"] = setups.metadata["sensor_origins"][:1]
    for asked in ({"recognize": True}, {"sensor": "auto"}):
        positions, words, _ = told(one, **asked)
        assert_array_equal(positions, [500, 0, 2])
        assert words == "500, 0, 2 (pose of the scan)"


def test_other_positions_that_a_file_states_are_not_used_and_the_line_says_so(setups):
    wrong = PointCloud(
        setups.xyz, setups.attributes, {"sensor_origins": [[500, 0, 2], [530, 7, 0]]}
    )
    line = (
        r"a\.e57: .* was from 500, 0, 0 to 530, 7, 2 \(poses of the scans\), but points of scan 2 "
        r"do not look .* is not used; give --sensor X,Y,Z if it is right; --sensor none is"
    )
    wrong.metadata["sensor_origins"] = [[500, 0, 2], [530, 7, 0]]
    for asked in ({"recognize": True}, {"sensor": "auto"}):
        with pytest.warns(UserWarning, match=line):
            positions, words, doubt = told(wrong, **asked)
        assert (positions, words) == (None, "")
        assert doubt.startswith("the file says that the sensor was from")


def test_a_setup_that_cannot_be_asked_has_no_vote(setups):
    """Five points of the second setup; and only those. Points far from it, and only those."""
    few = setups.subset(np.arange(len(setups)) < 4_005)
    far = PointCloud(setups.xyz.copy(), setups.attributes, setups.metadata)
    far.xyz[4_000:] += [0, 0, 9_000]
    for cloud, why in ((few, "too few points can be asked"), (far, "that is too far away to be")):
        positions, _, doubt = told(cloud, recognize=True)
        assert doubt == ""
        assert_array_equal(np.unique(positions, axis=0), setups.metadata["sensor_origins"])
        with pytest.warns(UserWarning, match=rf"was at 530, 7, 2 .*, but {why}"):
            assert told(cloud, slice(4_000, None), recognize=True)[0] is None


def test_scans_that_speak_against_their_positions_are_named_by_number_the_first_ten():
    assert _scans([3]) == "of scan 3 "
    assert _scans(range(2, 5)) == "of scans 2, 3, 4 "
    assert _scans(range(1, 14)) == "of scans 1, 2, 3, 4, 5, 6, 7, 8, 9, 10 and 3 more "


def test_what_options_tell_is_used_as_it_is(setups, tmp_path):
    positions, words, doubt = told(setups, sensor=(1.0, 2.0, 3.0))
    assert_array_equal(positions, [1, 2, 3])
    assert (words, doubt) == ("1, 2, 3 (given)", "")
    (tmp_path / "path.csv").write_text("time,x,y,z\n0,0,0,5\n2,4,0,5\n")
    positions, words, _ = told(TIMED, slice(1, 3), trajectory=tmp_path / "path.csv")
    assert_array_equal(positions, [[2, 0, 5], [4, 0, 5]])
    assert words == "from 2, 0, 5 to 4, 0, 5 (trajectory)"
    assert told(setups) == told(TIMED, recognize=True) == (None, "", "")
    with pytest.raises(PointFileError, match="no position of the sensor is known"):
        told(TIMED, sensor="auto")


def test_where_the_statement_is_wrong_the_origin_may_be_right():
    turn = make_lidar_turn(4_000, random_state=0).data
    cloud = PointCloud(turn, {}, {"pcd_viewpoint": (9.0, 9.0, 1.0, 1.0, 0.0, 0.0, 0.0)})
    with pytest.warns(UserWarning, match="9, 9, 1 .PCD's VIEWPOINT., but points do not"):
        positions, words, _ = told(cloud, recognize=True)
    assert_array_equal(positions, [0, 0, 0])
    assert words == "0, 0, 0 (a turn about the origin)"


def test_a_file_that_may_be_recognized_is_planned_with_rays(tmp_path):
    """Its bounds hold the origin, or are near it; those of national coordinates do not."""
    X = np.random.default_rng(0).random((50, 3))
    for name, shift, work in (("near.las", 0, "outliers, rays"), ("far.las", 5e5, "outliers")):
        write_points(tmp_path / name, PointCloud(X + shift))
        assert work_if_seen("outliers", tmp_path / name) == work
    assert work_if_seen("outliers", tmp_path) == "outliers"
    (tmp_path / "bad.las").write_bytes(b"LASF")
    assert work_if_seen("outliers", tmp_path / "bad.las") == "outliers"


@pytest.mark.parametrize("options", [("--intensity",), ("--sensor", "0,0,9")])
def test_the_strictness_of_the_paper_has_no_use_for_beams(tmp_path, options):
    cloud = PointCloud(np.random.default_rng(0).uniform(size=(99, 3)), {"intensity": np.arange(99)})
    write_points(tmp_path / "a.las", cloud)
    args = ("denoise", tmp_path / "a.las", tmp_path / "b.las", "--strictness", "paper", *options)
    line = error_line(run(*args))
    told = f"give a --strictness other than the paper's, or leave {options[0]} out"
    assert line.rstrip(".").endswith(told)
