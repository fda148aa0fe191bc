"""Progress of long fits, for whoever shows it."""

from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["current_listener", "listen_to_progress"]

_listener = ContextVar("sklearn_mcmd_progress", default=None)


@contextmanager
def listen_to_progress(listener):
    """Have ``listener(n_done, n_total)`` called, from any thread, as planes are fitted.

    Estimators have no parameter for it, so that what is fitted stays apart from what is shown.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def current_listener():
    """The listener of this context, or None."""
    return _listener.get()
