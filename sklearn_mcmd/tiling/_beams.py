"""Beams that cross a cell: the points where they end tell what is empty in it."""

import numpy as np

from sklearn_mcmd.tiling._sensor_origins import stored_origins

AT_ONCE = 100_000  # beams that are followed at once


def find_beams(cell, job):
    """The points of a cell whose beams cross other cells: these, ascending, and the points."""
    cells, xyz = job.cells, job.cells.points(cell)
    origins, rows = stored_origins(job.points), cells.rows(cell)
    crossed, points = [np.empty(0, np.int32)], [np.empty(0, np.int64)]
    for first in range(0, len(xyz), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        starts, ends = origins[rows[some]], xyz[some]
        for other in range(len(cells)):
            if other != cell:
                found = first + np.flatnonzero(_cross(starts, ends, *cells.extent(other)))
                crossed.append(np.full(len(found), other, np.int32))
                points.append(found)
    crossed, points = np.concatenate(crossed), np.concatenate(points)
    order = np.argsort(crossed, kind="stable")
    return {"crossed": crossed[order], "ends": points[order]}


def with_beams(job, cell, part):
    """A part with the points whose beams cross its cell."""
    cells, results = job.cells, job.results
    for other in range(len(cells) if len(cells) > 1 else 0):
        crossed = results.mapped(other, "crossed")
        some = slice(*np.searchsorted(crossed, [cell, cell + 1]))
        if other != cell and some.stop > some.start:
            at = np.array(results.mapped(other, "ends")[some])
            xyz, rows = cells.points(other)[at], cells.rows(other)[at]
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
