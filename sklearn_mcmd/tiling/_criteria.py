"""The criteria of edges that are columns of the normals, cell by cell."""

from functools import partial

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.edges._limits import column_of_criterion
from sklearn_mcmd.tiling._creases import kept_places
from sklearn_mcmd.tiling._outputs import SCORED
from sklearn_mcmd.tiling._search import visit_nearest, within_reach
from sklearn_mcmd.tiling._tile import (
    N_TRANSFORMED,
    _with_others,
    result_dtype,
    tile_files,
    write_results,
)

__all__ = ["find_values", "value_column", "values_in_parts"]


def value_column(fitted, criterion, dtype):
    """The values of a criterion of a fitted estimator, in the dtype of `transform`: (n, 1)."""
    name = column_of_criterion(criterion)
    if name == "eigenvalue_0":
        values = fitted.eigenvalues_[:, 0]
    elif name == "surface_variation":
        values = fitted.surface_variation_
    else:
        place = list(fitted.get_feature_names_out(list("xyz"))).index(name)
        values = fitted.features_[:, place - N_TRANSFORMED]
    return [name], values.astype(dtype)[:, None]


def values_in_parts(faces, cells, dtype):
    """The values of all kept points, cell by cell: float64."""
    for cell in cells:
        yield _values(faces, cell, dtype)


def find_values(cell, job):
    """Write the scores of all points of a cell, in the order of the inputs."""
    records, removed = job.removed(cell)
    values = np.empty(len(records))
    if not removed.all():
        values[~removed] = -_values(job.faces, cell, job.constants.dtype)
    if removed.any():
        values[removed] = -_values_of_removed(cell, job, records["xyz"][removed])
    write_results(job.columns, cell, records["row"], values, SCORED)


def _values(faces, cell, dtype):
    stored = np.fromfile(tile_files(faces, cell)[0], result_dtype(1, dtype))
    return stored["values"][:, 0].astype(np.float64)


def _values_of_removed(cell, job, queries):
    """Values of new points, by all that they depend on among the points that were kept."""
    (levels, k), (cells, columns) = job.normals._locality(), job.open()
    load, asked = kept_places(cells, columns), queries
    for _ in range(levels + 1):  # members of neighborhoods, and theirs
        reach = np.empty(len(asked))
        visit_nearest(cells, load, cell, asked, k, partial(_keep_reach, reach))
        asked = within_reach(cells, load, asked, reach).points
    fitted = clone(job.normals)
    fitted._tangents, fitted._step_of_cloud = job.normals._tangents, job.constants.step
    fitted.fit(_with_others(asked, cells, k).astype(job.constants.dtype, copy=False))
    place = list(fitted.get_feature_names_out()).index(column_of_criterion(job.detector.criterion))
    found = fitted.transform(queries.astype(job.constants.dtype, copy=False))
    return np.asarray(found)[:, place].astype(np.float64)


def _keep_reach(reach, rows, distances, *_):
    reach[rows] = distances[:, -1]
