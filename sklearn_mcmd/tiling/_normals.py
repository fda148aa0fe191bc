"""Normals of clouds larger than memory."""

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.normals._orientation import Sides
from sklearn_mcmd.normals._surface_planes import mends_planes
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._memory import MORE, most_neighbors, sized
from sklearn_mcmd.tiling._outputs import write_outputs
from sklearn_mcmd.tiling._planes import OWN, PlaneJob, are_few, ends_of, find_planes, has_tree
from sklearn_mcmd.tiling._result_files import (
    NORMAL_COLUMNS,
    normal_columns,
    result_dtype,
    write_results,
)
from sklearn_mcmd.tiling._run import Verb, check_seed, warm_up
from sklearn_mcmd.tiling._sensor_origins import check_one_origin, sensor_path, stored_origins
from sklearn_mcmd.tiling._small_clouds import fit_together
from sklearn_mcmd.tiling._stored_columns import whole_of
from sklearn_mcmd.tiling._stored_index import find_places
from sklearn_mcmd.tiling._sweeps import Sweeps

__all__ = ["Normals", "check_normals", "without_sides"]

WARM_UP = 1_500  # points that load or compile the code
PLACES = 0.02  # the share of the time that finding them takes


def check_normals(estimator):
    """Raise if normals depend on the whole cloud."""
    if not isinstance(estimator, BaseLocalPlanes) or estimator.n_neighbors is None:
        raise ValueError(
            f"{type(estimator).__name__} cannot work by tiles with these parameters: with "
            "n_neighbors=None, results depend on the whole cloud."
        )
    check_one_origin(estimator)
    check_seed(estimator)


def without_sides(estimator):
    """The estimator, changed, of those who do not ask for the sides of normals.

    Raises as `check_normals` does, and for sides that are none.
    """
    check_normals(estimator)
    Sides.settled(estimator.orientation, estimator.sensor_origin, np.zeros((1, 3)))
    return estimator.set_params(orientation=None, sensor_origin=None)


class Normals(Verb):
    """Normals, in sweeps; their sides may be told along a tree of all places."""

    options = ("sensor_origin",)

    def __init__(self, estimator, sensor_origin):
        check_normals(estimator)
        sensor = None
        if sensor_origin is not None:
            if getattr(estimator, "orientation", None) != "sensor":
                raise ValueError('sensor_origin is given but orientation is not "sensor".')
            sensor = sensor_path(estimator, sensor_origin)
        super().__init__(clone(estimator).set_params(n_jobs=1), sensor=sensor)

    def prepare(self):
        estimator = self.estimator
        if self.sensor is not None:  # any position will do
            estimator = clone(estimator).set_params(sensor_origin="origin")
        self.names, _ = told_columns(warm_up(estimator, WARM_UP))
        work = "tree" if has_tree(self.estimator) else "normals"
        if self.sensor is not None and self.sensor.kind in MORE:
            work = f"{work}, {self.sensor.kind}"
        n_features = len(self.names) - len(NORMAL_COLUMNS)
        return sized(work, self.estimator), n_features, most_neighbors(self.estimator)

    def find(self, run):
        folder, n_cells = run.folder, len(run.cells)
        columns = CellColumns(folder.results)
        last = "planes" if mends_planes(self.estimator) else "normals"
        self.n_resumed = sum(columns.is_done(cell, last) for cell in range(n_cells))
        if all(map(folder.is_done, range(n_cells))):
            return
        ends = {"places": PLACES, **ends_of(PLACES, 1.0, self.estimator)}
        sweeps = Sweeps(columns, run.plan.n_workers, ends)
        job = PlaneJob(
            folder.cells, folder.results, self.estimator, folder.constants, _write,
            run.plan.n_threads,
        )  # fmt: skip
        sweeps("places", find_places, run.cells, job=job)
        if are_few(whole_of(job), self.estimator):
            return self._find_together(run, len(whole_of(job)))
        find_planes(sweeps, run.cells, job)
        whole_of(job).remove("near", "larger", *OWN)

    def _find_together(self, run, n_places):
        words, dtype = f" at {n_places:,} places", run.folder.constants.dtype
        origins = stored_origins(run.folder.cells)
        fitted, parts = fit_together(self.estimator, run.cells, dtype, words, origins=origins)
        _, values = told_columns(fitted)
        for cell, (rows, places) in enumerate(parts):
            _write_values(run.folder.results, cell, rows, values[places])

    def write(self, run):
        removed, n_upright = write_outputs(run.catalog, run.targets, run.folder, self.names)
        return {
            "removed_fraction": removed, "n_upright": n_upright, "n_resumed": self.n_resumed,
        }  # fmt: skip


def told_columns(fitted):
    """Names of all results of a fitted estimator, and their values: float32 (n, n_columns)."""
    names, columns = normal_columns(fitted)
    if fitted.n_neighbors == "auto":
        names, sizes = [*names, "n_neighbors"], fitted.n_neighbors_.astype(np.float32)
        columns = np.column_stack([columns, sizes])
    return names, columns


def _write(cell, job, fitted):
    """Write the results of the points of a cell, from those of its places."""
    cells, columns = job.open()
    values = told_columns(fitted)[1]
    if job.origins() is None:  # else they are of points, not of places
        values = values[columns.read(cell, "place_of")]
    _write_values(job.columns, cell, cells.read(cell)["row"], values)


def _write_values(folder, cell, rows, values):
    write_results(folder, cell, rows, values, result_dtype(values.shape[1]))
