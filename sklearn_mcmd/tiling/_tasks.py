"""Tasks of a run, one for each cell: an estimator's own fit to the cell and its halo."""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import BaseEstimator, clone

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.planes._whole import Whole, part_of
from sklearn_mcmd.runtime._progress import listen_to_progress, report_share
from sklearn_mcmd.tiling._beside import with_beside
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._folder import CellResults, TilingError
from sklearn_mcmd.tiling._halo import part_of_cell
from sklearn_mcmd.tiling._memory import gives_threads


@dataclass(frozen=True)
class Job:
    """What all tasks of a run know."""

    points: Path  # folder of `Cells`
    found: Path  # folder of `CellResults`
    estimator: BaseEstimator
    whole: Whole
    n_neighbors: int  # of which the rings of a halo are
    hops: int  # as many rings
    width: float  # as of `part_of_cell`
    # keep(job, cell, part, fitted, cloud) returns what is kept of a fit to a `Part` of a cell,
    # whose points have this `IndexedCloud`.
    keep: Callable
    # What `fit` gets beside points: where the sensor was, and intensity; and whether with the ends
    # of beams that cross a cell.
    moves: bool = False
    shines: bool = False
    beams: bool = False
    asks_own: bool = False  # whether a fit needs no results of the halo but to find the own ones
    n_threads: int = 1

    @cached_property
    def cells(self):
        return Cells(self.points)

    @property
    def results(self):
        return CellResults(self.found)


def fit_cell(cell, job):
    """Fit the estimator to a cell and its halo; returns what is kept of its own points."""
    asked = job.n_neighbors, job.hops, job.width, job.n_threads
    part, cloud = part_of_cell(job.cells, cell, *asked)
    part, given = with_beside(job, cell, part)
    cloud = IndexedCloud.of(part.xyz)  # which all stages share; other points may have joined
    whole, n_proven = job.whole, len(part.rows)
    if len(job.cells) > 1:
        proven, away = part.proven(cloud, job.n_neighbors, job.hops, job.n_threads)
        whole = whole._replace(away=away if job.asks_own else None)
        n_proven = int(np.count_nonzero(proven))
    params = job.estimator.get_params()
    threads = {name: job.n_threads for name in params if name.endswith("n_jobs")}
    estimator = clone(job.estimator).set_params(**threads)
    with part_of(whole):
        fitted = estimator.fit(part.xyz.astype(job.whole.dtype), **given)
    return {"n_proven": n_proven, **job.keep(job, cell, part, fitted, cloud)}


def run_tasks(name, work, job, n_workers):
    """Do some work, ``work(cell, job)``, on all cells that an earlier run has not done.

    What it returns is kept as `CellResults`, under the name of the task.
    """
    results = job.results
    cells = [cell for cell in range(len(job.cells)) if not results.is_done(cell, name)]
    compute_cells(partial(_once, name, work, job=job), job.cells, cells, n_workers)


def _once(name, work, cell, job):
    """Do the work on a cell, unless that is done: dask gives the tasks of lost workers to others.

    Two that do it at once write the same bytes.
    """
    if not job.results.is_done(cell, name):
        job.results.keep(cell, name, work(cell, job))


def compute_cells(task, cells, todo, n_workers):
    """Run a task for the cells `todo`, the largest first; all others count as done.

    It takes the number of a cell and leaves its results in a file, so that they are kept whatever
    happens to other cells. When all have been tried and some failed, TilingError is raised,
    ValueError if one `fails_for_good`; a warning for each says why.
    """
    todo = sorted(todo, key=lambda cell: -cells.counts[cell])
    n_points = cells.n_points
    n_before = n_done = n_points - int(cells.counts[todo].sum())
    kind: type[Exception] = TilingError
    begin, n_failed = time.monotonic(), 0
    # No more tasks are given than may run: dask has its own number of workers.
    work = Parallel(
        n_jobs=n_workers, pre_dispatch=n_workers, return_as="generator_unordered", batch_size=1
    )
    # Where fewer tiles than processes are left, they have the threads of idle ones.
    spare = n_workers if gives_threads() else 1
    n_times = (max(1, spare // n_left) for n_left in range(len(todo), 0, -1))
    tasks = zip(todo, n_times, strict=True)
    with warnings.catch_warnings():
        # A process that holds much more than at first is replaced, and joblib warns of a leak.
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
        for cell, error in work(delayed(_attempt)(task, cell, times) for cell, times in tasks):
            n_done += int(cells.counts[cell])
            if error is not None:
                n_failed, kind = n_failed + 1, ValueError if error[1] else kind
                ends = zip("xyz", *_ends(cells, cell), strict=True)
                between = ", ".join(f"{axis} {low:.10g} to {high:.10g}" for axis, low, high in ends)
                warn_caller(f"tile {cell} failed ({between}): {error[0]}")
            rate = (n_done - n_before) / max(time.monotonic() - begin, 1e-9)
            report_share(n_done / n_points, f"{rate:,.0f} points/s")
    if n_failed:
        raise kind(f"{n_failed} of {len(cells)} tiles failed")


def _ends(cells, cell):
    """The least and the most coordinates of a cell."""
    if cells.center is None:  # no file is read, which may be why the cell failed
        return cells.extent(cell)
    xyz = cells.points(cell)
    return xyz.min(axis=0), xyz.max(axis=0)


def _attempt(task, cell, n_times):
    """Run the task, whose job has n times its threads: the cell, and why it failed, in one line,
    and whether it `fails_for_good`."""
    if n_times > 1:
        job = task.keywords["job"]
        task = partial(task, job=replace(job, n_threads=n_times * job.n_threads))
    with warnings.catch_warnings(), listen_to_progress(None):
        warnings.simplefilter("ignore")
        try:
            task(cell)
        except Exception as err:
            said = f"{type(err).__name__}: {' '.join(str(err).split())}".removesuffix(": ")
            return cell, (said, fails_for_good(err))
        return cell, None


def fails_for_good(err):
    """Whether an error lies in inputs, parameters or stored files: the same run meets it again."""
    from_outside = isinstance(err, TilingError) or isinstance(err.__cause__, OSError | MemoryError)
    return isinstance(err, ValueError) and not from_outside
