"""Trajectories: where a sensor was at which time, and so where it was for each point."""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sklearn_mcmd._errors import counted, fixed, warn_caller
from sklearn_mcmd.io._files import check_file, one_clear_line
from sklearn_mcmd.io._point_cloud import PointCloud, PointFileError
from sklearn_mcmd.io._text import read_text

TIMES = ("gps_time", "time")  # names of columns, the first is taken
WEEK = 604_800.0  # seconds
ADJUSTED = 1e9  # what LAS subtracts from GPS seconds
# A trajectory farther from its points than this many of their extents is in another system: from
# there they take 0.06 degrees of its view, a few steps between beams.
FAR = 1000


class Trajectory(NamedTuple):
    """Positions of a sensor at times.

    Attributes
    ----------
    times : ndarray of shape (m,)
        Seconds, ascending.
    positions : ndarray of shape (m, 3)
        In the coordinate system of the points.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float64]


def read_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Read a trajectory from a table of text.

    Parameters
    ----------
    path : str or os.PathLike
        Text such as CSV, whose first line names the columns: x, y, z, and gps_time or time, in any
        order and case. Other columns are not read.

    Returns
    -------
    Trajectory
        In the order of its times. Of rows with one time, the first counts.

    Raises
    ------
    PointFileError
        With a message of one line, if a column is missing, or the file is no such table.

    See Also
    --------
    sensor_origins : Where the sensor was for each point.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from sklearn_mcmd.io import read_trajectory
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "drive.csv"
    ...     _ = file.write_text("time,x,y,z\\n10,0,0,2\\n11,8,0,2\\n")
    ...     trajectory = read_trajectory(file)
    >>> trajectory.positions[-1]
    array([8., 0., 2.])
    """
    path = Path(path)
    with one_clear_line(path, "read"):
        check_file(path)
        table = read_text(path, columns={})  # where the first may be a time
        names = {name.lower(): name for name in reversed(table.attributes)}
        columns = [names[time] for time in TIMES if time in names]
        if not columns:
            raise PointFileError("is no trajectory: columns must be x, y, z, and time or gps_time")
        return trajectory_of(table.attributes[columns[0]], table.xyz)


def trajectory_of(times, positions):
    """A `Trajectory` of arrays of times (m,) and positions (m, 3), in any order."""
    times, positions = np.asarray(times, float), np.asarray(positions, float)
    if times.ndim != 1 or positions.shape != (len(times), 3):
        raise PointFileError(
            f"times (m,) and positions (m, 3) have shapes {times.shape}, {positions.shape}"
        )
    if not (np.isfinite(times).all() and np.isfinite(positions).all()):
        raise PointFileError("a trajectory must have finite times and positions")
    times, rows = np.unique(times, return_index=True)
    if len(times) < 2:
        raise PointFileError("a trajectory needs positions at two times or more")
    return Trajectory(times, positions[rows])


def positions_at(cloud: PointCloud, trajectory: Trajectory) -> NDArray[np.float64]:
    """Where the sensor was for each point, by its time; see `sensor_origins`."""
    times = times_of(cloud)
    if not len(times):
        return np.empty((0, 3))
    positions = positions_of_times(times - time_shift(times, trajectory), trajectory)
    warn_if_far(cloud.xyz.min(axis=0), cloud.xyz.max(axis=0), positions)
    return positions


def times_of(cloud):
    """The times of the points of a cloud, float64 (n,)."""
    name = next((time for time in TIMES if time in cloud.attributes), None)
    if name is None:
        raise PointFileError("points have no times: an attribute gps_time or time is needed")
    return np.asarray(cloud.attributes[name], float)


def time_shift(times, trajectory):
    """Seconds by which points' times are ahead of a trajectory's, which must cover them; warns."""
    begin, end = trajectory.times[[0, -1]]
    shift, words = _shift(times, begin, end)
    if words:
        warn_caller(f"the times of points and trajectory begin elsewhere: {words}")
    n_outside = np.count_nonzero(~((times - shift >= begin) & (times - shift <= end)))
    if n_outside:
        raise PointFileError(
            f"{counted(n_outside, 'point', 'were', of=len(times))} measured when there is "
            f"no trajectory: points have times from {times.min():.10g} to "
            f"{times.max():.10g}, and the trajectory from {begin:.10g} to {end:.10g}"
        )
    return shift


def positions_of_times(times, trajectory):
    """Positions (n, 3) at times (n,) of the trajectory."""
    axes = trajectory.positions.T
    return np.stack([np.interp(times, trajectory.times, axis) for axis in axes], axis=1)


def _shift(times, begin, end):
    """Seconds by which points' times are ahead of the trajectory's, and why in words.

    GPS times are counted from the beginning of the week, from 1980, or as in LAS from 1e9 seconds
    after that.
    """

    def within(shift):
        return np.count_nonzero((times - shift >= begin) & (times - shift <= end))

    week, plain, adjusted = "seconds of the week", "GPS seconds", "GPS seconds less 1e9"
    shifts = [(0.0, ""), (-ADJUSTED, f"taken as {adjusted}, and as {plain}")]
    shifts += [(ADJUSTED, f"taken as {plain}, and as {adjusted}")]
    points_in_weeks = times.min() >= 0 and times.max() <= WEEK
    path_in_weeks = begin >= 0 and end <= WEEK
    if points_in_weeks != path_in_weeks:
        # Seconds of a week fit any week: the one by which the middles of both are nearest.
        middle = np.median(times) - (begin + end) / 2
        for offset, other in ((0.0, plain), (-ADJUSTED if path_in_weeks else ADJUSTED, adjusted)):
            of_points, of_path = (week, other) if points_in_weeks else (other, week)
            shift = offset + WEEK * np.round((middle - offset) / WEEK)
            shifts.append((shift, f"taken as {of_points}, and as {of_path}"))
    return next(((shift, words) for shift, words in shifts if within(shift)), (0.0, ""))


def warn_if_far(low, high, positions):
    """Warn if positions cannot be in the coordinate system of points between two corners."""
    extent = np.linalg.norm(high - low)
    between = np.maximum(low - positions.max(axis=0), positions.min(axis=0) - high)
    away = float(np.linalg.norm(np.maximum(between, 0.0)))
    if away > FAR * extent:
        warn_caller(
            f"the trajectory is {fixed(away, ',.0f')} away from the points, which extend over "
            f"{fixed(extent, ',.0f')}: it seems to be in another coordinate system"
        )
