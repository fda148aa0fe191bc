"""Heights over the ground of large clouds: which points are judged, and groups below the ground.

The points of the ground are kept in cells of their own, flat: with 0 as their z, so that cells are
divided in plan and searched in plan. Their heights lie where other cells have rows.
"""

from functools import partial

import numpy as np

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._classes import ground_in
from sklearn_mcmd.io._ground import NONE_JUDGED, Ground, GroundLimits
from sklearn_mcmd.outliers._low_groups import group_depths
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._cells import Cells, CellWriter
from sklearn_mcmd.tiling._memory import bytes_of_groups
from sklearn_mcmd.tiling._result_files import (
    SCORED,
    VERDICTS,
    has_scores,
    tile_file,
    write_results,
)
from sklearn_mcmd.tiling._search import SLACK, asking, by_distance, near_box
from sklearn_mcmd.tiling._sweeps import Sweeps

__all__ = ["GROUND", "GroundWriter", "Heights"]

GROUND = "ground"  # the folder of the ground's cells


class GroundWriter(CellWriter):
    """Scatters the points of the ground to cells in plan."""

    def add(self, cloud):
        """Take the ground of a part of the cloud."""
        xyz = cloud.xyz[ground_in(cloud)]
        if len(xyz):
            super().add(_flat(xyz), xyz[:, 2].copy().view(np.int64))


class Heights:
    """What is found by heights in a run, beside the scores, which depend on none."""

    def __init__(self, run, limits):
        self.run, self.limits = run, limits
        # Other limits have another folder.
        folder = run.folder.results / "heights {} {} {}".format(*limits)
        folder.mkdir(exist_ok=True)
        self.columns = CellColumns(folder)

    def find(self):
        """Find which points are judged, how many, and groups below the ground."""
        n_cells = len(self.run.cells)
        self._sweep("heights", find_heights, points=self.run.folder.cells)
        n_judged = self.columns.total(n_cells, "heights", "n_judged")
        if not n_judged:
            raise PointFileError(f"{self.run.catalog.paths[0]}: {NONE_JUDGED}")
        if self.limits.low_groups and not self.columns.is_done("all", "groups"):
            n_below = self.columns.total(n_cells, "heights", "n_below")
            self._find_groups(n_cells, n_below)
            self.columns.finish("all", "groups", n_below=n_below)
        return n_judged

    def scored(self):
        """Find what heights say of each score; returns what `Results` takes."""
        folder, results = self.columns.folder, self.run.folder.results
        self._sweep("verdicts", find_verdicts, partial(has_scores, folder), results=results)
        return folder, len(self.run.cells), VERDICTS

    def _sweep(self, name, work, is_done=None, **known):
        known |= {"folder": self.columns.folder, "limits": self.limits}
        sweep = Sweeps(self.columns, self.run.plan.n_workers, {name: 1.0})
        sweep(name, work, self.run.cells, is_done, **known)

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


def find_heights(cell, points, folder, limits):
    """Write which points of a cell are judged, and those that lie below the ground.

    Columns: judged, of all points; below_rows, and below: coordinates, how deep, and the distance
    in plan of the third nearest ground point.
    """
    columns = CellColumns(folder)
    xyz = np.ascontiguousarray(Cells(points).read(cell)["xyz"])
    away, near = _nearest_ground(Cells(points / GROUND), xyz)
    judged = limits.judged(xyz[:, 2] - near.mean(axis=1))
    columns.write(cell, judged=judged)
    n_below = 0
    if limits.low_groups:
        depth, away = near.min(axis=1) - xyz[:, 2], away[:, -1]
        rows = np.flatnonzero(judged & (depth > away))
        below = np.column_stack([xyz[rows], depth[rows], away[rows]])
        columns.write(cell, below_rows=rows, below=below)
        n_below = len(rows)
    columns.finish(cell, "heights", n_judged=int(np.count_nonzero(judged)), n_below=n_below)


def find_verdicts(cell, results, folder, limits):
    """Write the scores of a cell's points with what heights say of them, as `VERDICTS`."""
    columns = CellColumns(folder)
    scored = np.fromfile(tile_file(results, cell), SCORED)
    scores, depths = scored["values"][:, 0], np.zeros(len(scored))
    if limits.low_groups:
        depths[columns.read(cell, "below_rows")] = columns.read(cell, "depths")
        scores = np.maximum(scores, depths)
    depths[~columns.read(cell, "judged")] = np.nan
    verdicts = np.column_stack([scores, depths])
    write_results(folder, cell, scored["row"], verdicts, VERDICTS)


def _nearest_ground(cells, xyz):
    """What `Ground.nearest` tells, of all points of the ground.

    Each point asks its own cell, and then all that may have nearer ground.
    """
    plan, n_nearest = _flat(xyz), GroundLimits().n_nearest
    found = np.full((2, len(xyz), n_nearest), np.inf)
    own = cells.of(plan)

    def ask(cell, asked):
        records, reach = cells.read(cell), SLACK * found[0, asked, -1]
        if np.isfinite(reach).all():
            records = records[near_box(records["xyz"], plan[asked], reach)]
        flat, heights = records["xyz"], records["row"].view(np.float64)
        return np.array(Ground(np.column_stack([flat[:, :2], heights])).nearest(xyz[asked]))

    for cell in np.unique(own):
        asked = np.flatnonzero(own == cell)
        found[:, asked] = ask(cell, asked)
    for cell in by_distance(cells, plan, SLACK * found[0, :, -1]):
        asked = asking(cells, cell, plan, SLACK * found[0, :, -1])
        asked = asked[own[asked] != cell]
        if len(asked):
            both = np.concatenate([found[:, asked], ask(cell, asked)], axis=2)
            nearest = np.lexsort(both[::-1])[:, :n_nearest]  # of equally distant ones the lowest
            found[:, asked] = np.take_along_axis(both, nearest[None], axis=2)
    return found


def _flat(xyz):
    flat = xyz.copy()
    flat[:, 2] = 0.0
    return flat
