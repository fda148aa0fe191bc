"""The result of an experiment: tables of text, arrays and notes."""

from typing import NamedTuple

from benchmarks._tables import table_lines


def paired_rows(name, ours, paper=None):
    """The rows of a method: the paper's cells above ours, or ours alone."""
    if paper is None:
        return [(name, "ours", *ours)]
    return [(name, "paper", *paper), ("", "ours", *ours)]


class Report(NamedTuple):
    """A reproduced table of the paper, as text.

    The notes say what the numbers are, and readings of the rows; docs/reproduction.rst says which
    cannot be reproduced, and why.
    """

    name: str  # "table1" and so on
    title: str
    tables: list  # of captions, heads and rows: the paper's and the reproduced numbers
    notes: list
    results: dict  # the reproduced numbers as arrays; the function `name` documents the keys

    def __str__(self):
        tables = ["\n".join([title, *table_lines(*cells)]) for title, *cells in self.tables]
        return "\n\n".join([self.title, *tables, "\n".join(f"- {note}" for note in self.notes)])
