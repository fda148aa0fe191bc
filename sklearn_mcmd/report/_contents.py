"""What a report says, before it becomes a page."""

from pathlib import Path
from typing import Any, NamedTuple

__all__ = ["Contents", "Note", "Parameter", "Run", "Section", "note_if", "percent", "share"]


class Parameter(NamedTuple):
    """An option of the command, its value in words, and whether nobody gave it."""

    name: str
    value: str
    is_default: bool


class Run(NamedTuple):
    """The command that is reported.

    verb : str
    command : str
        As it was typed.
    parameters : sequence of Parameter
    source, target : Path
    seconds : float
        Of all work before the report.
    """

    verb: str
    command: str
    parameters: tuple[Parameter, ...]
    source: Path
    target: Path
    seconds: float


class Note(NamedTuple):
    """A warning in plain words: what is the matter, with numbers, and what to do."""

    title: str
    text: str
    remedy: str


def note_if(holds, title, text, remedy):
    """Notes on a measurement: this one if the matter `holds`, else none."""
    return [Note(title, text, remedy)] if holds else []


class Section(NamedTuple):
    """A part of the page; `html` is escaped where it was made."""

    title: str
    html: str


class Contents(NamedTuple):
    """All that a verb has to say.

    headline : str
        One sentence, the result.
    cards : list of (str, str)
        Numbers and what they count.
    notes : list of Note
    checks : str
        What was looked for, told where there is no note.
    sections : list of Section
    cloud_rows : list of (str, str)
        What the input holds.
    output : str
        What the output holds.
    shown : PointCloud or None
        For the page to look around in.
    """

    headline: str
    cards: list[tuple[str, str]]
    notes: list[Note]
    checks: str
    sections: list[Section]
    cloud_rows: list[tuple[str, str]]
    output: str
    shown: Any = None


def percent(n, n_all):
    """A share in percent, with digits enough to tell few from none."""
    value = 100 * n / n_all if n_all else 0.0
    if n and value < 0.1:
        return f"{value:.2g} %"
    return f"{value:.1f} %"


def share(n, n_all, noun="points"):
    return f"{n:,} of {n_all:,} {noun} ({percent(n, n_all)})"
