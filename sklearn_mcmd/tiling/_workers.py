"""Work on cells in processes: what fails is told in one line, and the others are finished."""

import time
import warnings

from joblib import Parallel, delayed

from sklearn_mcmd.runtime._progress import listen_to_progress
from sklearn_mcmd.tiling._outputs import tell
from sklearn_mcmd.tiling._warnings import warn_caller

__all__ = ["TilingError", "compute_cells"]


class TilingError(ValueError):
    """A run ended before its output was whole; the message names what is kept of it."""


def compute_cells(task, cells, todo, n_workers):
    """Run a task for some cells, the largest first.

    Parameters
    ----------
    task : callable
        Takes the number of a cell and leaves its results in a file, so that they are kept whatever
        happens to other cells. It can be pickled.
    cells : Cells
    todo : list of int
        Cells without results. For the display of progress, all others are done.
    n_workers : int
        Cells that are computed at once, in processes or by the engine that
        :obj:`joblib.parallel_config` names.

    Raises
    ------
    TilingError
        When all cells have been tried, and some failed. A warning for each says why.
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
        tell(n_done / n_points, f"{rate:,.0f} points/s")
    if n_failed:
        raise TilingError(f"{n_failed} of {len(cells)} tiles failed")


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
