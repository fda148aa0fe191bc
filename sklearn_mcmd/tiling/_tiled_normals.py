"""Normals of clouds larger than memory."""

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.io._point_cloud import with_results
from sklearn_mcmd.normals._sides import Sides
from sklearn_mcmd.normals._surface_planes import mends_planes
from sklearn_mcmd.planes._base import BaseLocalPlanes
from sklearn_mcmd.planes._orientation import count_upright
from sklearn_mcmd.tiling._memory import most_neighbors, work_of
from sklearn_mcmd.tiling._plane_sweeps import OWN, PlaneJob, find_planes, has_tree, plane_steps
from sklearn_mcmd.tiling._result_files import (
    NORMAL_COLUMNS,
    fit_together,
    normal_columns,
    write_results,
)
from sklearn_mcmd.tiling._run import TiledVerb, check_estimator, warm_up
from sklearn_mcmd.tiling._sensor_origins import sensor_path


class TiledNormals(TiledVerb):
    """Normals, in sweeps; a tree of all places may decide their sides."""

    options = ("sensor_origin",)

    def __init__(self, estimator, sensor_origin):
        check_estimator(estimator, BaseLocalPlanes)
        super().__init__(clone(estimator).set_params(n_jobs=1))
        self.sensor = sensor_path(estimator, sensor_origin)
        if self.sensor is not None and getattr(estimator, "orientation", None) != "sensor":
            raise ValueError('sensor_origin is given but orientation is not "sensor".')
        self.last_sweep = "planes" if mends_planes(self.estimator) else "normals"

    def prepare(self, catalog):
        estimator = self.estimator
        if self.sensor is not None:  # any position will do
            estimator = clone(estimator).set_params(sensor_origin="origin")
        self.names, _ = normal_columns(warm_up(estimator, 1_500))
        base = "tree" if has_tree(estimator) else "normals"
        work = work_of(base, estimator, sensor=self.sensor)
        n_features = len(self.names) - len(NORMAL_COLUMNS)
        return work, n_features, most_neighbors(catalog.n_points, estimator)

    def find(self, run):
        if run.folder.columns.all_have(len(run.cells), "results"):
            return
        job = PlaneJob.of(run, self.estimator, keep=_write)
        whole = find_planes(run.sweeps(plane_steps(self.estimator)), job)
        if whole is None:
            fit_together(job, self.estimator, run.cells, lambda fitted: normal_columns(fitted)[1])
        else:
            whole.remove("near", "larger", *OWN)

    def make(self, cloud, values, xyz):
        columns = dict(zip(self.names, values.T.copy(), strict=True))
        return with_results(cloud, columns), None

    def measure(self, values):
        removed = values[:, self.names.index("removed_fraction")].sum(dtype=np.float64)
        return np.array([removed, count_upright(values)])

    def report(self, run, total):
        removed, n_upright = total
        return {"removed_fraction": removed / run.catalog.n_points, "n_upright": int(n_upright)}


def without_sides(estimator):
    """The estimator, changed, of who asks for no sides; raises for what tiles cannot do."""
    check_estimator(estimator, BaseLocalPlanes)
    Sides(estimator.orientation, estimator.sensor_origin, np.zeros((1, 3)))
    return estimator.set_params(orientation=None, sensor_origin=None)


def _write(cell, job, fitted):
    """Write the results of the points of a cell, from those of its places."""
    _, values = normal_columns(fitted)
    if job.origins() is None:  # else they are of points, not of places
        values = values[job.columns.read(cell, "place_of")]
    write_results(job.columns, cell, job.cells.read(cell)["row"], values)
