"""Normals with ``n_neighbors="auto"``: sizes of neighborhoods in sweeps, then tiles of those."""

from functools import partial

import numpy as np

from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._scales import (
    STEPS,
    ScaleJob,
    fill_wanted,
    find_errors,
    find_sizes,
    find_wanted,
    remove_steps,
)
from sklearn_mcmd.tiling._sized import SizedJob, normals_of_sized_tile
from sklearn_mcmd.tiling._stored import find_places
from sklearn_mcmd.tiling._tile import normal_columns
from sklearn_mcmd.tiling._together import find_together
from sklearn_mcmd.tiling._work import compute_cells

__all__ = ["find_auto_normals"]

# The end of the sweeps before the normals, as a share of the time, and of the first.
SIZED, FIRST = 0.4, 0.15


def find_auto_normals(run, estimator):
    """Write the results of all tiles; returns how many tiles an earlier run had done.

    Parameters
    ----------
    run : Run
    estimator : RobustNormalEstimator
    """
    folder, cells, plan = run.folder, run.cells, run.plan
    columns, n_cells, constants = Columns(folder.results), len(cells), folder.constants
    todo = [cell for cell in range(n_cells) if not folder.is_done(cell)]
    job = ScaleJob(folder.cells, folder.results, 0)

    def sweep(begin, end, name, work, **options):
        rest = [cell for cell in range(n_cells) if not columns.is_done(cell, name)]
        with progress_part(begin, end, "sizes of neighborhoods"):
            compute_cells(partial(work, job=job, **options), cells, rest, plan.n_workers)

    sweep(0.0, 0.02, "places", find_places)
    n_places = int(columns.total(n_cells, "places", "n_places"))
    if n_places < COMPILE_FROM:
        find_together(folder, cells, estimator, n_places, _with_sizes)
        return n_cells - len(todo)
    job = job._replace(n_places=n_places)
    if not columns.is_done("all", "largest"):
        sweep(0.02, FIRST, "errors", find_errors)
        width, last = (SIZED - FIRST) / (len(STEPS) + 2), 0
        for last in range(len(STEPS)):
            begin, name = FIRST + last * width, f"wanted {last}"
            sweep(begin, begin + width, name, find_wanted, step=last)
            remove_steps(columns, n_cells, last)
            if not columns.total(n_cells, name, "n_todo"):
                break
        sweep(SIZED - 2 * width, SIZED - width, "wanted", fill_wanted, step=last)
        sweep(SIZED - width, SIZED, "sizes", find_sizes)
        largest = max(columns.report(cell, "sizes")["largest"] for cell in range(n_cells))
        columns.finish("all", "largest", largest=largest)
        remove_steps(columns, n_cells, last + 1)
        columns.remove(n_cells, "wanted", "far_around")
    largest = columns.report("all", "largest")["largest"]
    work = SizedJob(folder.cells, folder.results, estimator, constants, largest, plan.n_threads)
    with progress_part(SIZED, 1.0, "normals"):
        task = partial(normals_of_sized_tile, job=work)
        compute_cells(task, cells, todo, plan.n_workers)
    return n_cells - len(todo)


def _with_sizes(fitted):
    names, columns = normal_columns(fitted)
    sizes = fitted.n_neighbors_.astype(np.float32)
    return [*names, "n_neighbors"], np.column_stack([columns, sizes])
