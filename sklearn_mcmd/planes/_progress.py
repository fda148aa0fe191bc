"""Progress of long fits, for programs that show it.

Estimators have no parameter for it: fitting does not depend on what is shown.
"""

import logging
import multiprocessing
import sys
import time
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache

__all__ = ["COMPILING", "current_span", "listen_to_progress", "progress_part", "watch_compilation"]

COMPILING = "compiling for this computer (once; then kept on disk)"
PATIENCE = 1.0  # seconds of compiling that pass without a word where nobody listens

_span = ContextVar("sklearn_mcmd_progress", default=None)
_listeners = []  # those in force; any thread may compile and tell them


@dataclass(frozen=True)
class Span:
    """A part of the whole work, from share `low` to share `high`, and the name of its stage."""

    listener: object
    low: float
    high: float
    stage: str

    def tell(self, share):
        """Say that this share of the part is done, from 0 to 1; any thread may call it."""
        self.listener(self.stage, self.low + share * (self.high - self.low))


@contextmanager
def listen_to_progress(listener):
    """Call ``listener(stage, share)``, from any thread, while the work within proceeds.

    `share` is the share of the whole work, from 0 to 1. It is None where only the stage changes:
    to `COMPILING` when compilation begins, and to None when it ends and the work goes on. A
    listener of None is not called.
    """
    token = _span.set(None if listener is None else Span(listener, 0.0, 1.0, ""))
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)
        _span.reset(token)


@contextmanager
def progress_part(low, high, stage=None):
    """Count the work within as this part of the work around it; `stage` names it, if given."""
    whole = _span.get()
    if whole is None:
        yield
        return
    length = whole.high - whole.low
    span = Span(
        whole.listener,
        whole.low + low * length,
        whole.low + high * length,
        whole.stage if stage is None else stage,
    )
    token = _span.set(span)
    try:
        span.tell(0.0)
        yield
        span.tell(1.0)
    finally:
        _span.reset(token)


def current_span():
    """The part of the work that this context does, or None without a listener."""
    return _span.get()


@cache
def watch_compilation():
    """Tell listeners when Numba compiles. Call this after Numba is imported."""
    try:
        from numba.core import event
    except ImportError:  # this place is documented, but may change
        return

    class Compilation(event.Listener):
        depth = 0  # compiling a function compiles those that it calls
        since, own, spent, said = 0.0, False, 0.0, False

        def on_start(self, event):
            if self.depth == 0:
                self.since, self.own = time.monotonic(), _is_own(event)
            self.depth += 1
            _tell_all(COMPILING)
            lasted = self.spent + time.monotonic() - self.since
            if self.own and lasted >= PATIENCE and not self.said and not _listeners:
                self.said = True
                _say(f"sklearn_mcmd: {COMPILING}")

        def on_end(self, event):
            self.depth -= 1
            if self.depth == 0:
                self.spent += time.monotonic() - self.since if self.own else 0.0
                _tell_all(None)

    event.register("numba:compile", Compilation())


def _is_own(event):
    """Whether a function of this package is compiled, and not another one of the process."""
    function = getattr((event.data or {}).get("dispatcher"), "py_func", None)
    return getattr(function, "__module__", "").startswith("sklearn_mcmd.")


def _say(line):
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
    if multiprocessing.current_process().name != "MainProcess" or sys.stderr is None:
        return False
    return sys.stderr.isatty() or "ipykernel" in sys.modules


def _tell_all(stage):
    if _listeners and _listeners[-1] is not None:
        _listeners[-1](stage, None)
