"""benchmarks/kill_runs.py: commands that are ended at random moments lose nothing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / "benchmarks" / "kill_runs.py"
VERBS = ("denoise", "normals", "segment", "edges", "plane", "view")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="processes that have threads are forked"),
]


def ended(n_kills, n_interrupts, *kinds, n_power_failures=0):
    """The kinds of which some processes were ended, and none lost anything."""
    command = [sys.executable, SCRIPT, "--kills", n_kills, "--interrupts", n_interrupts]
    command += ["--points", 30_000, "--power-failures", n_power_failures]
    command += [word for kind in kinds for word in ("--kind", kind)]
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line for line in done.stdout.splitlines() if "; 0 faults" in line]
    return [row for row in rows if " 0 of " not in row]


def test_kill_9_while_a_file_is_written_and_in_runs_over_a_folder_loses_nothing():
    kinds = ("write .las", "write .csv", "denoise a folder", "denoise in place")
    assert len(ended(20, 0, *kinds)) == len(kinds)


def test_a_power_failure_loses_nothing_that_a_following_run_needs():
    tried = subprocess.run(["unshare", "--mount", "losetup", "--find"], capture_output=True)
    if os.getuid() or tried.returncode or not shutil.which("mkfs.ext4"):
        pytest.skip("a file system in a file needs root, a free loop device and mkfs.ext4")
    kinds = "denoise a folder", "denoise in place"
    assert len(ended(0, 0, *kinds, n_power_failures=5)) == len(kinds)


def test_ctrl_c_stops_every_verb_within_a_second():
    assert len(ended(0, 2, *VERBS)) == len(VERBS)
