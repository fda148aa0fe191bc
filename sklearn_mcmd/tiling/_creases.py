"""The kept points of a cloud, cell by cell: neighbors, planes, and distances from creases."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.edges._creases import CreaseModel
from sklearn_mcmd.planes import _columns
from sklearn_mcmd.tiling._cell_columns import CellColumns
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._cloud_constants import Constants
from sklearn_mcmd.tiling._outputs import SCORED
from sklearn_mcmd.tiling._result_files import write_results
from sklearn_mcmd.tiling._stored_columns import whole_of
from sklearn_mcmd.tiling._stored_index import StoredIndex

__all__ = ["STORED", "EdgeJob", "find_distances", "tell_faces"]

# What `tell_faces` fills: dtypes and shapes of a row.
STORED = {
    "centroids": (np.float64, (3,)), "normals": (np.float64, (3,)), "scale": (np.float64, ()),
}  # fmt: skip


class EdgeJob(NamedTuple):
    """What all sweeps over the cells of a cloud know.

    cells, kept : Path
        Folders of the `Cells` of all points, and of those that are kept.
    columns : Path
        Folder of `CellColumns`.
    detector : SharpFeatureDetector
    constants : Constants
        Of the kept points.
    """

    cells: Path
    kept: Path
    columns: Path
    detector: SharpFeatureDetector
    constants: Constants

    def open(self):
        """The cells of the kept points, and the columns of their places."""
        return Cells(self.kept), CellColumns(self.columns)

    def removed(self, cell):
        """Records of the points of a cell, and which of them were removed."""
        records, columns = Cells(self.cells).read(cell), CellColumns(self.columns)
        if self.kept == self.cells:
            return records, np.zeros(len(records), bool)
        return records, ~columns.read(cell, "kept")


def tell_faces(cell, job, fitted):
    """Fill the columns `STORED` of the kept places of a cell."""
    whole, dtype = whole_of(job), np.dtype(job.constants.dtype)
    points = whole.open("points")[whole.rows(cell)].astype(dtype)
    normals, offset, scale = (
        values.astype(dtype)
        for values in (fitted.normals_, fitted.plane_offset_, fitted.plane_scale_)
    )
    told = _columns.Columns(points, normals, None, None, offset, scale)
    planes = told.planes(np.arange(len(points)))
    whole.put(cell, centroids=planes.centroids, normals=planes.normals, scale=planes.scale)


def find_distances(job, n_threads):
    """Write the scores of all points of all cells, once the planes of kept places are known."""
    (cells, columns), whole, detector = job.open(), whole_of(job), job.detector
    index = StoredIndex(whole, cells, detector.n_neighbors)
    planes = whole.planes(changing=True)
    kept, radius, spacing = (index.empty(len(whole)) for _ in range(3))
    kept[:] = 1.0
    planes = planes._replace(kept=kept, radius=radius, spacing=spacing)
    model = CreaseModel(detector.n_neighbors, detector.min_angle, n_threads)
    distance = model.find(index, planes, index.all_own())
    for cell in range(len(cells)):
        records, removed = job.removed(cell)
        values = np.empty(len(records))
        if not removed.all():
            values[~removed] = distance[whole.rows(cell)][columns.read(cell, "place_of")]
        if removed.any():
            queries = records["xyz"][removed]
            values[removed] = model.distance_by(queries, index.query(queries, n_threads))
        write_results(job.columns, cell, records["row"], values, SCORED)
