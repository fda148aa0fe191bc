"""Tasks in threads: each is done once, and errors end the work."""

from threading import Barrier, current_thread, get_ident, main_thread
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


def test_as_many_threads_work_as_there_are_jobs():
    together, seen = Barrier(3, timeout=600), set()

    def meet(i):
        seen.add(current_thread())
        together.wait()

    run([(i,) for i in range(6)], meet, 3)
    assert len(seen) == 3


def test_the_number_of_jobs_means_what_it_means_to_joblib():
    together = Barrier(2, timeout=600)
    with parallel_config(backend="threading", n_jobs=2):
        run([(i,) for i in range(4)], lambda i: together.wait(), None)
    assert threads_of(None) == threads_of(1) == 1
    with pytest.raises(ValueError, match="n_jobs == 0"):
        run([(0,), (1,)], print, 0)
    nested = Parallel(n_jobs=2, prefer="threads")(delayed(threads_of)(None) for _ in range(2))
    assert nested == [1, 1]


@pytest.mark.parametrize("in_main", [True, False])
@pytest.mark.parametrize("kind", [ValueError, KeyboardInterrupt])
def test_an_error_in_any_thread_ends_the_work(kind, in_main):
    begun, together = [], Barrier(2, timeout=600)

    def work(i):
        begun.append(i)
        if i < 2:
            together.wait()  # both threads are at work
            if (current_thread() is main_thread()) == in_main:
                raise kind("broken")
        sleep(1e-4)  # lets the thread that fails come to its turn

    with pytest.raises(kind, match="broken"):
        run([(i,) for i in range(10**5)], work, 2)
    assert len(begun) < 10**5
