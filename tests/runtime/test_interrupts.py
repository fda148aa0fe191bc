"""Signals, met by real processes: one line and an exit code, until the outputs are there."""

import os
import subprocess
import sys

import numpy as np
import pytest

from commands import files_in
from sklearn_mcmd.planes._nearest import COMPILE_FROM

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")

# The program meets a signal at a moment of its own, which does not depend on how fast it is.
SEND = """
import os, signal, sys

def ctrl_c():
    os.kill(os.getpid(), signal.SIGINT)
"""
MAIN = """
from sklearn_mcmd.__main__ import main
main()
"""
IMPORTING = """
class Finder:
    def find_spec(self, name, *rest):
        if name == "numpy":
            ctrl_c()

sys.meta_path.insert(0, Finder())
"""
COMPILING = """
from numba.core import event

class Listener(event.Listener):
    def on_start(self, event):
        ctrl_c()

    def on_end(self, event):
        pass

event.register("numba:compile", Listener())
"""
# The rehearsal is of one point.
WRITING = """
import time
from sklearn_mcmd.io import _formats

def stuck(path, cloud):
    path.write_text("half of it")
    if len(cloud) > 1:
        os.kill(os.getpid(), signal.{name})
        time.sleep(3600)

known = _formats._BY_EXTENSION
known[".xyz"] = known[".xyz"]._replace(write=stuck)
"""
SUMMING_UP = """
from sklearn_mcmd.cli import _messages

told = _messages.print_table

def tell_late(*args, **kwargs):
    ctrl_c()
    told(*args, **kwargs)

_messages.print_table = tell_late
"""
# Python calls the first while its handlers are in force, and the second when they are gone.
CLEARING_UP = """
import atexit

class Late:
    def __del__(self, kill=os.kill, own=os.getpid(), number=signal.SIGINT):
        kill(own, number)

atexit.register(ctrl_c)
late = Late()
"""


def outcome_of(moment, *args, **variables):
    """Exit code, stdout and stderr of a command that meets a signal."""
    done = subprocess.run(
        [sys.executable, "-c", SEND + moment + MAIN, *map(str, args)],
        capture_output=True,
        text=True,
        env=os.environ | variables,
    )
    return done.returncode, done.stdout, done.stderr


def test_ctrl_c_ends_in_one_line_while_modules_are_imported(room_file, tmp_path):
    outcome = outcome_of(IMPORTING, "denoise", room_file, tmp_path / "out.npy")
    assert outcome == (130, "", "mcmd: interrupted\n")
    assert files_in(tmp_path) == ["room.laz"]


def test_ctrl_c_ends_in_one_line_while_code_is_compiled(tmp_path):
    np.save(tmp_path / "in.npy", np.random.default_rng(0).uniform(size=(COMPILE_FROM, 3)))
    command = "denoise", tmp_path / "in.npy", tmp_path / "out.npy", "--quiet"
    (tmp_path / "compiled").mkdir()
    outcome = outcome_of(COMPILING, *command, NUMBA_CACHE_DIR=str(tmp_path / "compiled"))
    assert outcome == (130, "", "mcmd: interrupted\n")
    assert files_in(tmp_path) == ["compiled", "in.npy"]


@pytest.mark.parametrize(
    ("moment", "expected"),
    [
        (WRITING.format(name="SIGINT"), 130),
        (WRITING.format(name="SIGTERM"), 143),
    ],
)
def test_a_signal_during_the_work_leaves_no_file(moment, expected, tmp_path):
    np.save(tmp_path / "in.npy", np.random.default_rng(0).uniform(size=(60, 3)) * [1, 1, 0.01])
    code, out, err = outcome_of(moment, "plane", tmp_path / "in.npy", tmp_path / "out.xyz")
    assert (code, out) == (expected, "")
    if code == 130:
        assert err.splitlines()[-1] == "mcmd: interrupted"  # a slow machine tells its progress
    assert files_in(tmp_path) == ["in.npy"]


def test_ctrl_c_comes_too_late_when_the_output_is_there(room_file, tmp_path):
    code, out, _ = outcome_of(SUMMING_UP, "view", room_file, "-o", tmp_path / "out.html")
    assert code == 0
    assert "points" in out
    assert files_in(tmp_path) == ["out.html", "room.laz"]


def test_ctrl_c_does_not_change_how_a_command_has_ended_while_python_clears_up(room_file, tmp_path):
    assert outcome_of(CLEARING_UP, "info", room_file)[0] == 0
    code, _, err = outcome_of(CLEARING_UP, "info", tmp_path / "none.laz")
    assert (code, err) == (1, f"mcmd: error: {tmp_path / 'none.laz'}: no such file\n")


WITHIN_ANOTHER = """
with raise_interrupts():
    with raise_interrupts():
        ignore_interrupts()
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        print("interrupted")
    ignore_interrupts()
    signal.raise_signal(signal.SIGINT)
signal.raise_signal(signal.SIGINT)
"""
TURNED_INTO_ANOTHER_ERROR = """
import typer
from sklearn_mcmd.cli._messages import clear_exits
try:
    with clear_exits():
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException:
            raise ImportError("cannot import half of it")
except typer.Exit as end:
    print(end.exit_code)
"""
FORGOTTEN_BY_A_CALLBACK = """
import time
class Forgets:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
try:
    with raise_interrupts():
        Forgets()
        begin = time.monotonic()
        time.sleep(600)
        print("forgotten")
except KeyboardInterrupt:
    print("came again", time.monotonic() - begin < 500)
"""
IGNORED = """
both = signal.SIGINT, signal.SIGHUP  # as of nohup
for number in both:
    signal.signal(number, signal.SIG_IGN)
handle_signals("mcmd")
for number in both:
    signal.raise_signal(number)
"""


@pytest.mark.parametrize(
    ("code", "printed", "error"),
    [
        (WITHIN_ANOTHER, "interrupted\n", ""),
        (TURNED_INTO_ANOTHER_ERROR, "130\n", "mcmd: interrupted\n"),
        (FORGOTTEN_BY_A_CALLBACK, "came again True\n", ""),
        (IGNORED, "", ""),
    ],
    ids=["within", "turned", "forgotten", "ignored"],
)
def test_ctrl_c_is_an_interruption_where_and_while_it_may_be(code, printed, error):
    """A verb within another one does not end its interrupts; libraries may turn one into another
    error, or a callback forget it; and what a process ignores stays ignored."""
    begin = (
        "import signal\nfrom sklearn_mcmd.runtime._interrupts import *\nhandle_signals('mcmd')\n"
    )
    command = [sys.executable, "-c", f"{begin}{code}\nprint('goes on')"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (f"{printed}goes on\n", error)
