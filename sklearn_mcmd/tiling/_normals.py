"""Normals of clouds larger than memory."""

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.normals._sides import Sides
from sklearn_mcmd.normals._surface_planes import mends_planes
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.planes._orientation import count_upright
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._memory import most_neighbors, sensed, sized
from sklearn_mcmd.tiling._outputs import write_outputs
from sklearn_mcmd.tiling._planes import OWN, PlaneJob, ends_of, find_planes, has_tree
from sklearn_mcmd.tiling._result_files import (
    NORMAL_COLUMNS,
    Results,
    fit_together,
    has_scores,
    normal_columns,
    result_dtype,
    write_results,
)
from sklearn_mcmd.tiling._run import Verb, check_seed, warm_up
from sklearn_mcmd.tiling._sensor_origins import check_one_origin, sensor_path
from sklearn_mcmd.tiling._sweeps import Sweeps

__all__ = ["Normals", "check_normals", "without_sides"]

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
    Sides.of(estimator.orientation, estimator.sensor_origin, np.zeros((1, 3)))
    return estimator.set_params(orientation=None, sensor_origin=None)


class Normals(Verb):
    """Normals, in sweeps; their sides may be told along a tree of all places."""

    options = ("sensor_origin",)

    def __init__(self, estimator, sensor_origin):
        check_normals(estimator)
        super().__init__(clone(estimator).set_params(n_jobs=1))
        self.sensor = sensor_path(estimator, sensor_origin)
        if self.sensor is not None and getattr(estimator, "orientation", None) != "sensor":
            raise ValueError('sensor_origin is given but orientation is not "sensor".')

    def prepare(self, catalog):
        estimator, most = self.estimator, most_neighbors(catalog.n_points, self.estimator)
        if self.sensor is not None:  # any position will do
            estimator = clone(estimator).set_params(sensor_origin="origin")
        self.names, _ = normal_columns(warm_up(estimator, 1_500))
        work = sensed("tree" if has_tree(self.estimator) else "normals", None, self.sensor)
        n_features = len(self.names) - len(NORMAL_COLUMNS)
        return sized(work, self.estimator), n_features, most

    def find(self, run):
        folder, n_cells = run.folder, len(run.cells)
        columns = CellColumns(folder.results)
        last = "planes" if mends_planes(self.estimator) else "normals"
        self.n_resumed = columns.n_done(n_cells, last)
        if all(has_scores(folder.results, cell) for cell in range(n_cells)):
            return
        sweeps = Sweeps(columns, run.plan.n_workers, ends_of(PLACES, 1.0, self.estimator))
        job = PlaneJob.of(run, self.estimator, _write)
        whole = find_planes(sweeps, run.cells, job)
        if whole is not None:
            return whole.remove("near", "larger", *OWN)
        fitted, put = fit_together(job, self.estimator, run.cells)
        put(normal_columns(fitted)[1], result_dtype(len(self.names)))

    def write(self, run):
        results = Results(run.folder.results, len(run.cells), result_dtype(len(self.names)))
        removed, n_upright = write_outputs(run, self, results)
        return {"removed_fraction": removed / run.catalog.n_points, "n_upright": int(n_upright)}

    def make(self, cloud, values, xyz):
        columns = dict(zip(self.names, values.T.copy(), strict=True))
        return with_results(cloud, columns), None

    def measure(self, values):
        removed = values[:, self.names.index("removed_fraction")].sum(dtype=np.float64)
        return np.array([removed, count_upright(values)])


def _write(cell, job, fitted):
    """Write the results of the points of a cell, from those of its places."""
    cells, columns = job.open()
    values = normal_columns(fitted)[1]
    if job.origins() is None:  # else they are of points, not of places
        values = values[columns.read(cell, "place_of")]
    rows, dtype = cells.read(cell)["row"], result_dtype(values.shape[1])
    write_results(job.columns, cell, rows, values, dtype)
