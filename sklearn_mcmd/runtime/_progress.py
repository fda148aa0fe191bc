"""Progress of long work, for what shows it, such as the command line.

Estimators have no parameter for it: fitting does not depend on what is shown.
"""

import logging
import sys
from collections.abc import Callable
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

COMPILING = "compiling for this computer (once; then kept on disk)"  # or as `_compiling` says

_span = ContextVar("sklearn_mcmd_progress", default=None)
_listeners: list = []  # those in force; any thread may compile and report


class Progress(NamedTuple):
    """What a listener hears of the work."""

    # What is done. With a share of None: what is compiled, or None when that is done.
    stage: str | None
    share: float | None  # of the whole work that is done, from 0 to 1
    part: float = 0.0  # share of the stage
    note: str = ""  # what else there is to say, such as a rate


@dataclass(frozen=True)
class Span:
    """A part of the whole work, from share `low` to share `high`, in a stage with its own ends."""

    listener: Callable
    low: float = 0.0
    high: float = 1.0
    stage: str = ""
    begin: float = 0.0
    end: float = 1.0
    note: str = ""

    def report(self, share):
        """Say that this share of the part is done, from 0 to 1; any thread may call it."""
        done = self.low + share * (self.high - self.low)
        length = self.end - self.begin
        part = (done - self.begin) / length if length > 0 else share
        self.listener(Progress(self.stage, done, min(max(part, 0.0), 1.0), self.note))

    def within(self, low, high, stage=None):
        """A part of this part; with a name, it is a stage."""
        length = self.high - self.low
        low, high = self.low + low * length, self.low + high * length
        span = replace(self, low=low, high=high)
        return span if stage is None else replace(span, stage=stage, begin=low, end=high, note="")


@contextmanager
def listen_to_progress(listener):
    """Call ``listener(progress)``, from any thread, while the work within proceeds.

    Its stage is `COMPILING` when compilation begins, and None when it ends and the work goes on. A
    listener of None is not called.
    """
    _listeners.append(listener)
    try:
        with heard_by(listener):
            yield
    finally:
        _listeners.remove(listener)


def heard_by(listener):
    """The same but for compilation, which all programs that show progress hear of."""
    return _in_span(None if listener is None else Span(listener))


@contextmanager
def _in_span(span):
    token = _span.set(span)
    try:
        yield span
    finally:
        _span.reset(token)


@contextmanager
def progress_part(low, high, stage=None):
    """Count the work within as this part of the work around it; `stage` names it, if given."""
    whole = _span.get()
    if whole is None:
        yield
        return
    with _in_span(whole.within(low, high, stage)) as span:
        span.report(0.0)
        yield
        span.report(1.0)


def current_span():
    """The part of the work that this context does, or None without a listener."""
    return _span.get()


def report_share(share, note=""):
    """Report what share of this part of the work is done, and what else there is to say of it."""
    if span := _span.get():
        replace(span, note=note).report(share)


@cache
def watch_compilation():
    """Tell listeners when Numba compiles. Call this after Numba is imported."""
    from numba.core import event

    class Compilation(event.Listener):
        depth, said = 0, False  # compiling a function compiles those that it calls

        def on_start(self, event):
            self.depth += 1
            _report_to_all(COMPILING)
            if not (_listeners or self.said) and _is_own(event):
                self.said = True
                _print_or_log(f"sklearn_mcmd: {COMPILING}")

        def on_end(self, event):
            self.depth -= 1
            if self.depth == 0:
                _report_to_all(None)

    event.register("numba:compile", Compilation())


def _is_own(event):
    """Whether a function of this package is compiled, and not another one of the process."""
    function = getattr((event.data or {}).get("dispatcher"), "py_func", None)
    return getattr(function, "__module__", "").startswith("sklearn_mcmd.")


def _print_or_log(line):
    """Log a line, or print it where somebody waits at a terminal or a notebook.

    ``logging.getLogger("sklearn_mcmd").setLevel("WARNING")`` silences both.
    """
    logger = logging.getLogger("sklearn_mcmd")
    if logger.isEnabledFor(logging.INFO):
        logger.info(line)
    elif logger.level == logging.NOTSET and _somebody_waits():
        print(line, file=sys.stderr, flush=True)


def _somebody_waits():
    """Not of workers, whose parent says it; nor of servers and tests, which write elsewhere."""
    import multiprocessing

    if multiprocessing.current_process().name != "MainProcess" or sys.stderr is None:
        return False
    return sys.stderr.isatty() or "ipykernel" in sys.modules


def _report_to_all(stage):
    if _listeners and _listeners[-1] is not None:
        _listeners[-1](Progress(stage, None))
