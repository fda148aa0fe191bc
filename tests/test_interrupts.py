"""Ctrl-C, sent to real processes: one line and 130, whenever it comes."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from commands import files_in
from sklearn_mcmd.io import write_points

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")

# Once our code runs, so that the delay does not depend on how long the interpreter starts.
STARTED = (
    "import sys; print('started', flush=True); "
    "from sklearn_mcmd.__main__ import main; sys.argv[0] = 'mcmd'; main()"
)


def interrupt(delay, *args):
    """Outcome of a command that Ctrl-C meets `delay` seconds after its start."""
    process = subprocess.Popen(
        [sys.executable, "-c", STARTED, *map(str, args)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    process.stdout.readline()
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    return process.returncode, stderr


@pytest.mark.parametrize("delay", [0.05, 0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.4])
def test_ctrl_c_ends_in_one_line_while_modules_are_imported_and_while_planes_are_fitted(
    delay, tmp_path
):
    X = np.random.default_rng(0).uniform(size=(60_000, 3))
    write_points(tmp_path / "in.npy", X)
    outcome = interrupt(delay, "denoise", tmp_path / "in.npy", tmp_path / "out.npy")
    assert outcome == (130, "mcmd: interrupted\n")
    assert files_in(tmp_path) == ["in.npy"]


def test_ctrl_c_that_a_library_turns_into_another_error_is_still_an_interruption():
    code = (
        "import signal\n"
        "from sklearn_mcmd._interrupts import exit_at_once\n"
        "exit_at_once('mcmd')\n"
        "import typer\n"
        "from sklearn_mcmd.cli._speech import clear_exits\n"
        "try:\n"
        "    with clear_exits():\n"
        "        try:\n"
        "            signal.raise_signal(signal.SIGINT)\n"
        "        except BaseException:\n"
        "            raise ImportError('cannot import half of it')\n"
        "except typer.Exit as end:\n"
        "    print(end.exit_code)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("130\n", "mcmd: interrupted\n")


def test_ctrl_c_that_a_callback_forgets_comes_again():
    code = (
        "import signal, time\n"
        "from sklearn_mcmd._interrupts import exit_at_once, raise_interrupts\n"
        "exit_at_once('mcmd')\n"
        "class Forgets:\n"
        "    def __del__(self):\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "try:\n"
        "    with raise_interrupts():\n"
        "        Forgets()\n"
        "        time.sleep(20)\n"
        "        print('forgotten')\n"
        "except KeyboardInterrupt:\n"
        "    print('came again')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("came again\n", "")


def test_a_process_that_ignores_ctrl_c_goes_on_ignoring_it():
    code = (
        "import signal\n"
        "from sklearn_mcmd._interrupts import exit_at_once\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "exit_at_once('mcmd')\n"
        "signal.raise_signal(signal.SIGINT)\n"
        "print('goes on')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "goes on\n")
