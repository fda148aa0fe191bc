"""Positions of a sensor at the times of points, whatever second times are counted from."""

import re
import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sklearn_mcmd.io import PointCloud, PointFileError, read_trajectory, sensor_origins

WEEK = 2_300 * 604_800.0  # a Saturday midnight, in GPS seconds
SECONDS = 200_000 + np.linspace(0, 10, 21)  # of that week
PATH = np.column_stack([8 * (SECONDS - 200_000), np.sin(SECONDS), np.full(21, 2.0)])
FORMS = {
    "seconds of the week": 0.0,
    "GPS seconds": WEEK,
    "GPS seconds less 1e9": WEEK - 1e9,
}


def points_at(times, name="gps_time"):
    rng = np.random.default_rng(0)
    return PointCloud(rng.uniform(0, 90, (len(times), 3)), {name: times})


@pytest.mark.parametrize(
    "head", ["time,x,y,z", "X;Y;Z;GPS_TIME", "gps_time x y z heading", "time,gps_time,x,y,z"]
)
def test_columns_of_a_trajectory_are_found_by_their_names(head, tmp_path):
    names = re.split("[,; ]", head.lower())
    values = dict(zip("xyz", PATH.T, strict=True)) | {"gps_time": SECONDS, "heading": SECONDS}
    values["time"] = SECONDS + (7 if "gps_time" in names else 0)
    rows = np.column_stack([values[name] for name in names])[::-1]  # backwards
    sign = head.lower()[len(names[0])]
    np.savetxt(tmp_path / "path.csv", rows, "%.17g", sign, header=head, comments="")
    trajectory = read_trajectory(tmp_path / "path.csv")
    assert_array_equal(trajectory.times, SECONDS)
    assert_array_equal(trajectory.positions, PATH)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n1,2,3\n", "columns must be x, y, z, and time or gps_time"),
        ("time,x,y\n1,2,3\n", "no z among the columns time, x, y"),
        ("time,x,y,z\n1,2,3,4\n1,2,3,5\n", "two times or more"),
        ("time,x,y,z\n1,2,3,4\n2,nan,3,5\n", "finite"),
        ("", "is empty"),
    ],
)
def test_what_is_no_trajectory_is_refused_in_one_line(text, message, tmp_path):
    (tmp_path / "path.csv").write_text(text)
    with pytest.raises(PointFileError, match=rf"path\.csv: .*{message}"):
        read_trajectory(tmp_path / "path.csv")


@pytest.mark.parametrize("name", ["gps_time", "time"])
def test_positions_are_interpolated_linearly_between_times(name):
    times = np.array([200_009.9, 200_000.0, 200_003.25, 200_010.0])
    origins = sensor_origins(points_at(times, name), (SECONDS, PATH))
    expected = [np.interp(times, SECONDS, axis) for axis in PATH.T]
    assert_allclose(origins, np.transpose(expected), rtol=1e-15)


@pytest.mark.parametrize("of_points", FORMS)
@pytest.mark.parametrize("of_path", FORMS)
def test_times_may_be_counted_from_elsewhere_which_is_said(of_points, of_path):
    times = SECONDS[3:9]
    cloud, trajectory = points_at(times + FORMS[of_points]), (SECONDS + FORMS[of_path], PATH)
    with warnings.catch_warnings(record=True, action="always") as warned:
        origins = sensor_origins(cloud, trajectory)
    # GPS seconds have steps of 2.4e-7 s in float64, at 8 m/s.
    assert_allclose(origins, PATH[3:9], atol=1e-5)
    assert len(warned) == (of_points != of_path)
    for warning in warned:
        assert f"taken as {of_points}, and as {of_path}" in str(warning.message)


@pytest.mark.parametrize(
    ("cloud", "path", "message"),
    [
        *[
            (points_at(SECONDS + off), PATH, r"of 21 points (was|were) measured when there is no")
            for off in (-0.5, 0.5, 1e5, -3e7)
        ],
        (PointCloud(np.eye(3)), PATH, "points have no times"),
        (points_at(SECONDS), PATH[:, :2], r"shapes \(21,\), \(21, 2\)"),
    ],
)
def test_points_and_trajectories_that_do_not_fit_are_refused(cloud, path, message):
    with pytest.raises(PointFileError, match=message):
        sensor_origins(cloud, (SECONDS, path))


def test_no_points_have_no_positions():
    assert sensor_origins(points_at(SECONDS[:0]), (SECONDS, PATH)).shape == (0, 3)


def test_a_trajectory_in_another_coordinate_system_is_warned_of():
    cloud = points_at(SECONDS)
    sensor_origins(cloud, (SECONDS, PATH + np.array([0, 0, 9_000])))  # a flight
    with pytest.warns(UserWarning, match="seems to be in another coordinate system"):
        sensor_origins(cloud, (SECONDS, PATH + np.array([5e6, 0, 0])))
