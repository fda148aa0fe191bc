"""The result of an experiment: tables of text, arrays and notes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Aligned text: the first `n_labels` columns to the left, numbers to the right."""

    caption: str
    header: tuple
    rows: list
    n_labels: int = 1

    def __str__(self):
        lines = [self.header, *self.rows]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.header))]

        def aligned(line):
            cells = zip(line, widths, range(len(widths)), strict=True)
            return "  ".join(
                cell.ljust(w) if i < self.n_labels else cell.rjust(w) for cell, w, i in cells
            ).rstrip()

        return "\n".join([self.caption, *(f"  {aligned(line)}" for line in lines)])


def paired_rows(name, ours, paper=None):
    """The rows of a method: the paper's cells above ours, or ours alone."""
    if paper is None:
        return [(name, "ours", *ours)]
    return [(name, "paper", *paper), ("", "ours", *ours)]


@dataclass(frozen=True)
class Report:
    """A reproduced table or figure of the paper.

    Attributes
    ----------
    name : str
        "table1" and so on.
    title : str
    tables : list of Table
        The paper's and the reproduced numbers, side by side.
    notes : list of str
        What the numbers are, and readings of the rows; docs/reproduction.rst says which cannot
        be reproduced, and why.
    results : dict
        The reproduced numbers as arrays; the function `name` documents the keys.
    """

    name: str
    title: str
    tables: list
    notes: list
    results: dict

    def __str__(self):
        notes = "\n".join(f"- {note}" for note in self.notes)
        return "\n\n".join([self.title, *map(str, self.tables), notes])
