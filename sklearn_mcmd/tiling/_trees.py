"""Normals that agree along a spanning tree of the whole cloud: its forest cell by cell."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.normals._sides import TREE_NEIGHBORS
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM
from sklearn_mcmd.planes._orientation import signs_along, spanning_forest
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._constants import Constants
from sklearn_mcmd.tiling._stored import nearest_rows, places_of_cell
from sklearn_mcmd.tiling._sweeps import Sweeps
from sklearn_mcmd.tiling._tile import (
    columns_of_tile,
    normal_columns,
    write_proved,
)
from sklearn_mcmd.tiling._together import find_together
from sklearn_mcmd.tiling._whole import WholeColumns

__all__ = ["find_agreeing_normals"]

ENDS = {"planes": 0.9, "forest": 0.95}  # of the sweeps, as shares of the time


class TreeJob(NamedTuple):
    """What all sweeps over the cells of a cloud know.

    cells, columns : Path
        Folders of `Cells` and `Columns`.
    estimator : RobustNormalEstimator
        Without an orientation.
    constants : Constants
    n_threads : int
        Of each worker.
    """

    cells: Path
    columns: Path
    estimator: RobustNormalEstimator
    constants: Constants
    n_threads: int


def find_agreeing_normals(run, estimator):
    """Write the results of all tiles; returns how many tiles an earlier run had begun."""
    folder, cells, plan = run.folder, run.cells, run.plan
    columns, n_cells = Columns(folder.results), len(cells)
    n_resumed = sum(columns.is_done(cell, "planes") for cell in range(n_cells))
    single = clone(estimator).set_params(orientation=None)
    job = TreeJob(folder.cells, folder.results, single, folder.constants, plan.n_threads)
    sweep = partial(Sweeps(columns, plan.n_workers, ENDS), cells=cells, job=job, collect=False)
    sweep("planes", _find_planes)
    whole = WholeColumns(columns, n_cells)
    if len(whole) < max(COMPILE_FROM, estimator.n_neighbors + 1):
        find_together(folder, cells, estimator, len(whole), normal_columns)
        return n_resumed
    whole.join("points", "normals")
    sweep("forest", _find_forest)
    points, normals = whole.open("points"), whole.open("normals")
    edges = np.concatenate([columns.read(cell, "forest") for cell in range(n_cells)])
    signs = signs_along(normals, points, *spanning_forest(normals, points, *edges.T))
    for cell in range(n_cells):
        values, place_of = columns.read(cell, "values"), columns.read(cell, "place_of")
        values[signs[whole.rows(cell)][place_of] < 0, :3] *= -1
        n_proved = columns.report(cell, "planes")["n_proved"]
        write_proved(folder.results, cell, cells.read(cell)["row"], values, n_proved)
    return n_resumed


def _find_planes(cell, job):
    """Write the places of a cell, their normals, and the results of its points without a side."""
    cells, columns = Cells(job.cells), Columns(job.columns)

    def both(fitted):
        return np.hstack([fitted.normals_, normal_columns(fitted)[1]])

    _, found, n_proved = columns_of_tile(
        cells, cell, job.estimator, job.constants, both, job.n_threads
    )
    points = cells.read(cell)["xyz"]
    rows, place_of = places_of_cell(points)
    columns.write(
        cell, points=points[rows], normals=found[rows, :3], place_of=place_of.astype(np.int32),
        values=found[:, 3:].astype(np.float32),
    )  # fmt: skip
    columns.finish(cell, "planes", n_places=len(rows), n_proved=n_proved)


def _find_forest(cell, job):
    """Write the edges of the forest of the places of a cell and their neighbors, by rows."""
    cells, columns = Cells(job.cells), Columns(job.columns)
    whole = WholeColumns(columns, len(cells))
    near, _ = nearest_rows(cells, whole, cell, min(TREE_NEIGHBORS, len(whole)))
    known, local = np.unique(near, return_inverse=True)
    local = local.reshape(near.shape).astype(np.int32)
    points, normals = whole.open("points")[known], whole.open("normals")[known]
    local = _within(local, points, job.estimator.radius)
    first = np.repeat(local[:, 0], local.shape[1])
    edges = spanning_forest(normals, points, first, local.ravel())
    columns.write(cell, forest=known[np.column_stack(edges)])
    columns.finish(cell, "forest")


def _within(near, points, radius):
    """Neighbors (n, k), those that are not within the radius replaced, as by `NeighborIndex`."""
    if radius is None:
        return near
    distances = np.linalg.norm(points[near] - points[near[:, 0]][:, None], axis=2)
    sizes = np.maximum(np.count_nonzero(distances <= radius, axis=1), points.shape[1] + 1)
    return np.where(np.arange(near.shape[1]) < sizes[:, None], near, near[:, :1])
