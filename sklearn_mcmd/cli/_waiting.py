"""The progress of a verb: one bar on a terminal, elsewhere a few lines."""

import sys
import threading
import time
from contextlib import contextmanager

__all__ = ["progress"]

# Without a terminal: a stage is named after PATIENCE seconds, then progress is printed every AGAIN
# seconds.
PATIENCE, AGAIN = 5.0, 60.0


@contextmanager
def progress(title, quiet):
    """Show on stderr the progress that ``progress_part`` and estimators report within.

    Yields ``progress_part``, which names the parts of the work.
    """
    from rich.console import Console

    from sklearn_mcmd.planes._progress import listen_to_progress, progress_part

    console = Console(stderr=True)
    if quiet:
        show = _nothing
    elif console.is_terminal:
        show = _bar
    else:
        show = _lines
    with show(title, console) as state, listen_to_progress(state and state.hear):
        yield progress_part


class _State:
    """The progress of the work, which never decreases."""

    def __init__(self, changed=lambda state: None):
        self.stage, self.compiling, self.share = "", None, 0.0
        self.since = time.monotonic()
        self.changed = changed
        self.lock = threading.Lock()

    @property
    def doing(self):
        return self.compiling or self.stage

    def hear(self, stage, share):
        with self.lock:
            before = self.doing
            if share is None:
                self.compiling = stage
            else:
                self.stage, self.share = stage, max(self.share, share)
            if self.doing != before:
                self.since = time.monotonic()
            self.changed(self)


@contextmanager
def _nothing(title, console):
    yield None


@contextmanager
def _bar(title, console):
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeLeft())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)

        def changed(state):
            bar.update(task, completed=state.share, description=f"{title}: {state.doing}")

        yield _State(changed)


@contextmanager
def _lines(title, console):
    state, done = _State(), threading.Event()
    start = time.monotonic()

    def tell():
        told, at = None, start
        while not done.wait(0.2):
            now = time.monotonic()
            with state.lock:
                doing, lasted, share = state.doing, now - state.since, state.share
            news = doing != told and lasted >= PATIENCE
            if news or now - at >= AGAIN:
                told, at = doing, now
                line = f"mcmd: {title}: {doing}, {100 * share:.0f} % done, {now - start:.0f} s"
                print(line, file=sys.stderr, flush=True)

    thread = threading.Thread(target=tell, daemon=True)
    thread.start()
    try:
        yield state
    finally:
        done.set()
        thread.join()
