"""Scores of edges, cell by cell: distances from creases, and columns of the normals."""

import numpy as np

from sklearn_mcmd.edges._crease_distance import find_creases
from sklearn_mcmd.edges._limits import column_of_criterion
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._planes import tell_new, told_planes
from sklearn_mcmd.tiling._result_files import N_TRANSFORMED, SCORED, write_results
from sklearn_mcmd.tiling._stored_columns import whole_of
from sklearn_mcmd.tiling._stored_index import StoredIndex

__all__ = [
    "find_distances",
    "find_values",
    "tell_faces",
    "tell_values",
    "values_in_parts",
]


def tell_faces(cell, job, fitted):
    """Fill the columns `FACES` of the kept places of a cell."""
    whole_of(job).put(cell, **told_planes(cell, job, fitted)[2])


def find_distances(whole, job, all_cells, detector, n_threads):
    """Write the scores of the points of `all_cells`, by the planes of the kept places: `whole`."""
    cells, columns = job.open()
    index = StoredIndex(whole, cells, detector.n_neighbors)
    planes = whole.planes(changing=True)
    kept, radius, spacing = (index.empty(len(whole)) for _ in range(3))
    kept[:] = 1.0
    planes = planes._replace(kept=kept, radius=radius, spacing=spacing)
    around = index.all_own()
    creases, distance = find_creases(index, planes, detector.min_angle, n_threads, around)
    for cell in range(len(cells)):
        own = distance[whole.rows(cell)]

        def of_kept(cell=cell, own=own):
            return own[columns.read(cell, "place_of")]

        def of_removed(queries):
            return creases.distance(queries, index.query(queries, n_threads))

        _write_scores(cell, all_cells, job, of_kept, of_removed)


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


def find_values(cell, job, all_cells, criterion):
    """Write the scores of all points of a cell, once `tell_values` has told those of kept ones."""

    def of_kept():
        return -next(values_in_parts(job.open()[1], [cell]))

    def of_removed(queries):
        return -_values(tell_new(job, queries), criterion, job.constants.dtype)

    _write_scores(cell, Cells(all_cells), job, of_kept, of_removed)


def _write_scores(cell, all_cells, job, of_kept, of_removed):
    """Write the scores of all points of a cell: of those that were kept, and of coordinates."""
    records, columns = all_cells.read(cell), job.open()[1]
    kept = np.ones(len(records), bool)
    if all_cells.folder != job.cells:
        kept = columns.read(cell, "kept")
    values = np.empty(len(records))
    if kept.any():
        values[kept] = of_kept()
    if not kept.all():
        values[~kept] = of_removed(records["xyz"][~kept])
    write_results(job.columns, cell, records["row"], values, SCORED)
