"""The criteria of edges that are columns of the normals, cell by cell."""

import numpy as np

from sklearn_mcmd.edges._limits import column_of_criterion
from sklearn_mcmd.tiling._outputs import SCORED
from sklearn_mcmd.tiling._planes import tell_new
from sklearn_mcmd.tiling._result_files import N_TRANSFORMED, write_results

__all__ = ["find_values", "tell_values", "values_in_parts"]


def tell_values(cell, job, fitted, criterion):
    """Write values, of the places of a cell."""
    job.open()[1].write(cell, values=_values(fitted, criterion, job.constants.dtype))


def _values(fitted, criterion, dtype):
    """The values of a criterion of a fitted estimator, as `transform` tells them: float64 (n,)."""
    name = column_of_criterion(criterion)
    if name == "eigenvalue_0":
        values = fitted.eigenvalues_[:, 0]
    elif name == "surface_variation":
        values = fitted.surface_variation_
    else:
        place = list(fitted.get_feature_names_out(list("xyz"))).index(name)
        values = fitted.features_[:, place - N_TRANSFORMED]
    return values.astype(dtype).astype(np.float64)


def values_in_parts(columns, cells):
    """The values of all kept points, cell by cell: float64."""
    for cell in cells:
        yield columns.read(cell, "values")[columns.read(cell, "place_of")]


def find_values(cell, job, planes):
    """Write the scores of all points of a cell, in the order of the inputs; `planes` is the job
    that found the values."""
    records, removed = job.removed(cell)
    values, columns = np.empty(len(records)), job.open()[1]
    if not removed.all():
        values[~removed] = -next(values_in_parts(columns, [cell]))
    if removed.any():
        fitted = tell_new(planes, records["xyz"][removed])
        values[removed] = -_values(fitted, job.detector.criterion, job.constants.dtype)
    write_results(job.columns, cell, records["row"], values, SCORED)
