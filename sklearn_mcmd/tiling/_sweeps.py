"""Kinds of work on all cells, one after another: the others are finished where one fails."""

import os
import time
import warnings
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from string import digits

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import BaseEstimator, clone

from sklearn_mcmd._errors import warn_caller
from sklearn_mcmd.edges._crease_distance import crease_steps, spacing_steps
from sklearn_mcmd.planes._base import model_of
from sklearn_mcmd.planes._resolution import coarse_warning
from sklearn_mcmd.runtime._progress import listen_to_progress, progress_part, report_share
from sklearn_mcmd.tiling._cells import Cells, Constants
from sklearn_mcmd.tiling._memory import gives_threads
from sklearn_mcmd.tiling._stored_columns import CellColumns, StoredColumns
from sklearn_mcmd.tiling._stored_offers import stored_offers

CREASES = spacing_steps() | crease_steps()
# How long each step of a run takes, for the display of progress: percents of what normals take.
WEIGHTS = {
    **{"places": 2, "neighbors": 20, "offers": 25, "planes": 30, "bends": 10, "normals": 15},
    **{"scale": 21, "settled": 6, "sizes": 7, "larger": 6},  # of n_neighbors="auto"
    **{"forest": 6, "sides": 12},  # of orientation="mst"
    **{"surfaces": 1, "explained": 1, "usual": 12, "groups": 10, "scores": 2},
    **{"rays": 3, "heights": 18, "verdicts": 1},
    **{"outliers": 135, "kept": 3},
    **{name.rstrip(digits): step.share for name, step in CREASES.items()},
    **{"reach": 5, "links": 7, "growth": 3, "joining": 26},
    **{"noise": 5, "gathered": 8, "summed": 10, "blocked": 1},
    **{"joined": 2, "bordered": 1, "patched": 2, "voted": 5},  # of joining
}


TILES = "lock.tiles"  # held while tiles are computed


@contextmanager
def lock_of_tiles(folder, alone=False, name=TILES):
    """Keep a lock of a folder, a file of this name, while a tile is computed; `alone` waits until
    all have ended.

    So a run waits for tiles that another still computes, on any machine, of which only the process
    that gave the command was killed.
    """
    with ExitStack() as stack, suppress(ImportError, OSError):  # Windows, or a disk without locks
        import fcntl

        file = stack.enter_context(open_lock(folder / name))
        fcntl.flock(file, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        stack = stack.pop_all()
    with stack:
        yield


def open_lock(path):
    """Open a file to lock it: no link is followed, and nothing in it is changed."""
    no_link = getattr(os, "O_NOFOLLOW", 0)  # not on Windows
    return open(path, "a", opener=lambda name, flags: os.open(name, flags | no_link, 0o666))


class TilingError(ValueError):
    """A run ended before its output was whole; the message names what is kept of it."""


@dataclass(frozen=True)
class Job:
    """What all sweeps over the cells of a cloud know."""

    points: Path  # folder of `Cells`
    found: Path  # folder of `CellColumns`
    estimator: BaseEstimator
    constants: Constants
    n_threads: int = 1  # of each worker

    @classmethod
    def of(cls, run, estimator, **others):
        """The job on all points of a `TiledRun`."""
        folder, n_threads = run.folder, run.plan.n_threads
        known = folder.cells, folder.results, estimator, folder.constants
        return cls(*known, n_threads=n_threads, **others)

    @cached_property
    def cells(self):
        """The `Cells` of the points, which are read once."""
        return Cells(self.points)

    @property
    def columns(self):
        return CellColumns(self.found)

    def whole(self):
        """The `StoredColumns` of all places, once these are found."""
        return StoredColumns(self.columns, len(self.cells))

    def model_on(self, index, *more):
        """The `LocalPlaneModel` of the places of an index."""
        precision, shape = np.finfo(self.constants.dtype).eps, index.points.shape
        estimator = clone(self.estimator)  # which gets the number of trials
        model = model_of(estimator, index, shape, precision, self.constants.step, *more)
        model.offers = stored_offers(self.whole())
        return model


class Sweeps:
    """Call it with one sweep after the other, by the `steps`; each is finished before the next."""

    def __init__(self, n_workers, steps):
        self.n_workers = n_workers
        ends = np.cumsum([0.0, *(WEIGHTS[name.rstrip(digits)] for name in steps)])
        self._spans = dict(zip(steps, np.stack([ends[:-1], ends[1:]], 1) / ends[-1], strict=True))

    def part(self, name, stage=None):
        """The part of the progress that a step makes; `stage` is as of `progress_part`."""
        return progress_part(*map(float, self._spans[name]), stage)

    def __call__(self, name, work, cells, then=None, **known):
        """Do some work, which takes a cell and what is `known`, on all cells with points.

        The columns of the work, or of its job, keep what it returns, and know which cells an
        earlier run has done; `then` frees what was needed until then. What takes hardly any time is
        none of the steps.
        """
        columns = known["job"].columns if "job" in known else known["columns"]
        todo = np.flatnonzero(cells.counts).tolist()
        todo = [cell for cell in todo if not columns.is_done(cell, name)]
        with self.part(name, name) if name in self._spans else listen_to_progress(None):
            task = partial(_once, columns, name, work, then, **known)
            compute_cells(task, cells, todo, self.n_workers)


def _once(columns, name, work, then, cell, /, **known):
    """Do the work of a sweep on a cell, unless that is done.

    Dask gives a tile to another worker when it loses one, which may have done it, or still does.
    """
    with lock_of_tiles(columns.folder, alone=True, name=f"{cell}.lock"):
        if not columns.is_done(cell, name):
            columns.keep(cell, name, work(cell, **known) or {})
            if then is not None:
                then(cell, **known)


def compute_cells(task, cells, todo, n_workers):
    """Run a task for the cells `todo`, the largest first; all others count as done.

    It takes the number of a cell and leaves its results in a file, so that they are kept whatever
    happens to other cells, or it answers. When all have been tried and some failed, TilingError is
    raised, ValueError if one `fails_for_good`; a warning for each says why. Returns the answers by
    cell.
    """
    todo = sorted(todo, key=lambda cell: -cells.counts[cell])
    n_points = int(cells.counts.sum())
    n_before = n_done = n_points - int(cells.counts[todo].sum())
    begin, n_failed, kind, answers = time.monotonic(), 0, TilingError, {}
    folder = cells.folder.parent
    # No more tasks are given than may run: dask has its own number of workers.
    work = Parallel(
        n_jobs=n_workers, pre_dispatch=n_workers, return_as="generator_unordered", batch_size=1
    )
    # Where fewer tiles than processes are left, they have the threads of idle ones.
    spare = n_workers if gives_threads() else 1
    given = (max(1, spare // n_left) for n_left in range(len(todo), 0, -1))
    tasks = zip(todo, given, strict=True)
    with warnings.catch_warnings():
        # A process that holds much more than at first is replaced, and joblib warns of a leak.
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
        for cell, answers[cell], error in work(
            delayed(_attempt)(task, *known, folder) for known in tasks
        ):
            n_done += int(cells.counts[cell])
            if error is not None:
                n_failed, kind = n_failed + 1, ValueError if error[1] else kind
                ends = zip("xyz", *cells.extent(cell), strict=True)
                between = ", ".join(f"{axis} {low:.10g} to {high:.10g}" for axis, low, high in ends)
                warn_caller(f"tile {cell} failed ({between}): {error[0]}")
            rate = (n_done - n_before) / max(time.monotonic() - begin, 1e-9)
            report_share(n_done / n_points, f"{rate:,.0f} points/s")
    if n_failed:
        raise kind(f"{n_failed} of {len(cells)} tiles failed")
    return answers


def warn_if_coarse(constants, index):
    """Warn if single precision is too coarse for the neighborhoods of an index."""
    if constants.dtype == "float32" and (coarse := coarse_warning(index)):
        warn_caller(coarse)


def _attempt(task, cell, n_times, folder):
    """Run the task, whose job has n times its threads: the cell, the answer, and why it failed, in
    one line, and whether it `fails_for_good`."""
    if n_times > 1 and "job" in task.keywords:
        job = task.keywords["job"]
        task = partial(task, job=replace(job, n_threads=n_times * job.n_threads))
    with lock_of_tiles(folder), warnings.catch_warnings(), listen_to_progress(None):
        warnings.simplefilter("ignore")
        try:
            return cell, task(cell), None
        except Exception as err:
            said = f"{type(err).__name__}: {' '.join(str(err).split())}".removesuffix(": ")
            return cell, None, (said, fails_for_good(err))


def fails_for_good(err):
    """Whether an error lies in inputs, parameters or stored files: the same run meets it again."""
    from_outside = isinstance(err, TilingError) or isinstance(err.__cause__, OSError | MemoryError)
    return isinstance(err, ValueError) and not from_outside
