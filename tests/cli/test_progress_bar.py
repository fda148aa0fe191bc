"""What is seen of progress: a bar for each stage, and a few lines where there is no terminal."""

import os
import re
import subprocess
import sys
import time

import numpy as np
import pytest

from sklearn_mcmd.cli import _progress_bar
from sklearn_mcmd.cli._progress_bar import _State, progress
from sklearn_mcmd.runtime._progress import COMPILING, Told, progress_part, tell_share


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(_progress_bar, "PATIENCE", 0.0)


def lines(capsys, n=1):
    """Lines on stderr when there are so many, however slow the machine is."""
    told, end = "", time.monotonic() + 600
    while told.count("\n") < n:
        assert time.monotonic() < end, told
        time.sleep(0.02)
        told += capsys.readouterr().err
    return told.splitlines()


def test_how_far_the_work_is_never_goes_back():
    state = _State()
    shares = []
    for share in (0.0, 0.4, 0.1, 0.5, 0.2):
        state.hear(Told("normals", share, share / 2))
        shares.append((state.share, state.part))
    assert shares == [(0.0, 0.0), (0.4, 0.2), (0.4, 0.2), (0.5, 0.25), (0.5, 0.25)]


def test_a_new_stage_begins_at_nothing():
    state = _State()
    state.hear(Told("normals", 0.5, 1.0))
    state.hear(Told("creases", 0.5, 0.0))
    assert (state.stage, state.share, state.part) == ("creases", 0.5, 0.0)


def test_compiling_is_shown_until_it_ends_and_then_what_goes_on():
    state = _State()
    state.hear(Told("normals", 0.1))
    state.hear(Told(COMPILING, None))
    assert state.doing == COMPILING
    state.hear(Told(None, None))
    assert (state.doing, state.share) == ("normals", 0.1)


def test_without_a_terminal_a_long_stage_is_told_once_in_a_plain_line(impatient, capsys):
    with progress("denoise", quiet=False):
        time.sleep(0.5)  # no stage has begun
        with progress_part(0.25, 0.5, "outliers"):
            (line,) = lines(capsys)
            time.sleep(0.5)
    assert re.fullmatch(r"mcmd: denoise: outliers, 25 % done, \d+ s", line)
    assert capsys.readouterr().err == ""


def test_without_a_terminal_each_long_stage_has_its_line(impatient, capsys):
    with progress("denoise", quiet=False):
        for i, stage in enumerate(["reading", "outliers", "writing"]):
            with progress_part(i / 3, (i + 1) / 3, stage):
                (line,) = lines(capsys)
                assert line.split(":")[2].split(",")[0].strip() == stage


def test_without_a_terminal_a_stage_that_goes_on_is_told_again(impatient, monkeypatch, capsys):
    monkeypatch.setattr(_progress_bar, "AGAIN", 0.3)
    with progress("denoise", quiet=False), progress_part(0.25, 0.5, "outliers"):
        assert len(lines(capsys, 2)) >= 2


def test_a_note_is_told_beside_the_stage(impatient, capsys):
    with progress("normals", quiet=False), progress_part(0.25, 0.5, "normals"):
        tell_share(0.5, "12 points/s")
        (line,) = lines(capsys)
    assert re.fullmatch(r"mcmd: normals: normals, 12 points/s, 38 % done, \d+ s", line)


def test_short_work_is_not_told(capsys):
    with progress("denoise", quiet=False), progress_part(0.0, 0.5, "outliers"):
        time.sleep(0.3)
    assert capsys.readouterr().err == ""


def test_quiet_work_is_not_told_however_long(impatient, capsys):
    with progress("denoise", quiet=True), progress_part(0.0, 0.5, "outliers"):
        time.sleep(0.5)
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are those of POSIX")
def test_on_a_terminal_each_stage_has_a_bar_that_fills_once(tmp_path):
    import pty

    np.save(tmp_path / "in.npy", np.random.default_rng(0).uniform(size=(15_000, 3)))
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
    assert process.wait(timeout=600) == 0
    shown = shown.decode(errors="replace")
    bars = {}
    for stage, share in re.findall(r"edges: ([a-z ]+?) *[━╸╺ ]+ +(\d+)%", shown):
        bars.setdefault(stage, []).append(int(share))
    stages = ["reading", "planes", "outliers", "normals", "normals next to edges", "creases"]
    assert list(bars)[: len(stages)] == stages
    for shares in bars.values():
        assert shares == sorted(shares)
    for stage in stages[:-1]:
        assert bars[stage][-1] == 100
