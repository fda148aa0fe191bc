"""What a sensor tells beside coordinates: where it was for each point, and how much light returned.

Both are found while the inputs are read, and kept on disk in the order of the inputs.
"""

import hashlib
import os
import warnings
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.utils.validation import check_array

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd._validation import is_auto
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._sensor import LIGHTS, lights_in
from sklearn_mcmd.io._trajectory import (
    positions_of_times,
    time_shift,
    times_of,
    trajectory_of,
    warn_if_far,
)
from sklearn_mcmd.outliers._intensity import middle_ranks
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.sensors._recognition import view_from_origin
from sklearn_mcmd.tiling._catalog import parts_of
from sklearn_mcmd.tiling._cells import Levels
from sklearn_mcmd.tiling._folder import append, appended
from sklearn_mcmd.tiling._memory import PART

ORIGINS, LIGHT = "origins", "light"
# What one process takes of each point, in bytes, because it does so.
COSTS = {
    None: (0.0, ""),
    "positions": (24.0, "holds positions for"),
    "trajectory": (30.0, "keeps the times of"),
}
BEAMS_AT_ONCE = 100_000  # that are followed at once


class SensorPath:
    """A sensor with more than one position: what `process_files` gets, and what points add to it.

    `given` is a `Trajectory` or a tuple of arrays, positions (n, 3), or None, where it has one at
    most. `kind` is "trajectory", "positions" or None, and `key` a hash of what was given. `costs`
    are bytes of each point, and why, as of `plan_run`.
    """

    kind: str | None
    given: Any

    def __init__(self, given):
        self._parts, self._n, self._sees = [], 0, False
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)
        self.kind, self.given, arrays = None, given, list[np.ndarray]()
        if isinstance(given, str):
            raise ValueError(
                f"sensor_origin={given!r} must be a trajectory, or positions of all points of the "
                "inputs; one position is a parameter of the estimator."
            )
        if isinstance(given, tuple) and len(given) == 2:
            self.kind, self.given = "trajectory", trajectory_of(*given)
            arrays += self.given
        elif given is not None:
            options = {"ensure_2d": False, "allow_nd": True, "input_name": "sensor_origin"}
            self.given = check_array(given, dtype=np.float64, **options)
            if self.given.ndim != 2 or self.given.shape[1] != 3:
                raise ValueError(
                    f"sensor_origin of all points must have shape (n, 3), got {self.given.shape}; "
                    "give one position to the estimator."
                )
            self.kind, arrays = "positions", [self.given]
        self.moves, self.costs = self.kind is not None, COSTS[self.kind]
        content = hashlib.sha256(str(self.kind).encode())
        for values in arrays:
            content.update(np.ascontiguousarray(values).data)
        self.key = content.hexdigest()

    def check(self, n_points):
        """Raise if there are positions of another number of points."""
        if self.kind == "positions" and len(self.given) != n_points:
            raise ValueError(
                f"sensor_origin has {len(self.given):,} positions, and the inputs have "
                f"{n_points:,} points."
            )

    def take(self, cloud, chosen, path):
        """Take the next points in the order of the inputs, of one that errors name."""
        rows, self._n = slice(self._n, self._n + len(cloud)), self._n + len(cloud)
        if self.kind == "positions":
            self._sees |= bool((self.given[rows] != cloud.xyz).any())
        else:
            with one_clear_line(path, "read"):
                self._parts.append(times_of(cloud).copy())
            self._low = np.minimum(self._low, cloud.xyz.min(axis=0))
            self._high = np.maximum(self._high, cloud.xyz.max(axis=0))

    def close(self, folder, path):
        """Write the positions of all points beside their cells; `path` is what errors name."""
        if self.kind == "positions" and not self._sees:
            raise ValueError("sensor_origin is where all points are: there are no rays to them.")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            with one_clear_line(path, "read"):
                positions_of = self._positions()
            for rows in slices(self._n, PART):
                append(folder / ORIGINS, positions_of(rows))
            if self.kind == "trajectory":
                warn_if_far(self._low, self._high, stored_origins(folder))
        for warning in caught:
            warn_caller(warning.message)

    def _positions(self):
        """A function that returns the positions of a slice of all points."""
        if self.kind == "positions":
            return self.given.__getitem__
        times = np.concatenate(self._parts)
        times -= time_shift(times, self.given)
        return lambda rows: positions_of_times(times[rows], self.given)


def sensor_path(estimator, given):
    """The `SensorPath` that is given beside an estimator."""
    if given is not None and estimator.sensor_origin is not None:
        raise ValueError("sensor_origin is given twice: by the estimator, and to process_files.")
    return SensorPath(given)


def stored_origins(folder):
    """The positions for all points in the order of the inputs, (n, 3), beside their cells."""
    return appended(folder / ORIGINS, (-1, 3))


class LightWriter:
    """Keeps the ranks of the intensity of points beside their cells; it is 0 where a file has none.

    Points that are not chosen have no part in the ranks.
    """

    def __init__(self, folder):
        self._folder, self._n, self._levels, self._not_finite = folder, 0, {}, set()

    def take(self, cloud, chosen, path):
        """Take the next points in the order of the inputs; those `chosen` are judged."""
        for name, values in lights_in(cloud.attributes).items():
            self._fill(name)
            append(self._folder / name, values)
            levels = self._levels.setdefault(name, Levels())
            levels.add(*np.unique(values[chosen], return_counts=True))
            if not np.isfinite(values[chosen]).all():
                self._not_finite.add(name)
        self._n += len(cloud)

    def _fill(self, name):
        """Put 0 for points of files that have none of this name."""
        with one_clear_line(file := self._folder / name, "written"):
            file.touch()
            os.truncate(file, self._n * np.dtype(float).itemsize)

    def close(self, folder, path):
        """Keep the ranks of the first that tells anything; `path` is for errors."""
        for name in (name for name in LIGHTS if name in self._levels):
            self._fill(name)
            stored = appended(folder / name)
            if stored.min() != stored.max():
                break
        else:
            raise PointFileError(
                f"{path}: intensity is asked for, but the inputs have none, or one for all points"
            )
        if name in self._not_finite:
            raise PointFileError(
                f"{path}: intensity is asked for, but {name} of some points is not finite; "
                "leave these points out, or do without intensity"
            )
        values, counts = self._levels[name].merged()
        ranks = middle_ranks(counts)
        for rows in slices(self._n, PART):
            places = np.searchsorted(values, stored[rows])
            append(folder / LIGHT, ranks[np.minimum(places, len(ranks) - 1)])


def with_beside(job, cell, part):
    """A part with the ends of beams that cross it, and what is kept of its points for a fit."""
    given = {}
    if job.beams:
        part = _with_beams(job, cell, part)
    if job.moves:
        given["sensor_origin"] = stored_origins(job.points)[part.rows]
    if job.shines:
        given["intensity"] = appended(job.points / LIGHT)[part.rows]
    return part, given


def find_beams(cell, job):
    """The points of a cell whose beams cross other cells: these, ascending, and the points."""
    cells, xyz = job.cells, job.cells.points(cell)
    origins, rows = stored_origins(job.points), cells.rows(cell)
    parts = [(np.empty(0, np.int32), np.empty(0, np.int64))]
    for some in slices(len(xyz), BEAMS_AT_ONCE):
        starts, ends = origins[rows[some]], xyz[some]
        for other in range(len(cells)):
            if other != cell:
                found = some.start + np.flatnonzero(_cross(starts, ends, *cells.extent(other)))
                parts.append((np.full(len(found), other, np.int32), found))
    crossed, points = map(np.concatenate, zip(*parts, strict=True))
    order = np.argsort(crossed, kind="stable")
    return {"crossed": crossed[order], "ends": points[order]}


def _with_beams(job, cell, part):
    """A part with the points whose beams cross its cell: they tell what is empty in it."""
    for other in range(len(job.cells)):
        crossed = job.results.mapped(other, "crossed")
        some = slice(*np.searchsorted(crossed, [cell, cell + 1]))
        if some.stop > some.start:
            at = np.array(job.results.mapped(other, "ends")[some])
            xyz, rows = job.cells.points(other)[at], job.cells.rows(other)[at]
            part = part.joined(xyz, rows, np.full(len(at), other, np.int32), at)
    return part


def _cross(starts, ends, low, high):
    """Which straight lines between points (n, 3) go through a box."""
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.sort(
            [(low - starts) / (ends - starts), (high - starts) / (ends - starts)], axis=0
        )
    # Lines along a side divide by zero: they are within it everywhere, or nowhere.
    along = ends == starts
    inside = (starts >= low) & (starts <= high)
    first = np.where(along, np.where(inside, -np.inf, np.inf), sides[0]).max(axis=1)
    last = np.where(along, np.where(inside, np.inf, -np.inf), sides[1]).min(axis=1)
    return (last >= np.maximum(first, 0.0)) & (first <= 1.0)


def recognized(detector, catalog, choice=None):
    """A detector whose "auto" the points of a catalog have decided, and in words what they are.

    "auto" stays where they are recognized: a detector doubts what it was not given.
    """
    if not is_auto(detector.sensor_origin):
        return detector, ""

    def parts():
        return (cloud.xyz[chosen] for _, cloud, chosen in parts_of(catalog.paths, choice))

    words = "" if detector.strictness is None else view_from_origin(parts)
    return clone(detector).set_params(sensor_origin="auto" if words else None), words
