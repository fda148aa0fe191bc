"""What a command leaves behind when it is told to end: nothing half-written."""

import signal
import threading
from contextlib import contextmanager

__all__ = ["tidy_when_terminated"]


@contextmanager
def tidy_when_terminated():
    """SIGTERM and SIGHUP raise SystemExit(128 + number), so that temporary files are removed.

    Signals that somebody else sees to (``nohup``, a verb around this one) stay theirs. SIGKILL
    cannot be caught: a file ``.mcmd-<hex>`` may stay, which no later run removes, because from
    another machine or container none can know whether its writer still runs.
    """

    def stop(number, frame):
        signal.signal(number, signal.SIG_IGN)  # a second one must not cut the tidying short
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
