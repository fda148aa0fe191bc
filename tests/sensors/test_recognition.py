"""Clouds that were taken from the origin are recognized, and no others."""

import numpy as np
import pytest

from benchmarks.simulators import (
    make_airborne_scan,
    make_depth_frame,
    make_lidar_turn,
    make_mobile_scan,
)
from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_box, make_street
from sklearn_mcmd.sensors import _recognition
from sklearn_mcmd.sensors._recognition import view_from_origin, views_from_setups


def seen(points):
    return view_from_origin(lambda: [points])


def grid(n=60):
    return np.stack(np.meshgrid(*[np.linspace(-1, 1, n)] * 2), axis=-1).reshape(-1, 2)


def sphere(n=4_000):
    """Points at even steps, none nearer to the middle than others."""
    turns, z = np.arange(n) * np.pi * (3 - np.sqrt(5)), (2 * np.arange(n) + 1) / n - 1
    return np.column_stack([np.cos(turns), np.sin(turns), z]) * np.sqrt(
        np.column_stack([1 - z**2, 1 - z**2, np.ones(n)])
    )


def of_first(scan):
    return scan.data - scan.sensor_origins[0]


def cylinder():
    turns, height = np.pi * grid()[:, 0], 2 * grid()[:, 1]
    return np.column_stack([np.cos(turns), np.sin(turns), height])


def rough_globe():
    """A body around the origin whose points lie on meridians, at even steps of angle."""
    turns, down = np.meshgrid(
        np.linspace(0, 2 * np.pi, 120, endpoint=False), np.linspace(0.1, 3, 60)
    )
    turns, down = turns.ravel(), down.ravel()
    level = np.cos(turns) * np.sin(down), np.sin(turns) * np.sin(down)
    rough = np.random.default_rng(0).uniform(1, 1.3, (turns.size, 1))
    return np.column_stack([*level, np.cos(down)]) * rough


@pytest.fixture(scope="module")
def turn():
    return make_lidar_turn(8_000, random_state=0).data


def test_turns_are_recognized(turn):
    words = seen(turn)
    assert words == "a turn about the origin"
    for share in (0.0, 0.2):
        cloud = make_lidar_turn(8_000, outlier_share=share, random_state=1).data
        assert seen(cloud) == words


@pytest.mark.parametrize("share", [0.3, 0.8])
def test_returns_from_the_sensor_itself_hide_no_turn(turn, share):
    rng = np.random.default_rng(1)
    near = rng.normal(size=(int(share * len(turn)), 3))
    near *= rng.uniform(0.1, 0.3, (len(near), 1)) / np.linalg.norm(near, axis=1, keepdims=True)
    assert seen(np.vstack([turn, near])) == "a turn about the origin"


@pytest.mark.parametrize("name", ["turn_04", pytest.param("turn_06", marks=pytest.mark.slow)])
def test_turns_of_a_moving_car_are_recognized(shared_data, name):
    """They were rectified: from beside the origin steps are as even."""
    with np.load(shared_data / "spinning_turns_labelled" / f"{name}.npz") as arrays:
        cloud = arrays["xyz"].astype(float)
    assert seen(cloud) == "a turn about the origin"
    assert seen(cloud + np.array([0, 0, 2])) == ""


def test_depth_frames_are_recognized():
    frame = make_depth_frame(10_000, step=0.009, random_state=0)
    cloud = frame.data - frame.sensor_origins[0]
    assert seen(cloud) == "a view from the origin"
    assert seen(frame.data) == ""


@pytest.mark.parametrize(
    "moved", [(1, 0, 0), (0, 0, 1), (0, 0, -5), (0.6, -0.6, 0.6), (10, 0, 0), (0, 0, 1000)], ids=str
)
def test_turns_are_not_recognized_from_beside_the_sensor(turn, moved):
    assert seen(turn + np.array(moved, float)) == ""


NEVER = {
    "street": lambda: make_street(8_000, random_state=0).data,
    "drive": lambda: make_mobile_scan(8_000, random_state=0).data,
    "drive, where it begins": lambda: of_first(make_mobile_scan(8_000, random_state=0)),
    "flights": lambda: make_airborne_scan(8_000, random_state=0).data,
    "box": lambda: make_box(4_000, random_state=0).data - 0.5,
    "plane": lambda: np.insert(grid(), 2, 1.0, axis=1),
    "plane, edge on": lambda: np.insert(grid(), 2, 0.0, axis=1),
    "lattice": lambda: np.stack(np.meshgrid(*[np.arange(-8.0, 9)] * 3), axis=-1).reshape(-1, 3),
    "plane in steps, far away": lambda: np.round(np.insert(grid(), 2, 0.0, axis=1), 2) + 577.0,
    "terrain": lambda: np.insert(8 * grid(), 2, np.sin(4 * grid()[:, 0]) - 3, axis=1),
    "cylinder": cylinder,
    "sphere": sphere,
    "ellipsoid": lambda: sphere() * [1, 1.5, 2],
    "globe": rough_globe,
    "volume": lambda: np.random.default_rng(0).uniform(-1, 1, (4_000, 3)),
    "normal": lambda: np.random.default_rng(0).normal(size=(300, 3)),
    "copies": lambda: np.ones((50, 3)),
    "line": lambda: np.outer(np.arange(50.0), [1, 2, 3]),
    "at the origin": lambda: np.zeros((50, 3)),
    "few": lambda: np.eye(3),
}


@pytest.mark.parametrize("cloud", NEVER)
def test_no_other_clouds_are_recognized(cloud):
    points = NEVER[cloud]()
    assert seen(points) == seen(points[::-1]) == ""


def test_what_a_file_states_is_believed_where_the_cloud_looks_measured_from_there(turn):
    """A turn that is told half a meter wrong, too; but no local origin of any cloud."""
    at = np.array([[500_000.0, 5_400_000, 100]])
    assert views_from_setups(turn + at, at) == [True]
    moved = turn + np.array([0.5, 0, 0])
    assert (seen(moved), views_from_setups(moved + at, at)) == ("", [True])
    street = make_street(8_000, random_state=0)
    drive = make_mobile_scan(8_000, random_state=0).data
    for points, position in (
        (turn, [[0, 0, turn[:, 2].min()]]),  # the ground
        (street.data, street.sensor_origins[:1]),  # points that are even in space
        (street.data, [[0, 0, 0]]),
        (drive, drive[:1] * 0),
        (drive, drive.mean(axis=0)[None]),
    ):
        assert views_from_setups(points, np.array(position, float)) == [False]


def test_each_setup_answers_for_its_own_points(turn):
    positions = np.array([[30.0, 0, 0], [0, 40.0, 2]])
    points, setups = (
        np.vstack([turn, turn]) + np.repeat(positions, len(turn), axis=0),
        np.repeat([4, 9], len(turn)),
    )
    of_each = np.repeat(positions, len(turn), axis=0)
    order = np.random.default_rng(0).permutation(len(points))
    points, of_each, setups = points[order], of_each[order], setups[order]
    assert views_from_setups(points, of_each, setups) == [True, True]
    of_each[setups == 9] -= [0, 0, 3.0]
    assert views_from_setups(points, of_each, setups) == [True, False]


def test_setups_of_few_points_and_those_that_are_far_away_say_so(turn):
    points = np.vstack([turn, turn[:16], turn[:17], turn + np.array([0, 0, 9e3])])
    setups = np.repeat([1, 2, 3, 4], [len(turn), 16, 17, len(turn)])
    origins = np.zeros_like(points)
    assert views_from_setups(points, origins, setups)[::3] == [True, "far"]
    assert views_from_setups(points, origins, setups)[1] == "few"
    assert views_from_setups(points, origins, setups)[2] in (True, False)
    assert views_from_setups(points[:0], origins[:1]) == ["few"]


def test_the_order_and_the_division_of_points_do_not_matter(turn, monkeypatch):
    monkeypatch.setattr(_recognition, "SAMPLE", 5_000)
    shuffled, views = np.random.default_rng(0).permutation(turn), []
    for parts in ([turn], [shuffled], np.array_split(shuffled, 7)):
        views += _recognition._views(lambda parts=parts: parts, np.zeros((1, 3)))
        np.testing.assert_array_equal(views[-1].points, views[0].points)
        np.testing.assert_array_equal(views[-1].gaps, views[0].gaps)


def test_the_detector_takes_what_it_recognizes(turn):
    turn = turn[:4_000]
    detector = MCMDOutlierDetector(16, sensor_origin="auto", random_state=0).fit(turn)
    np.testing.assert_array_equal(detector.sensor_origin_, np.zeros(3))
    told = MCMDOutlierDetector(16, sensor_origin="origin", random_state=0).fit(turn)
    np.testing.assert_array_equal(detector.scores_, told.scores_)
    moved = turn + np.array([0, 0, 5])
    assert detector.fit(moved).sensor_origin_ is None
    plain = MCMDOutlierDetector(16, random_state=0).fit(moved)
    np.testing.assert_array_equal(detector.scores_, plain.scores_)


@pytest.mark.filterwarnings("ignore:.* of the points are outliers in 2D:UserWarning")
def test_one_position_is_told_and_many_are_not(turn):
    cloud = turn[::4]
    detector = MCMDOutlierDetector(16, sensor_origin=[1.0, 2.0, 3.0], random_state=0)
    np.testing.assert_array_equal(detector.fit(cloud).sensor_origin_, [1, 2, 3])
    assert detector.fit(cloud, sensor_origin=np.ones_like(cloud)).sensor_origin_ is None
    flat = MCMDOutlierDetector(16, sensor_origin="auto", random_state=0)
    assert flat.fit(cloud[:, :2]).sensor_origin_ is None
    paper = MCMDOutlierDetector(16, strictness=None, sensor_origin="auto", random_state=0)
    assert paper.fit(cloud).sensor_origin_ is None
