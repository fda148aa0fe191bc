"""What verbs say: errors, warnings, progress and summaries."""

import logging
import re
import sys
import threading
import time
import warnings
from contextlib import contextmanager, nullcontext

import typer

from sklearn_mcmd._errors import ParameterError, ParameterWarning, counted
from sklearn_mcmd.runtime._interrupts import INTERRUPTED, raise_interrupts, was_interrupted
from sklearn_mcmd.runtime._progress import listen_to_progress

# Without a terminal: a stage is named after PATIENCE seconds, then progress is printed every AGAIN
# seconds.
PATIENCE, AGAIN = 5.0, 60.0


@contextmanager
def clear_exits(*, allow_coarse=False):
    """Turn each error that a user can meet into one line on stderr and an exit code.

    Coordinates that float32 rounds too coarsely are an error unless `allow_coarse`.
    """
    try:
        with _plain_warnings(allow_coarse), raise_interrupts():
            yield
    except typer.Exit:  # from a verb within a verb, which has said why
        raise
    except BaseException as err:
        if isinstance(err, KeyboardInterrupt) or was_interrupted():
            typer.echo("mcmd: interrupted", err=True)
            raise typer.Exit(INTERRUPTED) from None
        if isinstance(err, BrokenPipeError):
            raise
        if type(err).__name__ == "InvalidParameterError":  # of scikit-learn: wrong usage
            raise _wrong_parameter(err) from None
        file = "".join(getattr(err, "__notes__", ()))  # of the work on its points
        if isinstance(err, MemoryError):
            _fail(f"{file}not enough memory; take fewer points or a smaller --n-neighbors")
        if isinstance(err, ValueError | OSError | ImportError):
            _fail(file + (_in_words(err) or type(err).__name__))
        if fact := _coarse_fact(err):
            _fail(
                f"{file}{fact}. Write the file in double precision, as LAS, LAZ or text, or "
                "subtract an offset where it is made; or give --allow-coarse"
            )
        raise


def _fail(message):
    typer.echo(f"mcmd: error: {_printable(' '.join(message.split()))}", err=True)
    raise typer.Exit(1)


def _wrong_parameter(err):
    """The same error with an option in place of a parameter of Python."""
    pattern = r"The '(\w+)' parameter of \w+ (must be .*)"
    ((name, words),) = re.findall(pattern, str(err), re.DOTALL)
    words = re.sub(r"(, | or )(a str among \{.*?\}|None)", "", words)  # options are numbers
    return typer.BadParameter(words, param_hint=_option(name, None))


def _in_words(err):
    """The error and its file, without Python's names."""
    if isinstance(err, OSError) and err.strerror:
        about = f"{err.filename}: " if err.filename else ""
        return f"{about}{err.strerror.lower()}"
    return _of_options(err)


def _of_options(said):
    """What an error or a warning says, and what it repeats of its cause, with options as names."""
    if isinstance(said, ParameterError | ParameterWarning):
        return said.worded(_option).replace(" points is ", " points are ")  # of $n_samples
    words, cause = str(said), str(said.__cause__ or "")
    return words.replace(cause, _of_options(said.__cause__)) if cause else words


def _option(name, value):
    if name == "n_samples":
        return counted(value, "point")
    if name == "row":
        return f"point {value + 1}"
    if name == "columns":
        return "--columns " + ",".join(f"{axis}={column}" for axis, column in value.items())
    words = {"X": "the cloud", "sensor_origin": "--sensor"}
    return words.get(name) or f"--{name.replace('_', '-').replace('=', ' ')}"


def _coarse_fact(said):
    """What a `CoarseCoordinatesWarning` says of the coordinates; "" of any other."""
    return said.fact if type(said).__name__ == "CoarseCoordinatesWarning" else ""


class _Shown:
    """Shows each warning for users once, in one line, and keeps it in `told`, for `warned`."""

    def __init__(self, allow_coarse):
        self.allow_coarse, self.told = allow_coarse, []

    def __call__(self, message, category, *args, **kwargs):
        fact = _coarse_fact(message)
        if fact and not self.allow_coarse:
            raise message
        text = _printable(" ".join((fact or _of_options(message)).split()))
        if text not in self.told:
            self.told.append(text)
            typer.echo(f"mcmd: warning: {text}", err=True)


@contextmanager
def _plain_warnings(allow_coarse):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", UserWarning)
        # Deprecations are for programmers, though some libraries derive them from UserWarning.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.showwarning = _Shown(allow_coarse)
        logging.getLogger("matplotlib").setLevel(logging.ERROR)  # it tells where it keeps fonts
        yield


def warned():
    """What the run has warned of until now, as on the terminal."""
    return getattr(warnings.showwarning, "told", [])


def print_table(title, begin=None, **rows):
    """A title and aligned lines of names and values; the last one, the seconds since the begin."""
    if begin is not None:
        rows["seconds"] = f"{time.perf_counter() - begin:.1f}"
    typer.echo(_printable(title))
    width = max(map(len, rows))
    for name, value in rows.items():
        typer.echo(_printable(f"  {name:<{width}}  {value}"))


def _printable(words):
    """One line, in which names of files and of what they hold do not steer the terminal."""
    return "".join(c if c.isprintable() else "?" for c in str(words))


def number_and_share(n, n_all):
    return f"{n:,} ({100 * n / n_all:.2f} %)"


@contextmanager
def progress(title, quiet):
    """Show on stderr the progress that ``progress_part`` and estimators report within."""
    from rich.console import Console

    console = Console(stderr=True)
    show = _bars if console.is_terminal else _lines
    with nullcontext() if quiet else show(title, console) as listener, listen_to_progress(listener):
        yield


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
                if told.stage and task and task.description == name:
                    done = max(task.completed, told.part)  # threads may be late
                    bars.update(task.id, completed=done, note=told.note)
                elif told.stage:
                    if task:
                        bars.update(task.id, completed=1.0, note="")
                    bars.add_task(name, total=1.0, note=told.note)

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
