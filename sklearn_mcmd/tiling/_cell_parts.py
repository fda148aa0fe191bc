"""What works on the parts of a cloud in memory works on cells: they answer, this process joins."""

from functools import partial

import numpy as np

from sklearn_mcmd.runtime._progress import listen_to_progress
from sklearn_mcmd.segmentation._parts import answers
from sklearn_mcmd.tiling._sweeps import compute_cells


class CellParts:
    """As `Parts`, of all places: each cell is divided into parts.

    No file says which cells have answered: a run that goes on asks all of them anew.
    """

    def __init__(self, job, n_workers):
        self._job, self._cells, self._n_workers = job, job.cells, n_workers
        self._starts = job.whole().starts

    def each(self, work, *known, size=None):
        """As of `Parts`; columns may be known."""
        todo, given = np.flatnonzero(self._cells.counts).tolist(), (work, self._starts, known, size)
        with listen_to_progress(None):
            task = partial(_answers, job=self._job, given=given)
            found = compute_cells(task, self._cells, todo, self._n_workers)
        return [answer for cell in todo for answer in found[cell]]


def _answers(cell, job, given):
    work, starts, known, size = given
    return answers(work, slice(*starts[cell : cell + 2].tolist()), known, size, job.n_threads)
