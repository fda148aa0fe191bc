"""Progress of long fits, for programs that show it.

Estimators have no parameter for it: fitting does not depend on what is shown.
"""

from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache

__all__ = ["COMPILING", "current_span", "listen_to_progress", "progress_part", "watch_compilation"]

COMPILING = "compiling for this computer (once; then kept on disk)"

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

        def on_start(self, event):
            self.depth += 1
            _tell_all(COMPILING)

        def on_end(self, event):
            self.depth -= 1
            if self.depth == 0:
                _tell_all(None)

    event.register("numba:compile", Compilation())


def _tell_all(stage):
    if _listeners and _listeners[-1] is not None:
        _listeners[-1](stage, None)
