"""Heights over the ground, whose points have cells of their own, divided in plan."""

import numpy as np

from sklearn_mcmd._errors import ParameterError
from sklearn_mcmd.io._classes import ground_in
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._ground import Ground, GroundLimits, check_ground
from sklearn_mcmd.outliers._groups import group_depths
from sklearn_mcmd.tiling._cells import Cells, CellWriter
from sklearn_mcmd.tiling._memory import PROCESS

GROUND = "ground"  # the folder of the cells of the ground
CAPACITY = 250_000  # points of such a cell, at most
BELOW_POINT = 750  # bytes of a point below the ground, whose groups are found


class GroundWriter:
    """Scatters the points of the ground to cells in plan, with their heights as numbers."""

    def __init__(self, folder):
        (folder / GROUND).mkdir()
        self._cells = CellWriter(folder / GROUND, CAPACITY, dtype=np.float64)

    def take(self, cloud, chosen, path):
        """Take the ground of a part of the cloud."""
        xyz = cloud.xyz[ground_in(cloud)]
        if len(xyz):
            self._cells.add(flat(xyz), xyz[:, 2])

    def close(self, folder, path):
        """Write what the cells are; an error that names the path, if there is too little ground."""
        with one_clear_line(path, "read"):
            check_ground(self._cells.n_points)
        self._cells.close()


def flat(xyz):
    """Points in plan, which have 0 as their z."""
    return xyz * [1.0, 1.0, 0.0]


def find_heights(cell, job, limits):
    """Depths below the ground of a cell's points, 0, and NaN of those that are not judged; and of
    those that may belong to groups below it: their numbers, and coordinates, how deep, and the
    distance in plan of the third nearest ground point."""
    xyz = job.cells.points(cell)
    away, near = _nearest_ground(Cells(job.points / GROUND), xyz)
    judged = limits.judged(xyz[:, 2] - near.mean(axis=1))
    found: dict = {"n_judged": int(np.count_nonzero(judged))}
    found["depths"] = np.where(judged, 0.0, np.nan)[:, None]
    if limits.low_groups:
        depth, away = near.min(axis=1) - xyz[:, 2], away[:, -1]
        rows = np.flatnonzero(judged & (depth > away))
        found["below"] = np.column_stack([rows, xyz[rows], depth[rows], away[rows]])
    return found


def judge_groups(run):
    """Write how deep the groups of points below the ground lie; all are in memory at once."""
    n_below = sum(len(below) for below in run.found("below"))
    if (needed := PROCESS + BELOW_POINT * n_below) > run.memory:
        raise ParameterError(
            f"{n_below:,} points lie below the ground, whose groups take about "
            f"{needed / 1e6:.0f}MB, more than $memory={run.memory / 1e6:.0f}MB; give more memory, "
            "check the ground (class 2), or leave groups below it out (low_groups)"
        )
    parts = list(run.found("below"))
    below, ends = np.concatenate(parts), np.cumsum([len(part) for part in parts])
    depths = np.split(group_depths(below[:, 1:4], below[:, 4], below[:, 5]), ends[:-1])
    for cell, (part, own) in enumerate(zip(parts, depths, strict=True)):
        found = run.results.read(cell, "depths")
        found[part[:, 0].astype(int), 0] = own
        run.results.keep(cell, "depths", {"depths": found})


def _nearest_ground(cells, xyz):
    """What `Ground.nearest` returns, of all points of the ground."""
    plan, n_nearest = flat(xyz), GroundLimits().n_nearest
    found = np.full((2, len(xyz), n_nearest), np.inf)
    far = cells.away(plan.min(axis=0), plan.max(axis=0))
    for cell in np.argsort(far, kind="stable"):
        if far[cell] > found[0, :, -1].max():
            break
        low, high = cells.extent(cell)
        gaps = np.linalg.norm(np.maximum(np.maximum(low - plan, plan - high), 0.0), axis=1)
        asked = np.flatnonzero(gaps <= found[0, :, -1])
        ground = cells.points(cell)
        ground[:, 2] = cells.rows(cell)  # heights
        both = np.array(Ground(ground).nearest(xyz[asked]))
        both = np.concatenate([found[:, asked], both], axis=2)
        nearest = np.lexsort(both[::-1])[:, :n_nearest]  # of equally distant ones the lowest
        found[:, asked] = np.take_along_axis(both, nearest[None], axis=2)
    return found
