"""Planes and neighbors of the places of a cloud, cell by cell, for regions to grow along."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._columns import joined_columns, split_columns
from sklearn_mcmd.segmentation import RegionGrowing
from sklearn_mcmd.segmentation._steps import least_scales
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._constants import Constants
from sklearn_mcmd.tiling._stored import nearest_rows
from sklearn_mcmd.tiling._tile import columns_of_tile
from sklearn_mcmd.tiling._whole import whole_of

__all__ = ["STORED", "GrowthJob", "find_planes"]

NUMBER, VECTOR = (np.float64, ()), (np.float64, (3,))
# What `find_planes` fills besides neighbors: dtypes and shapes of a row.
STORED = {"centroids": VECTOR, "normals": VECTOR, "scale": NUMBER, "floor": NUMBER}


class GrowthJob(NamedTuple):
    """What all sweeps over the cells of a cloud know.

    cells, columns : Path
        Folders of `Cells` and `Columns`.
    growing : RegionGrowing
        With an estimator of normals.
    constants : Constants
    n_threads : int
        Of each worker.
    """

    cells: Path
    columns: Path
    growing: RegionGrowing
    constants: Constants
    n_threads: int = 1

    def open(self):
        """The cells, and the columns of their places."""
        return Cells(self.cells), Columns(self.columns)


def find_planes(cell, job):
    """Fill near, the neighbors of the places of a cell, and their planes as growing takes them.

    Columns: `STORED`, of which floor is the least scale; variation, in the dtype of the cloud.
    """
    (cells, columns), whole = job.open(), whole_of(job)
    near, _ = nearest_rows(cells, whole, cell, whole.open("near").shape[1])
    dtype = np.dtype(job.constants.dtype)

    def of_fitted(fitted):
        return joined_columns(
            np.empty((len(fitted.normals_), 0), dtype), fitted.normals_, fitted.eigenvalues_,
            fitted.plane_offset_[:, None], fitted.plane_scale_[:, None],
        )  # fmt: skip

    _, found, n_proved = columns_of_tile(
        cells, cell, job.growing.normal_estimator, job.constants, of_fitted, job.n_threads
    )
    points = whole.open("points")[whole.rows(cell)]
    found = found[columns.read(cell, "first_rows")]
    told = split_columns(np.hstack([points.astype(dtype), found]), 3)
    planes = told.planes(np.arange(len(points)))
    floor = least_scales(points, dtype, job.constants.step)
    whole.put(
        cell, near=near, floor=floor, centroids=planes.centroids, normals=planes.normals,
        scale=np.maximum(planes.scale, floor), variation=told.surface_variation,
    )  # fmt: skip
    columns.finish(cell, "planes", n_proved=n_proved)
