"""The kept points of a cloud, cell by cell: neighbors, planes, and distances from creases."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.edges._creases import CreaseModel
from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.planes import _columns
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._constants import Constants
from sklearn_mcmd.tiling._outputs import SCORED
from sklearn_mcmd.tiling._search import all_places
from sklearn_mcmd.tiling._stored import StoredIndex, nearest_rows
from sklearn_mcmd.tiling._tile import columns_of_tile, write_results
from sklearn_mcmd.tiling._whole import whole_of

__all__ = ["STORED", "EdgeJob", "find_distances", "find_kept_planes", "kept_places"]

# What `find_kept_planes` fills besides neighbors: dtypes and shapes of a row.
STORED = {
    "centroids": (np.float64, (3,)), "normals": (np.float64, (3,)), "scale": (np.float64, ()),
}  # fmt: skip


class EdgeJob(NamedTuple):
    """What all sweeps over the cells of a cloud know.

    cells, kept : Path
        Folders of the `Cells` of all points, and of those that are kept.
    columns : Path
        Folder of `Columns`.
    faces : Path
        Folder of what the normal estimator has found for other criteria than creases.
    detector : SharpFeatureDetector
    normals : RobustNormalEstimator
    constants : Constants
        Of the kept points.
    """

    cells: Path
    kept: Path
    columns: Path
    faces: Path
    detector: SharpFeatureDetector
    normals: RobustNormalEstimator
    constants: Constants

    def open(self):
        """The cells of the kept points, and the columns of their places."""
        return Cells(self.kept), Columns(self.columns)

    def removed(self, cell):
        """Records of the points of a cell, and which of them were removed."""
        records, columns = Cells(self.cells).read(cell), Columns(self.columns)
        if self.kept == self.cells:
            return records, np.zeros(len(records), bool)
        return records, ~columns.read(cell, "kept")


def kept_places(cells, columns):
    """What loads the kept places of a cell, and their rows; there may be none."""
    load_some = all_places(columns)

    def load(cell):
        return load_some(cell) if cells.counts[cell] else (np.empty((0, 3)), np.empty(0, np.intp))

    return load


def find_kept_planes(cell, job):
    """Fill near, the neighbors of the kept places of a cell, and the columns `STORED`."""
    (cells, columns), whole = job.open(), whole_of(job)
    near, _ = nearest_rows(cells, whole, cell, job.detector.n_neighbors)
    dtype = np.dtype(job.constants.dtype)
    _, found, n_proved = columns_of_tile(
        cells, cell, job.normals, job.constants, partial(_face_columns, dtype=dtype)
    )
    found = found[columns.read(cell, "first_rows")]
    points = whole.open("points")[whole.rows(cell)].astype(dtype)
    normals, offset, scale = found[:, :3], found[:, 3], found[:, 4]
    told = _columns.Columns(points, normals, None, None, offset, scale)
    planes = told.planes(np.arange(len(points)))
    whole.put(
        cell, near=near, centroids=planes.centroids, normals=planes.normals, scale=planes.scale
    )
    columns.finish(cell, "normals", n_proved=n_proved)


def _face_columns(fitted, dtype):
    """Normals, offsets and scales of the planes of an estimator, as of `transform`: (n, 5)."""
    columns = fitted.normals_, fitted.plane_offset_[:, None], fitted.plane_scale_[:, None]
    return np.hstack(columns).astype(dtype)


def find_distances(job, n_threads):
    """Write the scores of all points of all cells, once the planes of kept places are known."""
    (cells, columns), whole, detector = job.open(), whole_of(job), job.detector
    index = StoredIndex(whole, cells)
    planes = whole.planes(changing=True)
    kept, radius, spacing = (index.empty(len(whole)) for _ in range(3))
    kept[:] = 1.0
    planes = planes._replace(kept=kept, radius=radius, spacing=spacing)
    model = CreaseModel(detector.n_neighbors, detector.min_angle, n_threads)
    near = whole.open("near")
    distance = model.find(index, planes, Neighborhoods(near, np.full(len(near), near.shape[1])))
    for cell in range(len(cells)):
        records, removed = job.removed(cell)
        values = np.empty(len(records))
        if not removed.all():
            values[~removed] = distance[whole.rows(cell)][columns.read(cell, "place_of")]
        if removed.any():
            queries = records["xyz"][removed]
            values[removed] = model.distance_by(queries, index.search(queries, n_threads))
        write_results(job.columns, cell, records["row"], values, SCORED)
