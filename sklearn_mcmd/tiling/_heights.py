"""Heights over the ground of large clouds: which points are judged, and groups below the ground.

The points of the ground are kept in cells of their own, flat: with 0 as their z, so that cells are
divided in plan and searched in plan. Their heights lie where other cells have rows.
"""

from functools import partial
from numbers import Real
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._classes import ground_in
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._ground import CORNERS, Ground, check_ground, group_depths
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._cells import Cells, CellWriter
from sklearn_mcmd.tiling._memory import bytes_of_groups
from sklearn_mcmd.tiling._outputs import SCORED, VERDICTS, Scored, has_scores
from sklearn_mcmd.tiling._result_files import tile_file, write_results
from sklearn_mcmd.tiling._search import SLACK, as_near_as, to_border
from sklearn_mcmd.tiling._sweeps import Sweeps

__all__ = ["GroundWriter", "HeightLimits", "Heights"]

GROUND = "ground"  # the folder of the ground's cells
SMALL = 20_000  # points that are read at once at least
WIDTH = 4  # spacings of the points, by which the ground around a tile is taken; only time depends
ENDS = {"heights": 1.0, "verdicts": 1.0}


class HeightLimits(NamedTuple):
    """Which points are judged by their height over the ground, and whether groups below it are.

    above, below : float or None
    low_groups : bool
    """

    above: float | None = None
    below: float | None = None
    low_groups: bool = False

    @classmethod
    def of(cls, above, below, low_groups):
        """The limits, None if no heights are asked for; raises for what is no height."""
        for name, value in {"above": above, "below": below}.items():
            if value is not None and not (isinstance(value, Real) and np.isfinite(value)):
                raise ValueError(f"{name}={value!r} must be a finite number, or None.")
        above, below = (None if value is None else float(value) for value in (above, below))
        limits = cls(above, below, bool(low_groups))
        return None if limits == cls() else limits

    def judged(self, heights):
        """Which points are judged."""
        judged = np.ones(len(heights), bool)
        if self.above is not None:
            judged &= heights > self.above
        if self.below is not None:
            judged &= heights < self.below
        return judged


class GroundWriter:
    """Scatters the points of the ground to cells in plan.

    Parameters
    ----------
    folder : path
        Of the cells of all points.
    capacity, share
        As of `CellWriter`.
    """

    def __init__(self, folder, capacity, share):
        self._folder = Path(folder) / GROUND
        self._folder.mkdir()
        self._writer = CellWriter(self._folder, capacity, share)

    def add(self, cloud, _):
        """Take the ground of a part of the cloud."""
        xyz = cloud.xyz[ground_in(cloud)]
        if len(xyz):
            heights = xyz[:, 2].copy()
            self._writer.add(_flat(xyz), heights.view(np.int64))

    def close(self, path):
        """Raise if there is too little ground; `path` is what the error names."""
        with one_clear_line(path, "read"):
            check_ground(self._writer.n_points)
        self._writer.close()


class HeightJob(NamedTuple):
    """What the work on each cell knows.

    cells, results, folder : Path
        Of the points, of their scores, and of what is found by heights.
    limits : HeightLimits
    """

    cells: Path
    results: Path
    folder: Path
    limits: HeightLimits


class Heights:
    """What is found by heights in a run, beside the scores, which depend on none.

    Parameters
    ----------
    run : Run
    limits : HeightLimits
    """

    def __init__(self, run, limits):
        self.run, self.limits = run, limits
        results = run.folder.results
        folder = results / "heights {} {} {}".format(*limits)  # other limits have another
        folder.mkdir(exist_ok=True)
        self.job = HeightJob(run.folder.cells, results, folder, limits)
        self.columns = CellColumns(folder)
        self.sweep = Sweeps(self.columns, run.plan.n_workers, ENDS)

    def find(self):
        """Find which points are judged, and groups below the ground; returns how many are judged.

        Raises
        ------
        PointFileError
            If there are none.
        """
        n_cells = len(self.run.cells)
        self.sweep("heights", find_heights, self.run.cells, job=self.job)
        n_judged = self.columns.total(n_cells, "heights", "n_judged")
        if not n_judged:
            raise PointFileError(
                f"{self.run.catalog.paths[0]}: no points are judged: all are withheld, of other "
                "classes, or at other heights"
            )
        if self.limits.low_groups and not self.columns.is_done("all", "groups"):
            n_below = self.columns.total(n_cells, "heights", "n_below")
            self._find_groups(n_cells, n_below)
            self.columns.finish("all", "groups", n_below=n_below)
        return n_judged

    def scored(self):
        """The `Scored` points, with what heights say of each."""
        self.sweep.begin = 0.0
        is_done = partial(has_scores, self.job.folder)
        self.sweep("verdicts", find_verdicts, self.run.cells, is_done, job=self.job)
        return Scored(self.job.folder, len(self.run.cells), VERDICTS)

    def _find_groups(self, n_cells, n_below):
        """Write how deep the groups of points below the ground lie; all are in memory at once."""
        needed = bytes_of_groups(n_below)
        if needed > self.run.memory:
            raise ParameterError(
                f"{n_below:,} points lie below the ground, whose groups take about "
                f"{needed / 1e6:.0f}MB, more than $memory={self.run.memory / 1e6:.0f}MB; give more "
                "memory, check the ground (class 2), or leave groups below it out (low_groups)"
            )
        parts = [self.columns.read(cell, "below") for cell in range(n_cells)]
        below = np.concatenate(parts)
        depths = group_depths(below[:, :3], below[:, 3], below[:, 4])
        ends = np.cumsum([len(part) for part in parts])[:-1]
        for cell, part in enumerate(np.split(depths, ends)):
            self.columns.write(cell, depths=part)


def find_heights(cell, job):
    """Write which points of a cell are judged, and those that lie below the ground.

    Columns: judged, of all points; below_rows, and below: coordinates, how deep, and the distance
    in plan of the third nearest ground point.
    """
    columns = CellColumns(job.folder)
    xyz = np.ascontiguousarray(Cells(job.cells).read(cell)["xyz"])
    away, near = _nearest_ground(Cells(job.cells / GROUND), xyz)
    judged = job.limits.judged(xyz[:, 2] - near.mean(axis=1))
    columns.write(cell, judged=judged)
    n_below = 0
    if job.limits.low_groups:
        depth, away = near.min(axis=1) - xyz[:, 2], away[:, -1]
        rows = np.flatnonzero(judged & (depth > away))
        below = np.column_stack([xyz[rows], depth[rows], away[rows]])
        columns.write(cell, below_rows=rows, below=below)
        n_below = len(rows)
    columns.finish(cell, "heights", n_judged=int(np.count_nonzero(judged)), n_below=n_below)


def find_verdicts(cell, job):
    """Write the scores of a cell's points with what heights say of them, as `VERDICTS`."""
    columns = CellColumns(job.folder)
    scored = np.fromfile(tile_file(job.results, cell), SCORED)
    scores, depths = scored["values"][:, 0], np.zeros(len(scored))
    if job.limits.low_groups:
        depths[columns.read(cell, "below_rows")] = columns.read(cell, "depths")
        scores = np.maximum(scores, depths)
    depths[~columns.read(cell, "judged")] = np.nan
    verdicts = np.column_stack([scores, depths])
    write_results(job.folder, cell, scored["row"], verdicts, VERDICTS)


def _nearest_ground(cells, xyz):
    """What `Ground.nearest` tells, of all points of the ground."""
    queries = _flat(xyz)
    low, high = queries.min(axis=0), queries.max(axis=0)
    low[2], high[2] = -np.inf, np.inf
    width = WIDTH * (high - low)[:2].max() / np.sqrt(len(xyz))
    low[:2] -= width
    high[:2] += width
    there = _in_box(cells, low, high, max(len(xyz), SMALL))
    distances, heights = np.full((2, len(xyz), CORNERS), np.inf)
    if there is not None:
        distances, heights = Ground(there).nearest(xyz)
    # What may be nearer outside of the box is searched for in all cells.
    far = np.flatnonzero(~(SLACK * distances[:, -1] < to_border(queries, low, high)))
    if len(far):
        bounds = distances[far, -1]
        found = as_near_as(cells, _loader(cells), queries[far], CORNERS, bounds)
        there = found.points
        there[:, 2] = np.concatenate([heights for _, heights in found.parts])
        distances[far], heights[far] = Ground(there).nearest(xyz[far])
    return distances, heights


def _in_box(cells, low, high, most):
    """The ground between two corners (m, 3); None if that is more than some points, or too few."""
    parts, load = [np.empty((0, 3))], _loader(cells)
    least, upmost = cells.extent(slice(None))
    for cell in np.flatnonzero(((least <= high) & (upmost >= low)).all(axis=1)):
        points, heights = load(cell)
        inside = ((points >= low) & (points <= high)).all(axis=1)
        points = points[inside]
        points[:, 2] = heights[inside]
        parts.append(points)
        if sum(map(len, parts)) > most:
            return None
    points = np.concatenate(parts)
    return points if len(points) >= CORNERS else None


def _loader(cells):
    """Returns the points of a cell, flat, and their heights."""

    def load(cell):
        records = cells.read(cell)
        return np.ascontiguousarray(records["xyz"]), records["row"].copy().view(np.float64)

    return load


def _flat(xyz):
    flat = xyz.copy()
    flat[:, 2] = 0.0
    return flat
