"""Ctrl-C in a program: one line and exit code 130, until its outputs are there."""

import os
import signal
import sys
import threading
from contextlib import contextmanager

__all__ = [
    "INTERRUPTED",
    "exit_at_once",
    "ignore_interrupts",
    "ignoring_interrupts",
    "raise_interrupts",
    "was_interrupted",
]

INTERRUPTED = 130  # the shells' 128 + SIGINT
AGAIN_AFTER = 0.05  # seconds

_seen = threading.Event()
_exit = None  # the handler that ends the program; None in a process that is not ours
_within = 0  # how many verbs run within another one, as the demo's do


def exit_at_once(name):
    """Let Ctrl-C end this process with one line of this name, while there is nothing to clean up.

    While modules are imported an exception may get lost. Some modules turn it into another one, and
    Python only prints an exception that is raised in a callback of the garbage collector.
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
    global _within
    if not _is_ours() or signal.getsignal(signal.SIGINT) is not _exit:
        _within += 1
        try:
            yield
        finally:
            _within -= 1
        return
    hook = sys.unraisablehook

    def raise_again(unraisable):
        if unraisable.exc_type is KeyboardInterrupt:
            again = threading.Timer(AGAIN_AFTER, _interrupt_main_thread)
            again.daemon = True
            again.start()
        else:
            hook(unraisable)

    sys.unraisablehook = raise_again
    signal.signal(signal.SIGINT, _raise)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is _raise:  # not ignored since
            signal.signal(signal.SIGINT, _exit)
        sys.unraisablehook = hook


def ignore_interrupts():
    """Ignore Ctrl-C to the end of the program, whose outputs are there or whose error is told.

    Python's own handlers are gone while it clears up, and Ctrl-C would kill it without a word. This
    does nothing in a verb that another one runs, nor in processes that are not ours.
    """
    if _is_ours() and not _within:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def ignoring_interrupts():
    """Ignore Ctrl-C within, where outputs are there and temporary files are removed."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if _is_ours() else None
    try:
        yield
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)


def was_interrupted():
    """Whether Ctrl-C came within `raise_interrupts`."""
    return _seen.is_set()


def _is_ours():
    """Whether `exit_at_once` is in force, and this is the thread that may handle signals."""
    return _exit is not None and threading.current_thread() is threading.main_thread()


def _interrupt_main_thread():
    if hasattr(signal, "pthread_kill"):  # ends waiting and sleeping, too
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)
    else:  # Windows
        signal.raise_signal(signal.SIGINT)


def _raise(*_):
    _seen.set()
    raise KeyboardInterrupt
