"""The progress of a verb: a bar for each stage on a terminal, elsewhere a few lines."""

import sys
import threading
import time
from contextlib import contextmanager, nullcontext

from sklearn_mcmd.runtime._progress import listen_to_progress, progress_part

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
    with nullcontext() if quiet else show(title, console) as listener, listen_to_progress(listener):
        yield progress_part


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
    lock = threading.Lock()  # any thread may tell of progress
    with Progress(*columns, console=console, transient=True) as bars:

        def hear(told):
            with lock:
                task = bars.tasks[-1] if bars.tasks else None
                if told.share is None and task:  # while something is compiled
                    bars.update(task.id, note=told.stage or "")
                    return
                name = f"{title}: {told.stage}"
                if told.stage and (task is None or task.description != name):
                    if task:
                        bars.update(task.id, completed=1.0, note="")
                    bars.add_task(name, total=1.0, note=told.note)
                elif told.stage:
                    done = max(task.completed, told.part)  # threads may be late
                    bars.update(task.id, completed=done, note=told.note)

        yield hear


@contextmanager
def _lines(title, console):
    start = since = last = time.monotonic()
    stage, share, named, lock = "", 0.0, "", threading.Lock()

    def hear(told):
        nonlocal since, last, stage, share, named
        with lock:
            now, share = time.monotonic(), max(share, told.share or 0.0)
            if told.stage and told.stage != stage:
                stage, since = told.stage, now
            is_long = stage != named and now - since >= PATIENCE
            if is_long or (stage and now - last >= AGAIN):
                named, last = stage, now
                doing = f"{stage}, {told.note}" if told.note else stage
                line = f"mcmd: {title}: {doing}, {100 * share:.0f} % done, {now - start:.0f} s"
                print(line, file=sys.stderr, flush=True)

    yield hear
