"""Removal of unfinished files when a command is told to end."""

import signal
import threading
from contextlib import contextmanager

__all__ = ["tidy_when_terminated"]


@contextmanager
def tidy_when_terminated():
    """SIGTERM and SIGHUP raise SystemExit(128 + number), so that temporary files are removed.

    Signals that others handle (``nohup``, a verb around this one) are not changed. SIGKILL cannot
    be caught, and a file ``.mcmd-<hex>`` may remain. No later run removes it, because its writer
    may still run on another machine or in another container.
    """

    def stop(number, frame):
        signal.signal(number, signal.SIG_IGN)  # a second signal must not interrupt the tidying
        raise SystemExit(128 + number)

    ours = []
    try:
        if threading.current_thread() is threading.main_thread():
            for name in ("SIGTERM", "SIGHUP"):
                number = getattr(signal, name, None)  # Windows has no SIGHUP
                if number is not None and signal.getsignal(number) is signal.SIG_DFL:
                    ours.append(number)
                    signal.signal(number, stop)
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)
