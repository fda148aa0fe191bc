"""Kinds of work on all cells, one after another, of which those are left out that are done."""

from functools import partial

from sklearn_mcmd.runtime._progress import progress_part
from sklearn_mcmd.tiling._workers import compute_cells

__all__ = ["Sweeps"]


class Sweeps:
    """Call it with one sweep after the other; each is finished before the next begins.

    Parameters
    ----------
    columns : CellColumns
        What they write.
    n_workers : int
        Cells that are computed at once.
    ends : dict of str to float
        The end of each sweep, as a share of the time.
    begin : float, default=0.0
        Where the first begins.
    """

    def __init__(self, columns, n_workers, ends, begin=0.0):
        self.columns, self.n_workers, self.ends, self.begin = columns, n_workers, ends, begin

    def __call__(self, name, work, cells, is_done=None, **known):
        """Do some work on all cells with points.

        Parameters
        ----------
        name : str
        work : callable
            Takes a cell, and what is `known`.
        cells : Cells
        is_done : callable, default=None
            Whether an earlier run has done a cell; None asks the reports of the sweep.
        """
        is_done = is_done or partial(self.columns.is_done, sweep=name)
        todo = [cell for cell in range(len(cells)) if cells.counts[cell] and not is_done(cell)]
        with progress_part(self.begin, self.ends[name], name):
            compute_cells(partial(work, **known), cells, todo, self.n_workers)
        self.begin = self.ends[name]
