"""Commands that are told to end: no half-written file stays behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from commands import files_in
from sklearn_mcmd.cli._termination import tidy_when_terminated

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")

# The final writing of `mcmd denoise` gets stuck halfway; the rehearsal is of one point.
STUCK = """
import sys, time
from sklearn_mcmd.io import _formats
from sklearn_mcmd.__main__ import main

def stuck(path, cloud):
    path.write_text("half of it")
    if len(cloud) > 1:
        time.sleep(3600)

known = _formats._BY_EXTENSION
known[".xyz"] = known[".xyz"]._replace(write=stuck)
main()
"""


def start(*args, code=STUCK):
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, args)],
        cwd=Path(__file__).parents[1],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for(condition, seconds=600):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.02)


@pytest.mark.parametrize("name", ["SIGTERM", "SIGINT"])
def test_a_signal_while_writing_leaves_no_temporary_file(room_file, tmp_path, name):
    number = getattr(signal, name)
    process = start("denoise", room_file, tmp_path / "out.xyz", "--n-jobs", 1)
    try:
        wait_for(lambda: list(tmp_path.glob(".mcmd-*.xyz")) or process.poll() is not None)
        process.send_signal(number)
        process.communicate(timeout=600)
    finally:
        process.kill()
    assert process.returncode == 128 + number
    assert files_in(tmp_path) == ["room.laz"]


def test_signals_are_as_before_when_the_command_is_done():
    def numbers():
        return [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGHUP)]

    before = numbers()
    with tidy_when_terminated():
        assert numbers() != before
        assert numbers()[0] == numbers()[1]  # the handler of a signal that a process gets above
    assert numbers() == before


def test_a_signal_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with tidy_when_terminated():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
