"""Work on all points of a cloud part by part, of which none is asked for as a whole."""

from sklearn_mcmd.runtime._chunks import run, slices

PART = 2**18  # points at once; it limits the memory


class Parts:
    """The points of a cloud in memory, whose parts threads work on: one cell of a larger one."""

    def __init__(self, n, n_jobs=None):
        self._n, self._n_jobs = n, n_jobs

    def each(self, work, *known, size=None):
        """The answers of ``work(part, *known)`` to slices of at most `size` rows, in order.

        The work changes nothing. What is known of points may be arrays or columns on disk: only
        some rows of these are asked for. It is a function of a module, so that others can run it.
        """
        return answers(work, slice(0, self._n), known, size, self._n_jobs)


def answers(work, rows, known, size=None, n_jobs=None):
    """The answers to the parts of a slice, as of `Parts`."""
    parts = slices(rows.stop, size or PART, rows.start)
    found = [None] * len(parts)

    def task(i, part):
        found[i] = work(part, *known)

    run(list(enumerate(parts)), task, n_jobs)
    return found
