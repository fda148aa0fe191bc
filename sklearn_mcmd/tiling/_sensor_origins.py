"""Where the sensor was for each point: found while the inputs are read, and kept on disk."""

import hashlib
import warnings

import numpy as np
from sklearn.base import clone
from sklearn.utils.validation import check_array

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import is_auto
from sklearn_mcmd.io import PointCloud, sensor_origins
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._las_parts import read_parts
from sklearn_mcmd.io._point_cloud import joined
from sklearn_mcmd.io._trajectory import (
    positions_of_times,
    time_shift,
    times_of,
    trajectory_of,
    warn_if_far,
)
from sklearn_mcmd.sensors._recognition import view_from_origin
from sklearn_mcmd.tiling._memory import PART
from sklearn_mcmd.tiling._stored_columns import made

__all__ = [
    "OriginWriter",
    "SensorPath",
    "check_one_origin",
    "recognized",
    "sensor_path",
    "stored_origins",
]

ORIGINS = "origins.npy"
# Attributes that scan angles need.
OF_LINES = ("scan_angle", "scan_angle_rank", "gps_time", "point_source_id")


class SensorPath:
    """What `process_files` is told of a sensor with more than one position.

    `given` is "auto", a `Trajectory` or a tuple of arrays, or positions (n, 3). `kind` is "angles",
    "trajectory" or "positions", as `plan_run` has it, and `key` a hash of what was given.
    """

    def __init__(self, given):
        if isinstance(given, str):
            if given != "auto":
                raise ValueError(
                    f"sensor_origin={given!r} must be 'auto', a trajectory, or positions of all "
                    "points of the inputs."
                )
            self.kind, self.given, arrays = "angles", given, ()
        elif isinstance(given, tuple) and len(given) == 2:
            self.kind, self.given = "trajectory", trajectory_of(*given)
            arrays = self.given
        else:
            self.given = check_array(
                given, dtype=np.float64, ensure_2d=False, allow_nd=True, input_name="sensor_origin"
            )
            if self.given.ndim != 2 or self.given.shape[1] != 3:
                raise ValueError(
                    f"sensor_origin of all points must have shape (n, 3), got {self.given.shape}; "
                    "give one position to the estimator."
                )
            self.kind, arrays = "positions", (self.given,)
        content = hashlib.sha256(self.kind.encode())
        for values in arrays:
            content.update(np.ascontiguousarray(values))
        self.key = content.hexdigest()

    def check(self, n_points):
        """Raise if there are positions of another number of points."""
        if self.kind == "positions" and len(self.given) != n_points:
            raise ValueError(
                f"sensor_origin has {len(self.given):,} positions, and the inputs have "
                f"{n_points:,} points."
            )


class OriginWriter:
    """Takes all points once, in the order of the inputs, and writes positions for them.

    The folder is that of the `Cells` of the points.
    """

    def __init__(self, folder, sensor):
        self.folder, self.sensor, self.parts, self.n, self.sees = folder, sensor, [], 0, False
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, cloud, path):
        """Take some of the points, those of an input that errors name."""
        rows, self.n = slice(self.n, self.n + len(cloud)), self.n + len(cloud)
        if self.sensor.kind == "positions":
            self.sees |= bool((self.sensor.given[rows] != cloud.xyz).any())
        elif self.sensor.kind == "trajectory":
            with one_clear_line(path, "read"):
                self.parts.append(times_of(cloud).copy())
            self.low = np.minimum(self.low, cloud.xyz.min(axis=0))
            self.high = np.maximum(self.high, cloud.xyz.max(axis=0))
        elif self.sensor.kind == "angles":
            known = {
                name: np.array(cloud.attributes[name])
                for name in OF_LINES
                if name in cloud.attributes
            }
            self.parts.append(PointCloud(cloud.xyz, known))

    def close(self, path):
        """Write the positions of all; `path` is what errors name."""
        if self.sensor.kind == "positions" and not self.sees:
            raise ValueError("sensor_origin is where all points are: there are no rays to them.")
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            with one_clear_line(path, "read"):
                of_rows = self._positions()
            stored = made(self.folder / ORIGINS, float, (self.n, 3))
            for first in range(0, self.n, PART):
                rows = slice(first, first + PART)
                stored[rows] = of_rows(rows)
            if self.sensor.kind == "trajectory":
                warn_if_far(self.low, self.high, stored)
        for warning in told:
            warn_caller(warning.message)

    def _positions(self):
        """What gives the positions of a slice of all points."""
        if self.sensor.kind == "positions":
            return self.sensor.given.__getitem__
        if self.sensor.kind == "angles":
            cloud = joined(self.parts)
            cloud.metadata["las_header"] = True  # so that its scan angles are asked
            return sensor_origins(cloud).__getitem__
        times, trajectory = np.concatenate(self.parts), self.sensor.given
        times -= time_shift(times, trajectory)
        return lambda rows: positions_of_times(times[rows], trajectory)


def check_one_origin(estimator):
    """Raise if an estimator has a position for each point."""
    if np.ndim(getattr(estimator, "sensor_origin", None)) == 2:
        raise ValueError(
            "sensor_origin of an estimator is one position by tiles. For outliers and normals "
            "process_files takes positions of all points."
        )


def recognized(detector, catalog, choice=None):
    """A detector whose "auto" the points of a catalog have settled, and in words what they are.

    "auto" stays where they are recognized: a detector doubts what nobody told it.
    """
    if not is_auto(detector.sensor_origin):
        return detector, ""

    def parts():
        for path in catalog.paths:
            for cloud in read_parts(path, PART):
                with one_clear_line(path, "read"):
                    chosen = None if choice is None else choice.of(cloud)
                yield cloud.xyz if chosen is None else cloud.xyz[chosen]

    told = "" if detector.strictness is None else view_from_origin(parts)
    return clone(detector).set_params(sensor_origin="auto" if told else None), told


def sensor_path(estimator, given):
    """The `SensorPath` that is given beside an estimator, or None."""
    if given is not None and estimator.sensor_origin is not None:
        raise ValueError("sensor_origin is given twice: by the estimator, and to process_files.")
    return None if given is None else SensorPath(given)


def stored_origins(folder):
    """The positions for all points in the order of the inputs, (n, 3) on disk; None if there are
    none beside the cells of a folder."""
    path = folder / ORIGINS
    return np.load(path, mmap_mode="r") if path.exists() else None
