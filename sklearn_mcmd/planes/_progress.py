"""Progress of long fits, for whoever shows it.

Estimators have no parameter for it, so that what is fitted stays apart from what is shown.
"""

from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache

__all__ = ["COMPILING", "current_span", "listen_to_progress", "progress_part", "watch_compilation"]

COMPILING = "compiling for this computer (once; then kept on disk)"

_span = ContextVar("sklearn_mcmd_progress", default=None)
_listeners = []  # in force, for compilation, which may come in any thread


@dataclass(frozen=True)
class Span:
    """A part of the whole work, from `low` to `high` of it, and the stage that it is of."""

    listener: object
    low: float
    high: float
    stage: str

    def tell(self, share):
        """That so much of this part is done, from 0 to 1; from any thread."""
        self.listener(self.stage, self.low + share * (self.high - self.low))


@contextmanager
def listen_to_progress(listener):
    """Have ``listener(stage, share)`` called, from any thread, as the work within is done.

    `share` is of the whole, from 0 to 1. It is None where only the stage is news: `COMPILING`
    while that lasts, and None once what was going on goes on. A listener None hears nothing.
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
    """Let what is within be this part of what is around, of a stage of its own if that is named."""
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
    """The part of the work that this context does, or None if nobody listens."""
    return _span.get()


@cache
def watch_compilation():
    """Tell listeners when Numba compiles; to be called once it is imported."""
    try:
        from numba.core import event
    except ImportError:  # that place is documented, but not for ever
        return

    class Compilation(event.Listener):
        depth = 0  # functions compile those that they call

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
