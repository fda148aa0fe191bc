"""What a report says, before it becomes a page."""

from pathlib import Path
from typing import Any, NamedTuple

from sklearn_mcmd._errors import agreed, counted


class Run(NamedTuple):
    """The command that is reported."""

    verb: str
    command: str  # as it was typed
    parameters: list[tuple[str, str]]  # options and their values in words
    source: Path
    target: Path
    seconds: float  # of all work before the report


class Note(NamedTuple):
    """A warning in plain words: what is the matter, with numbers, and what to do."""

    title: str
    text: str
    remedy: str = ""


def note_if(holds, *words):
    """Notes on a measurement: the `Note` of these words if the matter `holds`, else none."""
    return [Note(*words)] if holds else []


class Contents(NamedTuple):
    """All that a verb has to say."""

    headline: str  # one sentence, the result
    cards: list[tuple[str, str]]  # numbers and what they count
    notes: list[Note]
    checks: str  # what was looked for, shown where there is no note
    sections: list[tuple[str, Any]]  # titles, and markup by `part`; other text is escaped
    cloud_rows: list[tuple[str, str]]  # what the input holds
    output: str  # what the output holds
    shown: Any = None  # a PointCloud for the page to look around in
    sample: str = ""  # of which points all but the headline and the cards are, if not of all


def percent(n, n_all):
    """A share in percent, with digits enough to distinguish few from none."""
    value = 100 * n / n_all if n_all else 0.0
    if n and value < 0.1:
        return f"{value:.2g} %"
    return f"{value:.1f} %"


def share(n, n_all, verb="", noun="point"):
    return f"{counted(n, noun, of=n_all)} ({percent(n, n_all)}) {agreed(n, verb)}".rstrip()
