"""Work on rows in chunks and threads; listeners are told of the progress."""

from threading import Lock

import numpy as np
from joblib import Parallel, delayed

from sklearn_mcmd.planes._indexed_cloud import ORDER_FROM, spatial_order
from sklearn_mcmd.planes._progress import current_span

__all__ = ["each_chunk", "each_slice", "run"]


def each_chunk(queries, size, work, n_jobs):
    """Call ``work(rows)`` with chunks of the rows of queries (m, d); a chunk is near in space."""
    n = len(queries)
    order = spatial_order(queries) if n >= ORDER_FROM else np.arange(n)
    _watched([(order[i : i + size], min(size, n - i)) for i in range(0, n, size)], work, n, n_jobs)


def each_slice(n, size, work, n_jobs):
    """Call ``work(rows)`` with slices of n rows, which are already in spatial order."""
    parts = [(slice(i, min(i + size, n)), min(size, n - i)) for i in range(0, n, size)]
    _watched(parts, work, n, n_jobs)


def run(tasks, work, n_jobs, *, told=False):
    """Call ``work(*task)`` for each task, in threads if there is more than one.

    With `told`, listeners are told how many are done.
    """
    span, n_done, lock = current_span() if told else None, 0, Lock()

    def watched(*task):
        nonlocal n_done
        work(*task)
        with lock:
            n_done += 1
            span.tell(n_done / len(tasks))

    _run(tasks, work if span is None else watched, n_jobs)


def _run(tasks, work, n_jobs):
    if len(tasks) == 1:
        work(*tasks[0])
    elif tasks:
        Parallel(n_jobs=n_jobs, require="sharedmem")(delayed(work)(*task) for task in tasks)


def _watched(parts, work, n, n_jobs):
    span, n_done, lock = current_span(), 0, Lock()

    def task(rows, count):
        nonlocal n_done
        work(rows)
        if span is not None:
            with lock:
                n_done += count
                span.tell(n_done / n)

    _run(parts, task, n_jobs)
