"""What is seen of progress: a bar for each stage, and a few lines where there is no terminal."""

import re

import pytest

from sklearn_mcmd.cli import _messages
from sklearn_mcmd.cli._messages import progress
from sklearn_mcmd.runtime._progress import progress_part, report_share


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(_messages, "PATIENCE", 0.0)


def work():
    for i, stage in enumerate(["reading", "outliers"]):
        with progress_part(i / 2, (i + 1) / 2, stage):
            for share in (0.5, 0.25, 1.0):
                report_share(share, "12 points/s")


def test_without_a_terminal_each_long_stage_is_told_once_in_a_plain_line(impatient, capsys):
    with progress("denoise", quiet=False):
        work()
    told = capsys.readouterr().err.splitlines()
    assert [re.sub(r"\d+ s$", "s", line) for line in told] == [
        f"mcmd: denoise: {stage}, {share} % done, s"
        for stage, share in (("reading", 0), ("outliers", 50))
    ]


def test_without_a_terminal_a_stage_that_goes_on_is_told_again_and_never_goes_back(
    impatient, monkeypatch, capsys
):
    monkeypatch.setattr(_messages, "AGAIN", 0.0)
    with progress("denoise", quiet=False):
        work()
    told = capsys.readouterr().err
    assert "mcmd: denoise: outliers, 12 points/s, 75 % done" in told
    shares = [int(share) for share in re.findall(r"(\d+) % done", told)]
    assert len(shares) == 10
    assert shares == sorted(shares)


@pytest.mark.parametrize("quiet", [True, False])
def test_short_or_quiet_work_is_not_told(quiet, monkeypatch, capsys):
    monkeypatch.setattr(_messages, "PATIENCE", 0.0 if quiet else 3600.0)
    with progress("denoise", quiet):
        work()
    assert capsys.readouterr().err == ""


def test_on_a_terminal_each_stage_has_a_bar_that_fills_once(monkeypatch, capsys):
    for name, value in {"FORCE_COLOR": "1", "TERM": "xterm", "COLUMNS": "120"}.items():
        monkeypatch.setenv(name, value)
    with progress("edges", quiet=False):
        work()
    shown = re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", capsys.readouterr().err)
    bars = re.findall(r"edges: ([a-z ]+?) *[━╸╺ ]+ +(\d+)%", shown)
    assert bars[-2:] == [("reading", "100"), ("outliers", "100")]
