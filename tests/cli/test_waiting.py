"""What is seen of progress: one bar to the end, and a few lines where there is no terminal."""

import os
import re
import subprocess
import sys
import time

import numpy as np
import pytest

from sklearn_mcmd.cli import _waiting
from sklearn_mcmd.cli._waiting import _State, progress
from sklearn_mcmd.planes._progress import COMPILING, progress_part


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(_waiting, "PATIENCE", 0.3)


def test_how_far_the_work_is_never_goes_back():
    state = _State()
    shares = []
    for share in (0.0, 0.4, 0.1, 0.5, 0.2):
        state.hear("normals", share)
        shares.append(state.share)
    assert shares == [0.0, 0.4, 0.4, 0.5, 0.5]


def test_compiling_is_shown_until_it_ends_and_then_what_goes_on():
    state = _State()
    state.hear("normals", 0.1)
    state.hear(COMPILING, None)
    assert state.doing == COMPILING
    state.hear(None, None)
    assert (state.doing, state.share) == ("normals", 0.1)


def test_without_a_terminal_a_long_stage_is_told_once_in_a_plain_line(impatient, capsys):
    with progress("denoise", quiet=False), progress_part(0.25, 0.5, "outliers"):
        time.sleep(1.2)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert re.fullmatch(r"mcmd: denoise: outliers, 25 % done, [01] s", lines[0])


def test_without_a_terminal_each_long_stage_has_its_line(impatient, capsys):
    with progress("denoise", quiet=False):
        for i, stage in enumerate(["reading", "outliers", "writing"]):
            with progress_part(i / 3, (i + 1) / 3, stage):
                time.sleep(0.8)
    told = [
        line.split(":")[2].split(",")[0].strip() for line in capsys.readouterr().err.splitlines()
    ]
    assert told == ["reading", "outliers", "writing"]


def test_without_a_terminal_a_stage_that_goes_on_is_told_again(impatient, monkeypatch, capsys):
    monkeypatch.setattr(_waiting, "AGAIN", 0.5)
    with progress("denoise", quiet=False), progress_part(0.25, 0.5, "outliers"):
        time.sleep(1.8)
    assert len(capsys.readouterr().err.splitlines()) >= 2


def test_short_work_is_not_told(capsys):
    with progress("denoise", quiet=False), progress_part(0.0, 0.5, "outliers"):
        time.sleep(0.3)
    assert capsys.readouterr().err == ""


def test_quiet_work_is_not_told_however_long(impatient, capsys):
    with progress("denoise", quiet=True), progress_part(0.0, 0.5, "outliers"):
        time.sleep(0.8)
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are those of POSIX")
def test_on_a_terminal_one_bar_fills_once_and_names_the_stages(tmp_path):
    import pty

    np.save(tmp_path / "in.npy", np.random.default_rng(0).uniform(size=(30_000, 3)))
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "sklearn_mcmd", "edges", tmp_path / "in.npy", tmp_path / "out.npy"],
        stdout=subprocess.DEVNULL,
        stderr=theirs,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "120", "NO_COLOR": "1"},
    )
    os.close(theirs)
    shown = b""
    while True:
        try:
            block = os.read(ours, 65536)
        except OSError:  # the other end is closed
            break
        if not block:
            break
        shown += block
    os.close(ours)
    assert process.wait(timeout=60) == 0
    shown = shown.decode(errors="replace")
    shares = [int(share) for share in re.findall(r"(\d+)%", shown)]
    assert shares == sorted(shares)
    assert shares[-1] - shares[0] > 50
    for stage in ("edges: outliers", "edges: creases"):
        assert stage in shown
