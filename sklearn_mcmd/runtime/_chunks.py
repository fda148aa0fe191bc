"""Work on rows in chunks and threads; listeners are told of the progress."""

from collections import deque
from threading import Lock, Thread

import numpy as np
from joblib.parallel import get_active_backend
from scipy.spatial import cKDTree

from sklearn_mcmd.runtime._progress import current_span

__all__ = ["ORDER_FROM", "each_chunk", "each_slice", "run", "slices", "spatial_order"]

ORDER_FROM = 10_000  # below this many points the order of memory does not matter
COARSE_LEAF = 256


def each_chunk(queries, size, work, n_jobs):
    """Call ``work(rows)`` with chunks of the rows of queries (m, d); a chunk is near in space."""
    n = len(queries)
    order = spatial_order(queries) if n >= ORDER_FROM else np.arange(n)
    each_slice(n, size, lambda rows: work(order[rows]), n_jobs)


def each_slice(n, size, work, n_jobs):
    """Call ``work(rows)`` with slices of n rows, which are already in spatial order."""
    span, n_done, lock = current_span(), 0, Lock()

    def task(rows):
        nonlocal n_done
        work(rows)
        if span is not None:
            with lock:
                n_done += rows.stop - rows.start
                span.tell(n_done / n)

    run([(rows,) for rows in slices(n, size)], task, n_jobs)


def slices(n, size, first=0):
    """Slices of at most `size` rows, from the first up to n."""
    return [slice(start, min(start + size, n)) for start in range(first, n, size)]


def spatial_order(X):
    """The row order of a coarse tree's leaves: points near in space are near in memory."""
    return cKDTree(X, leafsize=COARSE_LEAF, balanced_tree=False, compact_nodes=False).indices


def run(tasks, work, n_jobs):
    """Call ``work(*task)`` for each task, in threads if there is more than one.

    They are threads of our own: joblib's take 10 to 30 ms to begin and to end.
    """
    todo, errors = deque(tasks), []

    def work_off():
        while True:
            try:
                task = todo.popleft()
            except IndexError:
                return
            work(*task)

    def help():
        try:
            work_off()
        except BaseException as error:
            errors.append(error)
            todo.clear()

    helpers = [Thread(target=help) for _ in range(min(_n_threads(n_jobs), len(tasks)) - 1)]
    try:
        for thread in helpers:
            thread.start()
        work_off()
    finally:  # where this thread failed or was interrupted, the others end after their tasks
        todo.clear()
        for thread in helpers:
            if thread.ident is not None:
                thread.join()
    if errors:
        raise errors[0]


def _n_threads(n_jobs):
    """Threads of ``Parallel(n_jobs, require="sharedmem")``."""
    backend, n_usual = get_active_backend(require="sharedmem")
    return backend.effective_n_jobs(n_usual if n_jobs is None else n_jobs)
