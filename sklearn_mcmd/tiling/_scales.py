"""Sizes of neighborhoods (``n_neighbors="auto"``), cell by cell.

Each size is found from what is usual around, and is smoothed over neighbors of neighbors. So the
work goes in sweeps, as `ScaleFinder` does in memory: errors of small neighborhoods; then, for each
number of neighbors, whether it is known how many are wanted; and last what is wanted around.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.normals._scales import (
    AROUND,
    FARTHEST,
    LEAST,
    MOST,
    QUIET,
    TURNED,
    angles,
    errors_of,
    sizes_of,
    wanted_by,
)
from sklearn_mcmd.planes._around import quantile_around
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._search import visit_nearest, within_reach
from sklearn_mcmd.tiling._surfaces import all_places

__all__ = ["STEPS", "ScaleJob", "fill_wanted", "find_errors", "find_sizes", "find_wanted"]

# Numbers of neighbors that are tried.
STEPS = [LEAST * FARTHEST**i for i in range(20) if LEAST * FARTHEST**i <= MOST // FARTHEST]


class ScaleJob(NamedTuple):
    """What all sweeps over the cells of a cloud know.

    cells, columns : Path
        Folders of `Cells` and `Columns`.
    n_places : int
        Of the whole cloud.
    """

    cells: Path
    columns: Path
    n_places: int

    def open(self):
        """The cells, and the columns of their places."""
        return Cells(self.cells), Columns(self.columns)


def find_errors(cell, job):
    """Write what planes of the least neighborhoods are of each place.

    Columns: error_0; normal_0; far_around, the distance of the last of those around.
    """
    cells, columns = job.open()
    points = columns.read(cell, "points")
    (errors, reach), normals = np.empty((2, len(points))), np.empty((len(points), 3))

    def measure(rows, distances, near, found):
        reach[rows] = distances[:, -1]
        around = _around(near[:, :LEAST])
        errors[rows], normals[rows] = errors_of(found.points, around, compiled=True)

    visit_nearest(cells, all_places(columns), cell, points, AROUND, measure)
    columns.write(cell, error_0=errors, normal_0=normals, far_around=reach)
    columns.finish(cell, "errors")


def find_wanted(cell, job, step):
    """Write how many neighbors are wanted of each place, inf where so many do not tell.

    Columns, for the step: wanted; and of planes of twice as many points, where these may be asked,
    rows among the places here and around, errors and normals.
    """
    cells, columns = job.open()
    k, name = STEPS[step], f"wanted_{step}"
    points = columns.read(cell, "points")
    wanted, todo, spread = np.full(len(points), np.inf), np.arange(len(points)), None
    if step:
        wanted = columns.read(cell, f"wanted_{step - 1}")
        todo = np.flatnonzero(np.isinf(wanted))
    if not len(todo):
        columns.write(cell, **{name: wanted}, **_planes_of(step, *_no_planes()))
        columns.finish(cell, f"wanted {step}", n_todo=0)
        return
    found, everything = _places_around(cell, cells, columns)
    n = len(points) + len(found.points)
    if step:
        spread = found.after([wanted], columns, f"wanted_{step - 1}")
        errors, normals = np.full(n, np.nan), np.full((n, 3), np.nan)
        rows, errors[rows], normals[rows] = _stored_planes(cell, columns, step)
        wanted = wanted.copy()
    else:
        errors = found.after([columns.read(cell, "error_0")], columns, "error_0")
        normals = found.after([columns.read(cell, "normal_0")], columns, "normal_0")
    asking = [(np.empty(0, np.intp), np.empty((0, AROUND), np.int32), np.empty((2, 0)))]

    def judge(rows, _, near):
        rows, near = todo[rows], near.astype(np.int32, copy=False)
        if step:
            wanted[rows] = quantile_around(spread, _around(near), QUIET, compiled=True)
            still = np.isinf(wanted[rows])
            rows, near = rows[still], near[still]
        quiet = quantile_around(errors, _around(near), QUIET, compiled=True)
        error, number = wanted_by(quiet, k, 3)
        known = number <= FARTHEST * k
        wanted[rows[known]] = np.maximum(number[known], LEAST)
        asking.append((rows[~known], near[~known], np.stack([error, number])[:, ~known]))

    everything.visit(points[todo], AROUND, judge)
    rows, near = (np.concatenate([part[i] for part in asking]) for i in (0, 1))
    error = np.concatenate([part[2][0] for part in asking])
    asked = np.unique(near)
    queries = np.vstack([points, found.points])[asked]
    larger_errors, larger = np.empty(len(asked)), np.empty((len(asked), 3))

    def measure(some, _, near, found):
        larger_errors[some], larger[some] = errors_of(found.points, _around(near), compiled=True)

    visit_nearest(cells, all_places(columns), cell, queries, FARTHEST * k, measure)
    if len(rows):
        turned = np.empty(n)
        turned[asked] = angles(normals[asked], larger)
        turns = quantile_around(turned, _around(near), QUIET, compiled=True)
        bent = turns > TURNED * error
        wanted[rows] = np.where(bent, np.maximum(k, LEAST), np.inf)
    columns.write(cell, **{name: wanted}, **_planes_of(step, asked, larger_errors, larger))
    columns.finish(cell, f"wanted {step}", n_todo=int(np.isinf(wanted).sum()))


def fill_wanted(cell, job, step):
    """Write how many neighbors are wanted of each place, after the last step.

    Column: wanted.
    """
    cells, columns = job.open()
    points = columns.read(cell, "points")
    wanted = columns.read(cell, f"wanted_{step}").copy()
    todo = np.flatnonzero(np.isinf(wanted))
    if len(todo):
        found, everything = _places_around(cell, cells, columns)
        spread = found.after([wanted.copy()], columns, f"wanted_{step}")

        def fill(rows, _, near):
            wanted[todo[rows]] = quantile_around(spread, _around(near), QUIET, compiled=True)

        everything.visit(points[todo], AROUND, fill)
    wanted[np.isinf(wanted)] = MOST
    columns.write(cell, wanted=wanted)
    columns.finish(cell, "wanted")


def find_sizes(cell, job):
    """Write the number of neighbors of each place.

    Column: sizes.
    """
    cells, columns = job.open()
    points = columns.read(cell, "points")
    found, everything = _places_around(cell, cells, columns)
    spread = found.after([columns.read(cell, "wanted")], columns, "wanted")
    wanted = np.empty(len(points))

    def smooth(rows, _, near):
        wanted[rows] = quantile_around(spread, _around(near), QUIET, compiled=True)

    everything.visit(points, AROUND, smooth)
    sizes = sizes_of(wanted, job.n_places)
    columns.write(cell, sizes=sizes)
    columns.finish(cell, "sizes", largest=int(sizes.max()))


def _places_around(cell, cells, columns):
    """Places of other cells that lie around those of a cell, and a search of all."""
    points, reach = columns.read(cell, "points"), columns.read(cell, "far_around")
    found = within_reach(cells, all_places(columns), points, reach, skip=cell)
    return found, NearestPoints(np.vstack([points, found.points]))


def _planes_of(step, rows, errors, normals):
    """Columns of planes for the step that follows."""
    return {f"rows_{step + 1}": rows, f"error_{step + 1}": errors, f"normal_{step + 1}": normals}


def _no_planes():
    return np.empty(0, np.intp), np.empty(0), np.empty((0, 3))


def _stored_planes(cell, columns, step):
    return (columns.read(cell, f"{name}_{step}") for name in ("rows", "error", "normal"))


def _around(near):
    near = np.ascontiguousarray(near, dtype=np.int32)
    return Neighborhoods(near, np.full(len(near), near.shape[1]))
