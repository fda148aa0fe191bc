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
from sklearn_mcmd.outliers._groups import group_depths
from sklearn_mcmd.tiling._cells import Cells, CellWriter
from sklearn_mcmd.tiling._memory import bytes_of_groups
from sklearn_mcmd.tiling._result_files import write_results
from sklearn_mcmd.tiling._stored_columns import ALL, CellColumns
from sklearn_mcmd.tiling._stored_index import SLACK, by_distance, near_box, within_reach

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

    def __init__(self, run, limits, sweeps):
        self.run, self.limits = run, limits
        # Other limits have another folder.
        self.columns = CellColumns(run.folder.results / "heights {} {} {}".format(*limits))
        self.columns.folder.mkdir(exist_ok=True)
        self._sweep = partial(sweeps, cells=run.cells, columns=self.columns, limits=limits)

    def find(self):
        """Find which points are judged, and groups below the ground; returns how many are."""
        is_done = partial(self.columns.is_done, sweep="heights")
        self._sweep("heights", _find_heights, is_done=is_done, points=self.run.folder.cells)
        reports = [self.columns.report(cell, "heights") for cell in range(len(self.run.cells))]
        n_judged, n_below = (sum(r[name] for r in reports) for name in ("n_judged", "n_below"))
        if not n_judged:
            raise PointFileError(f"{self.run.catalog.paths[0]}: {NONE_JUDGED}")
        if self.limits.low_groups and not self.columns.is_done(ALL, "groups"):
            self._find_groups(n_below)
            self.columns.finish(ALL, "groups")
        return n_judged

    def find_verdicts(self):
        """Write what heights say of each score, as results of their own."""
        is_done = partial(self.columns.is_done, sweep="verdicts")
        self._sweep("verdicts", _find_verdicts, is_done=is_done, scored=self.run.folder.columns)

    def _find_groups(self, n_below):
        """Write how deep the groups of points below the ground lie; all are in memory at once."""
        needed = bytes_of_groups(n_below)
        if needed > self.run.memory:
            raise ParameterError(
                f"{n_below:,} points lie below the ground, whose groups take about "
                f"{needed / 1e6:.0f}MB, more than $memory={self.run.memory / 1e6:.0f}MB; give more "
                "memory, check the ground (class 2), or leave groups below it out (low_groups)"
            )
        parts = [self.columns.read(cell, "below") for cell in range(len(self.run.cells))]
        below = np.concatenate(parts)
        depths = group_depths(below[:, :3], below[:, 3], below[:, 4])
        ends = np.cumsum([len(part) for part in parts])[:-1]
        for cell, part in enumerate(np.split(depths, ends)):
            self.columns.write(cell, depths=part)


def _find_heights(cell, points, columns, limits):
    """Write which points of a cell are judged, and those that lie below the ground.

    Columns: judged, of all points; below_rows, and below: coordinates, how deep, and the distance
    in plan of the third nearest ground point.
    """
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


def _find_verdicts(cell, scored, columns, limits):
    """Write the scores of a cell's points, or depths below the ground if these are more."""
    results = scored.read(cell, "results")
    scores, depths = results["values"][:, 0], np.zeros(len(results))
    if limits.low_groups:
        depths[columns.read(cell, "below_rows")] = columns.read(cell, "depths")
        scores = np.maximum(scores, depths)
    depths[~columns.read(cell, "judged")] = np.nan
    write_results(columns, cell, results["row"], np.column_stack([scores, depths]))
    columns.finish(cell, "verdicts")


def _nearest_ground(cells, xyz):
    """What `Ground.nearest` returns, of all points of the ground."""
    plan, n_nearest = _flat(xyz), GroundLimits().n_nearest
    found = np.full((2, len(xyz), n_nearest), np.inf)
    own = cells.of(plan)

    def nearest_in(cell, asked):
        records, reach = cells.read(cell), SLACK * found[0, asked, -1]
        if np.isfinite(reach).all():
            records = records[near_box(records["xyz"], plan[asked], reach)]
        flat, heights = records["xyz"], records["row"].view(np.float64)
        return np.array(Ground(np.column_stack([flat[:, :2], heights])).nearest(xyz[asked]))

    for cell in np.unique(own):
        asked = np.flatnonzero(own == cell)
        found[:, asked] = nearest_in(cell, asked)
    for cell in by_distance(cells, plan, SLACK * found[0, :, -1]):
        asked = within_reach(cells, cell, plan, SLACK * found[0, :, -1])
        asked = asked[own[asked] != cell]
        if len(asked):
            both = np.concatenate([found[:, asked], nearest_in(cell, asked)], axis=2)
            nearest = np.lexsort(both[::-1])[:, :n_nearest]  # of equally distant ones the lowest
            found[:, asked] = np.take_along_axis(both, nearest[None], axis=2)
    return found


def _flat(xyz):
    flat = xyz.copy()
    flat[:, 2] = 0.0
    return flat
