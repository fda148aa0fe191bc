"""The progress of a verb: a bar for each stage on a terminal, elsewhere a few lines."""

import sys
import threading
import time
from contextlib import contextmanager, nullcontext

from sklearn_mcmd.runtime._progress import listen_to_progress, progress_part

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

    console = Console(stderr=True)
    show = _bars if console.is_terminal else _lines
    shown = nullcontext() if quiet else show(title, console)
    with shown as state, listen_to_progress(state and state.hear):
        yield progress_part


class _State:
    """The progress of the work, which never decreases, and of its stage."""

    def __init__(self, changed=lambda state: None):
        self.stage, self.note, self.compiling = "", "", None
        self.share = self.part = 0.0
        self.since = time.monotonic()
        self.changed = changed
        self.lock = threading.Lock()

    @property
    def doing(self):
        return self.compiling or self.stage

    def hear(self, told):
        with self.lock:
            before = self.doing
            if told.share is None:
                self.compiling = told.stage
            else:
                self.share = max(self.share, told.share)
                if told.stage:  # else between stages
                    same = told.stage == self.stage
                    self.part = max(self.part, told.part) if same else told.part
                    self.stage, self.note = told.stage, told.note
            if self.doing != before:
                self.since = time.monotonic()
            self.changed(self)


@contextmanager
def _bars(title, console):
    """A bar for each stage; those that are done show how long they took."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeLeft(elapsed_when_finished=True),
        TextColumn("{task.fields[note]}", style="dim"),
    )
    with Progress(*columns, console=console, transient=True) as bars:
        shown, current = None, None

        def changed(state):
            nonlocal shown, current
            if state.stage and state.stage != shown:
                if current is not None:
                    bars.update(current, completed=1.0, note="")
                shown = state.stage
                current = bars.add_task(f"{title}: {shown}", total=1.0, note="")
            if current is not None:
                note = state.compiling or state.note
                bars.update(current, completed=state.part, note=note)

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
                doing, note, share = state.doing, state.note, state.share
                lasted = now - state.since
            news = doing != told and lasted >= PATIENCE
            if doing and (news or now - at >= AGAIN):
                told, at = doing, now
                doing_so = f"{doing}, {note}" if note else doing
                line = f"mcmd: {title}: {doing_so}, {100 * share:.0f} % done, {now - start:.0f} s"
                print(line, file=sys.stderr, flush=True)

    thread = threading.Thread(target=tell, daemon=True)
    thread.start()
    try:
        yield state
    finally:
        done.set()
        thread.join()
