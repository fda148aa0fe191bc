"""Planes of the places of a cloud, as regions take them to grow along."""

import numpy as np

from sklearn_mcmd.planes._columns import joined_columns, split_columns
from sklearn_mcmd.planes._resolution import least_scales
from sklearn_mcmd.tiling._stored_columns import whole_of

__all__ = ["STORED", "tell_planes"]

NUMBER, VECTOR = (np.float64, ()), (np.float64, (3,))
# What `tell_planes` fills: dtypes and shapes of a row.
STORED = {"centroids": VECTOR, "normals": VECTOR, "scale": NUMBER, "floor": NUMBER}


def tell_planes(cell, job, fitted):
    """Fill the planes of the places of a cell as growing takes them.

    Columns: `STORED`, of which floor is the least scale; variation, in the dtype of the cloud.
    """
    whole, dtype = whole_of(job), np.dtype(job.constants.dtype)
    points = whole.open("points")[whole.rows(cell)]
    found = joined_columns(
        points.astype(dtype), fitted.normals_, fitted.eigenvalues_,
        fitted.plane_offset_[:, None], fitted.plane_scale_[:, None],
    )  # fmt: skip
    told = split_columns(found, 3)
    planes = told.planes(np.arange(len(points)))
    floor = least_scales(points, np.finfo(dtype).eps, job.constants.step)
    whole.put(
        cell, floor=floor, centroids=planes.centroids, normals=planes.normals,
        scale=np.maximum(planes.scale, floor), variation=told.surface_variation,
    )  # fmt: skip
