"""What a report says, before it becomes a page."""

from collections.abc import Callable, Collection, Sequence
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


class Map(NamedTuple):
    """A picture of the cloud."""

    title: str  # what it shows, and from where
    plot: Callable[..., object]  # draws it on axes, its argument `ax`


class Table(NamedTuple):
    """Rows of strings; without a header they are pairs of a name and a value."""

    title: str
    rows: Sequence[Sequence[object]]
    header: Sequence[str] = ()
    numbers: Collection[int] = ()  # columns that are right-aligned
    words: str = ""  # below the table
    colors: Sequence[str] = ()  # of dots before the rows


class Contents(NamedTuple):
    """The record of all that a verb has to say: what it found, at most three maps, and where."""

    shown: Any  # the `Shown` cloud, with what is known of it whatever the verb
    headline: str  # one sentence, the result
    results: list[tuple[str, object]]  # names, and numbers with their units
    maps: list[Map]
    tables: list[Table]  # the doubtful places, the largest regions and the like
    notes: list[Note]
    checks: str  # what was looked for, shown where there is no note
    output: str  # what the output holds
    rows: Collection[tuple[str, str]] = ()  # what else the input holds


def percent(n, n_all):
    """A share in percent, with digits enough to distinguish few from none."""
    value = 100 * n / n_all if n_all else 0.0
    if n and value < 0.1:
        return f"{value:.2g} %"
    return f"{value:.1f} %"


def share(n, n_all, verb="", noun="point"):
    return f"{counted(n, noun, of=n_all)} ({percent(n, n_all)}) {agreed(n, verb)}".rstrip()
