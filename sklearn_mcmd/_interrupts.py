"""Ctrl-C in a program: one line and exit code 130, at any moment."""

import os
import signal
import sys
import threading
from contextlib import contextmanager

__all__ = ["INTERRUPTED", "exit_at_once", "raise_interrupts", "was_interrupted"]

INTERRUPTED = 130  # the shells' 128 + SIGINT
AGAIN_AFTER = 0.05  # seconds

_seen = threading.Event()
_exit = None  # the handler that ends the program; None in a process that is not ours


def exit_at_once(name):
    """Let Ctrl-C end this process with one line, while there is nothing to clean up.

    While modules are imported an exception may get lost. Some modules turn it into another one, and
    Python only prints an exception that is raised in a callback of the garbage collector.

    Parameters
    ----------
    name : str
        Name of the program, with which its line begins.
    """
    global _exit

    def end(*_):
        # The system's write, because `sys.stderr` may be in use at this moment.
        os.write(2, f"{name}: interrupted\n".encode())
        os._exit(INTERRUPTED)

    _exit = end
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # nohup ignores it
        signal.signal(signal.SIGINT, end)


@contextmanager
def raise_interrupts():
    """Let Ctrl-C raise KeyboardInterrupt within, so that unfinished files are removed.

    Then `was_interrupted` is True, even if a library turned the interrupt into another exception.
    If Python ignored it in a callback, it is raised again. This does nothing in processes and
    threads where `exit_at_once` is not in force.
    """
    ours = _exit is not None and signal.getsignal(signal.SIGINT) is _exit
    if not ours or threading.current_thread() is not threading.main_thread():
        yield
        return
    hook = sys.unraisablehook

    def raise_again(unraisable):
        if unraisable.exc_type is KeyboardInterrupt:
            again = threading.Timer(AGAIN_AFTER, signal.raise_signal, [signal.SIGINT])
            again.daemon = True
            again.start()
        else:
            hook(unraisable)

    sys.unraisablehook = raise_again
    signal.signal(signal.SIGINT, _raise)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, _exit)
        sys.unraisablehook = hook


def was_interrupted():
    """Whether Ctrl-C came within `raise_interrupts`."""
    return _seen.is_set()


def _raise(*_):
    _seen.set()
    raise KeyboardInterrupt
