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
    LEAST,
    MOST,
    QUIET,
    angles,
    are_turned,
    errors_of,
    sizes_of,
    wanted_by,
)
from sklearn_mcmd.planes._around import quantile_around
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._search import Found, all_places, visit_nearest, within_reach

__all__ = [
    "STEPS",
    "ScaleJob",
    "fill_wanted",
    "find_errors",
    "find_sizes",
    "find_wanted",
    "remove_steps",
]

# Numbers of neighbors that are tried.
STEPS = [LEAST * 2**i for i in range(20) if LEAST * 2**i <= MOST // 2]


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
        errors[rows], normals[rows] = errors_of(found.points, around)

    visit_nearest(cells, all_places(columns), cell, points, AROUND, measure)
    columns.write(cell, error_0=errors, normal_0=normals, far_around=reach)
    columns.finish(cell, "errors")


def find_wanted(cell, job, step):
    """Write how many neighbors are wanted of each place, inf where so many do not tell.

    Columns, for the step: wanted; and of planes of twice as many points, where these may be asked,
    places of any cell by their `_keys`, errors and normals.
    """
    cells, columns = job.open()
    k, before = STEPS[step], f"wanted_{step - 1}"
    points = columns.read(cell, "points")
    wanted = columns.read(cell, before).copy() if step else np.full(len(points), np.inf)
    todo, asked = np.flatnonzero(np.isinf(wanted)), (np.empty(0, np.int64), *_no_planes())
    if len(todo):
        found, everything = _places_around(cell, cells, columns, todo)
        spread = found.values(columns, before) if step else None
        errors, normals = _planes_there(cell, columns, step, found)
        asking = []

        def judge(rows, _, near):
            rows, near = todo[rows], near.astype(np.int32, copy=False)
            if step:
                wanted[rows] = quantile_around(spread, _around(near), QUIET)
                still = np.isinf(wanted[rows])
                rows, near = rows[still], near[still]
            quiet = quantile_around(errors, _around(near), QUIET)
            error, number = wanted_by(quiet, k, 3)
            known = number <= 2 * k
            wanted[rows[known]] = np.maximum(number[known], LEAST)
            asking.append((rows[~known], near[~known], error[~known]))

        everything.visit(points[todo], AROUND, judge)
        rows, near, error = map(np.concatenate, zip(*asking, strict=True))
        if len(rows):
            members = np.unique(near)
            queries = found.points[members]
            larger_errors, larger = _larger_planes(cell, cells, columns, queries, 2 * k)
            turned = np.empty(len(found.points))
            turned[members] = angles(normals[members], larger)
            turns = quantile_around(turned, _around(near), QUIET)
            wanted[rows] = np.where(are_turned(turns, error), np.maximum(k, LEAST), np.inf)
            keys = _keys(found)[members]
            order = np.argsort(keys)
            asked = keys[order], larger_errors[order], larger[order]
    columns.write(cell, **{f"wanted_{step}": wanted})
    columns.write(cell, **dict(zip(_names(step + 1), asked, strict=True)))
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
        found, everything = _places_around(cell, cells, columns, todo)
        spread = found.values(columns, f"wanted_{step}")

        def fill(rows, _, near):
            wanted[todo[rows]] = quantile_around(spread, _around(near), QUIET)

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
    found, everything = _places_around(cell, cells, columns, np.arange(len(points)))
    spread = found.values(columns, "wanted")
    wanted = np.empty(len(points))

    def smooth(rows, _, near):
        wanted[rows] = quantile_around(spread, _around(near), QUIET)

    everything.visit(points, AROUND, smooth)
    sizes = sizes_of(wanted, job.n_places)
    columns.write(cell, sizes=sizes)
    columns.finish(cell, "sizes", largest=int(sizes.max()))


def remove_steps(columns, n_cells, last):
    """Free the disk of what the steps up to the last have written, but for what it says."""
    for step in range(last + 1):
        columns.remove(n_cells, *_names(step), *([f"wanted_{step - 1}"] if step else []))


def _places_around(cell, cells, columns, rows):
    """Places around some of a cell, in it and others, and a search of them."""
    points, reach = columns.read(cell, "points"), columns.read(cell, "far_around")
    load = all_places(columns)
    few = len(rows) * AROUND < len(points)
    found = within_reach(cells, load, points[rows], reach[rows], skip=None if few else cell)
    if not few:
        others = _split(found)
        found = Found([(cell, points, np.arange(len(points))), *others])
    return found, NearestPoints(found.points)


def _split(found):
    """Cells, points and rows of what was found."""
    first = 0
    for cell, rows in found.parts:
        yield cell, found.points[first : first + len(rows)], rows
        first += len(rows)


def _planes_there(cell, columns, step, found):
    """Errors and normals of places, where they are known."""
    names = _names(step)[1:]
    if not step:
        return [found.values(columns, name) for name in names]
    keys, *stored = (columns.read(cell, name) for name in _names(step))
    asked = _keys(found)
    places = np.minimum(np.searchsorted(keys, asked), len(keys) - 1)
    known = keys[places] == asked
    values = [np.full((len(asked), *some.shape[1:]), np.nan) for some in stored]
    for there, some in zip(values, stored, strict=True):
        there[known] = some[places[known]]
    return values


def _larger_planes(cell, cells, columns, queries, k):
    """Errors and normals of planes of the k nearest places."""
    errors, normals = np.empty(len(queries)), np.empty((len(queries), 3))

    def measure(rows, _, near, found):
        errors[rows], normals[rows] = errors_of(found.points, _around(near))

    visit_nearest(cells, all_places(columns), cell, queries, k, measure)
    return errors, normals


def _names(step):
    """Names of what a step reads of planes: places, errors and normals."""
    return tuple(f"{name}_{step}" for name in ("place", "error", "normal"))


def _no_planes():
    return np.empty(0), np.empty((0, 3))


def _keys(found):
    """A number for each place: of its cell, and its row there."""
    cells, rows = found.places
    return (cells.astype(np.int64) << 40) + rows


def _around(near):
    near = np.ascontiguousarray(near, dtype=np.int32)
    return Neighborhoods(near, np.full(len(near), near.shape[1]))
