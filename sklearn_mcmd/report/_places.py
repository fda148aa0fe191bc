"""Where points were flagged: in cells of a grid, and by height."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.plotting._views import round_length
from sklearn_mcmd.report._contents import percent
from sklearn_mcmd.report._rendering import join, paragraph, part, table

CELLS = 10  # along the longer side of the cloud, at least; twice as many at most
LISTED = 8  # cells of the table
BANDS = 12  # heights, at most


class Places(NamedTuple):
    """Cells of a grid in plan, those that hold points."""

    low: np.ndarray  # their lower corners, (m, 2)
    side: float
    n_all: np.ndarray
    n_found: np.ndarray

    @classmethod
    def of(cls, xyz, found, near):
        """Of points (n, 3), those that were `found`; points that are not `near` are left out."""
        plan, found = xyz[near, :2], found[near]
        extent = float(np.ptp(plan, axis=0).max())
        side = round_length(extent / CELLS) if extent > 0 else 1.0
        cells, inverse = np.unique(np.floor(plan / side), axis=0, return_inverse=True)
        inverse = inverse.ravel()
        n_all = np.bincount(inverse, minlength=len(cells))
        n_found = np.bincount(inverse, found, minlength=len(cells)).astype(int)
        return cls(cells * side, side, n_all, n_found)

    def where(self, number):
        """The ranges of x and of y of a cell, in words."""
        return [f"{_number(a)} to {_number(a + self.side)}" for a in self.low[number].tolist()]

    def fullest(self):
        """The numbers of the cells where most was found."""
        order = np.argsort(-self.n_found, kind="stable")[:LISTED]
        return order[self.n_found[order] > 0]


def place_sections(xyz, found, near, noun):
    """Tables of what was `found`: the fullest of its `Places`, and heights."""
    places = Places.of(xyz, found, near)
    fullest = places.fullest()
    if len(fullest) == 0:
        return paragraph(f"There are no {noun}.")
    total = places.n_found.sum()
    rows = [
        (
            *places.where(i),
            f"{places.n_found[i]:,}",
            percent(places.n_found[i], places.n_all[i]),
            percent(places.n_found[i], total),
        )
        for i in fullest
    ]
    header = ("x", "y", noun, "of the cell's points", f"of all {noun}")
    intro = paragraph(
        f"The fullest cells of a grid of {places.side:g} in plan, seen from above; "
        f"{len(places.n_all):,} cells hold points."
    )
    heights = height_rows(xyz[near, 2], found[near])
    bars = part("bar_table", ("z", f"{noun}, and share of the points there"), heights)
    cells = table(header, rows, numbers=(2, 3, 4))
    return join(intro, cells, part("heading", "By height"), bars)


def height_rows(z, found):
    """Bands of height, the highest first: name, number in words, and share of the largest bar."""
    low, high = float(z.min()), float(z.max())
    side = round_length((high - low) / BANDS) if high > low else 1.0
    while (high - low) / side > BANDS:
        side = round_length(2.51 * side)  # the next of 1, 2, 5
    band = np.floor(z / side).astype(np.int64)
    first = int(band.min())
    n_all = np.bincount(band - first)
    n_found = np.bincount(band - first, found).astype(int)
    most = max(n_found.max(), 1)
    return [
        (
            f"{_number((first + i) * side)} to {_number((first + i + 1) * side)}",
            f"{n_found[i]:,} ({percent(n_found[i], n_all[i])})",
            n_found[i] / most,
        )
        for i in range(len(n_all) - 1, -1, -1)
        if n_all[i]
    ]


def _number(value):
    return f"{round(value, 9) + 0.0:.10g}"
