"""Tasks in threads: each is done once, and errors end the work."""

from threading import Barrier, get_ident
from time import sleep

import pytest
from joblib import Parallel, delayed, parallel_config

from sklearn_mcmd.runtime._chunks import each_slice, run


@pytest.mark.parametrize("n_jobs", [None, 1, 2, 7, -1])
@pytest.mark.parametrize("n_tasks", [0, 1, 2, 50])
def test_each_task_is_done_once(n_tasks, n_jobs):
    done = []
    run([(i, -i) for i in range(n_tasks)], lambda i, j: done.append((i, j)), n_jobs)
    assert sorted(done) == [(i, -i) for i in range(n_tasks)]


def test_slices_cover_all_rows():
    rows = []
    each_slice(1000, 64, lambda part: rows.extend(range(part.start, part.stop)), 3)
    assert sorted(rows) == list(range(1000))


def threads_of(n_jobs):
    """How many threads work."""
    seen = set()
    run([(i,) for i in range(40)], lambda i: seen.add(get_ident()), n_jobs)
    return len(seen)


def test_the_number_of_jobs_means_what_it_means_to_joblib():
    for n, n_jobs in ((3, 3), (2, None)):
        together = Barrier(n, timeout=600)  # so many work at once
        with parallel_config(backend="threading", n_jobs=2):
            run([(i,) for i in range(2 * n)], lambda i, b=together: b.wait(), n_jobs)
    assert threads_of(None) == threads_of(1) == 1
    with pytest.raises(ValueError, match="n_jobs == 0"):
        run([(0,), (1,)], print, 0)
    nested = Parallel(n_jobs=2, prefer="threads")(delayed(threads_of)(None) for _ in range(2))
    assert nested == [1, 1]


@pytest.mark.parametrize("n_jobs", [1, 2])
@pytest.mark.parametrize("kind", [ValueError, KeyboardInterrupt])
def test_an_error_in_any_thread_ends_the_work(kind, n_jobs):
    begun = []

    def work(i):
        begun.append(i)
        if i == 1:
            raise kind("broken")
        sleep(1e-4)

    with pytest.raises(kind, match="broken"):
        run([(i,) for i in range(10**5)], work, n_jobs)
    assert len(begun) < 10**5
