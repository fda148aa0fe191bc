"""How signals end a program: at once, or when unfinished files are removed, or not any more."""

import os
import signal
import sys
import threading
from contextlib import contextmanager
from functools import partial

INTERRUPTED = 130  # the shells' 128 + SIGINT
AGAIN_AFTER = 0.05  # seconds

_seen = threading.Event()
_program = ""  # the name of the program that `handle_signals` is in force for
_depth = 0  # how many verbs run, one within another as the demo's do


def handle_signals(program):
    """Let Ctrl-C, SIGTERM and SIGHUP end this process, whose name Ctrl-C prints.

    At once, while there is nothing to clean up: during imports an exception may get lost. Some
    modules turn it into another one, and Python only prints an exception that is raised in a
    callback of the garbage collector. Within `raise_interrupts` by an exception.
    """
    global _program
    _program = program
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:  # as of nohup
            signal.signal(number, _handle)


def _handle(number, frame):
    if number != signal.SIGINT:
        signal.signal(number, signal.SIG_IGN)  # a second signal must not interrupt the tidying
    if not _depth:
        if number == signal.SIGINT:  # the system's write: `sys.stderr` may be in use
            os.write(2, f"{_program}: interrupted\n".encode())
        os._exit(128 + number)
    if number == signal.SIGINT:
        _seen.set()
        raise KeyboardInterrupt
    raise SystemExit(128 + number)


@contextmanager
def raise_interrupts():
    """Let signals raise KeyboardInterrupt, or SystemExit(128 + number), within a verb.

    So unfinished files are removed. After Ctrl-C `was_interrupted` is True, even if a library
    turned the interrupt into another exception. If Python ignored it in a callback, it is raised
    again. This does nothing in processes where `handle_signals` is not in force.

    SIGKILL cannot be caught, and a file ``.mcmd-<hex>`` may remain. No later run removes it: its
    writer may still run on another machine or in another container.
    """
    global _depth
    if not _program:
        yield
        return
    hook, _depth = sys.unraisablehook, _depth + 1
    sys.unraisablehook = partial(_raise_again, hook)
    try:
        yield
    finally:
        sys.unraisablehook, _depth = hook, _depth - 1


def _raise_again(hook, unraisable):
    """Send an interrupt again, which ends waiting and sleeping, too."""
    if unraisable.exc_type is not KeyboardInterrupt:
        hook(unraisable)
        return
    send, main = signal.raise_signal, threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):  # not on Windows
        send = partial(signal.pthread_kill, main)
    again = threading.Timer(AGAIN_AFTER, send, (signal.SIGINT,))
    again.daemon = True
    again.start()


def ignore_interrupts():
    """Ignore Ctrl-C to the end of the program, whose outputs are there or whose error is told.

    Python's own handlers are gone while it clears up, and Ctrl-C would kill it without a word. This
    does nothing in a verb that another one runs, nor in processes that are not ours.
    """
    if _program and _depth <= 1:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def ignoring_interrupts():
    """Ignore Ctrl-C within, where outputs are there and temporary files are removed."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN) if _program else None
    try:
        yield
    finally:
        if before is not None:
            signal.signal(signal.SIGINT, before)


def was_interrupted():
    """Whether Ctrl-C came within `raise_interrupts`."""
    return _seen.is_set()
