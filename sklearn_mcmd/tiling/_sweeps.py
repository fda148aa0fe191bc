"""Kinds of work on all cells, one after another: what fails is told, the others are finished.

And the warning of coordinates that single precision rounds too coarsely.
"""

import time
import warnings
from functools import partial

from joblib import Parallel, delayed

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.planes._resolution import coarse_warning
from sklearn_mcmd.runtime._progress import listen_to_progress, progress_part, report_share

__all__ = ["Sweeps", "TilingError", "compute_cells", "warn_if_coarse"]


class TilingError(ValueError):
    """A run ended before its output was whole; the message names what is kept of it."""


class Sweeps:
    """Call it with one sweep after the other; each is finished before the next begins.

    They write `columns`, and `ends` tells the end of each, as a share of the time.
    """

    def __init__(self, columns, n_workers, ends):
        self.columns, self.n_workers, self.ends, self.begin = columns, n_workers, ends, 0.0

    def __call__(self, name, work, cells, is_done=None, **known):
        """Do some work, which takes a cell and what is `known`, on all cells with points.

        `is_done` tells whether an earlier run has done a cell; None asks the reports of the sweep.
        """
        is_done = is_done or partial(self.columns.is_done, sweep=name)
        todo = [cell for cell in range(len(cells)) if cells.counts[cell] and not is_done(cell)]
        with progress_part(self.begin, self.ends[name], name):
            compute_cells(partial(work, **known), cells, todo, self.n_workers)
        self.begin = self.ends[name]


def compute_cells(task, cells, todo, n_workers):
    """Run a task for the cells `todo`, the largest first; all others count as done.

    It takes the number of a cell and leaves its results in a file, so that they are kept whatever
    happens to other cells. When all have been tried and some failed, TilingError is raised; a
    warning for each says why.
    """
    todo = sorted(todo, key=lambda cell: -cells.counts[cell])
    n_points = int(cells.counts.sum())
    n_before = n_done = n_points - int(cells.counts[todo].sum())
    begin, n_failed = time.monotonic(), 0
    # No more tasks are given than may run: dask has its own number of workers.
    work = Parallel(
        n_jobs=n_workers, pre_dispatch=n_workers, return_as="generator_unordered", batch_size=1
    )
    for cell, error in work(delayed(_attempt)(task, cell) for cell in todo):
        n_done += int(cells.counts[cell])
        if error is not None:
            n_failed += 1
            between = _between(*cells.extent(cell))
            warn_caller(f"tile {cell} failed ({between}): {error}")
        rate = (n_done - n_before) / max(time.monotonic() - begin, 1e-9)
        report_share(n_done / n_points, f"{rate:,.0f} points/s")
    if n_failed:
        raise TilingError(f"{n_failed} of {len(cells)} tiles failed")


def warn_if_coarse(constants, index):
    """Warn if single precision is too coarse for the neighborhoods of an index."""
    if constants.dtype == "float32" and (coarse := coarse_warning(index)):
        warn_caller(coarse)


def _attempt(task, cell):
    """Run the task; returns why it failed, in one line."""
    with warnings.catch_warnings(), listen_to_progress(None):
        warnings.simplefilter("ignore")
        try:
            task(cell)
        except Exception as err:
            return cell, f"{type(err).__name__}: {' '.join(str(err).split())}".removesuffix(": ")
    return cell, None


def _between(low, high):
    return ", ".join(
        f"{axis} {a:.6g} to {b:.6g}" for axis, a, b in zip("xyz", low, high, strict=True)
    )
