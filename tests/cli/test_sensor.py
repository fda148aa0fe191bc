"""Where the sensor stood, as options tell it."""

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from benchmarks.simulators import make_lidar_turn
from sklearn_mcmd.cli._sensor import Asked, intensity_of
from sklearn_mcmd.io import PointCloud, PointFileError, write_points
from sklearn_mcmd.tiling import Catalog

TIMED = PointCloud(np.eye(3), {"time": np.array([0.0, 1, 2])})
VIEWED = PointCloud(np.eye(3), {}, {"pcd_viewpoint": (1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0)})


def told(cloud, rows=slice(None), sensor=None, trajectory=None, recognize=False):
    """Positions for some points of a cloud, where these are in words, and what is doubted."""
    used = np.zeros(len(cloud), bool)
    used[rows] = True
    return Asked(Path("a.e57"), sensor, trajectory, recognize).of_rays(cloud, used)


@pytest.fixture(scope="module")
def setups():
    """Two turns, each about a position of its own, that a file states."""
    positions = np.array([[500.0, 0, 2], [530.0, 7, 2]])
    turn = make_lidar_turn(4_000, random_state=0).data
    index = np.repeat([0, 1], len(turn))
    cloud = PointCloud(np.vstack([turn, turn]) + positions[index], {"scan_index": index})
    cloud.metadata["sensor_origins"] = positions
    return cloud


@pytest.fixture
def path(tmp_path):
    (tmp_path / "path.csv").write_text("time,x,y,z\n0,0,0,5\n2,4,0,5\n")
    return tmp_path / "path.csv"


def test_what_options_tell_is_used_as_it_is(setups, path):
    positions, words, doubt = told(setups, sensor=(1.0, 2.0, 3.0))
    assert_array_equal(positions, [1, 2, 3])
    assert (words, doubt) == ("1, 2, 3 (given)", "")
    positions, words, _ = told(TIMED, slice(1, 3), trajectory=path)
    assert_array_equal(positions, [[2, 0, 5], [4, 0, 5]])
    assert words == "from 2, 0, 5 to 4, 0, 5 (trajectory)"
    assert told(setups) == told(TIMED, recognize=True) == (None, "", "")


@pytest.mark.parametrize(
    ("cloud", "sensor", "words"),
    [(TIMED, "auto", "no position of the sensor is known"), (VIEWED, None, "points have no times")],
)
def test_errors_name_the_file_of_the_points(cloud, sensor, words, path):
    with pytest.raises(PointFileError, match=rf"a\.e57: {words}"):
        told(cloud, sensor=sensor, trajectory=None if sensor else path)
    with pytest.raises(PointFileError, match=r"a\.las: no position .* only PCD's VIEWPOINT"):
        Asked(Path("a.las"), "auto", None).path()  # by tiles


@pytest.mark.parametrize("name", ["Intensity", "scalar_Intensity", "reflectance", "column_4"])
def test_intensity_goes_by_the_names_that_files_have_for_it(name):
    assert_array_equal(intensity_of("a", PointCloud(np.eye(3), {name: [1, 2, 4]})), [1, 2, 4])


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


def test_positions_that_a_file_states_are_used_where_points_look_measured_from_there(setups):
    half = slice(None, None, 2)
    stated = setups.metadata["sensor_origins"]
    positions, words, doubt = told(setups, half, recognize=True)
    assert_array_equal(positions, stated[setups.attributes["scan_index"]][half])
    assert words == "from 500, 0, 2 to 530, 7, 2 (poses of the scans)"
    assert doubt == ""
    one = setups.subset(slice(0, 4_000))
    one.attributes.pop("scan_index")
    one.metadata["sensor_origins"] = stated[:1]
    for asked in ({"recognize": True}, {"sensor": "auto"}):
        positions, words, _ = told(one, **asked)
        assert_array_equal(positions, [500, 0, 2])
        assert words == "500, 0, 2 (pose of the scan)"


def test_the_first_ten_of_many_scans_that_speak_against_their_positions_are_named():
    turn = make_lidar_turn(1_000, random_state=0).data
    index = np.repeat(np.arange(13), len(turn))
    cloud = PointCloud(np.vstack([turn] * 13), {"scan_index": index})
    cloud.metadata["sensor_origins"] = np.arange(1, 40).reshape(13, 3) / [1, 1, 20] + [2, 0, 0]
    with pytest.warns(UserWarning, match="do not look as if") as caught:
        told(cloud, recognize=True)
    named = re.search(r"points of scans ([\d, ]+) and (\d+) more", str(caught[0].message))
    assert len(named[1].split(", ")) == 10


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
    write_points(tmp_path / "near.las", PointCloud(X))
    write_points(tmp_path / "far.las", PointCloud(X + 5e5))
    for name, may_be in {"near.las": True, "far.las": False, ".": False}.items():
        asked = Asked(tmp_path / name, None, None, recognize=True)
        assert asked.may_be_known(Catalog(tmp_path / name)) == may_be
