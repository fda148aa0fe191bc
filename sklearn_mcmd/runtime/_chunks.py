"""Work on rows in chunks and threads; listeners hear of the progress."""

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from threading import Lock

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.runtime._progress import current_span

ORDER_FROM = 10_000  # below this many points the order of memory does not matter
COARSE_LEAF = 256  # points in a leaf of the tree that orders others


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
                span.report(n_done / n)

    run([(rows,) for rows in slices(n, size)], task, n_jobs)


def slices(n, size):
    """Slices of at most `size` rows, up to n."""
    return [slice(start, min(start + size, n)) for start in range(0, n, size)]


def spatial_order(X):
    """The row order of a coarse tree's leaves: points near in space are near in memory."""
    # A tree that is not balanced and has loose boxes is made sooner; only its order is asked for.
    return cKDTree(X, leafsize=COARSE_LEAF, balanced_tree=False, compact_nodes=False).indices


def run(tasks, work, n_jobs):
    """Call ``work(*task)`` for each task, in threads if there is more than one.

    They are not joblib's, which take 10 to 30 ms to begin and to end; but as many as it would take.
    """
    from joblib.parallel import get_active_backend  # `mcmd info` runs nothing in chunks

    backend, n_usual = get_active_backend(require="sharedmem")
    n_threads = backend.effective_n_jobs(n_usual if n_jobs is None else n_jobs)
    n_threads, todo = min(n_threads, len(tasks)), deque(tasks)

    def work_off():
        try:
            while todo:
                try:
                    task = todo.popleft()
                except IndexError:  # another thread was faster
                    return
                work(*task)
        finally:  # where one fails, the others end after their tasks
            todo.clear()

    if n_threads <= 1:
        work_off()
        return
    with ThreadPoolExecutor(n_threads) as pool:
        try:
            for thread in [pool.submit(work_off) for _ in range(n_threads)]:
                thread.result()
        finally:  # this thread may be interrupted
            todo.clear()
