"""Where points were flagged: in cells of a grid, and by height."""

import numpy as np

from sklearn_mcmd.plotting._views import round_length
from sklearn_mcmd.report._contents import percent
from sklearn_mcmd.report._rendering import join, paragraph, part, table

CELLS = 10  # along the longer side of the cloud, at least; twice as many at most
LISTED = 8  # cells of the table
BANDS = 12  # heights, at most


def place_sections(xyz, found, near, noun):
    """Tables of what was `found` among the points that are `near`: the fullest cells, heights."""
    xyz, found = xyz[near], found[near]
    if not found.any():
        return paragraph(f"There are no {noun}.")
    extent = float(np.ptp(xyz[:, :2], axis=0).max())
    side = round_length(extent / CELLS) if extent > 0 else 1.0
    cells, inverse = np.unique(np.floor(xyz[:, :2] / side), axis=0, return_inverse=True)
    n_all = np.bincount(inverse.ravel())
    n_found = np.bincount(inverse.ravel(), found).astype(int)
    rows = [
        (
            *(f"{_number(a)} to {_number(a + side)}" for a in (cells[i] * side).tolist()),
            f"{n_found[i]:,}",
            percent(n_found[i], n_all[i]),
            percent(n_found[i], n_found.sum()),
        )
        for i in np.argsort(-n_found, kind="stable")[:LISTED]
        if n_found[i]
    ]
    header = ("x", "y", noun, "of the cell's points", f"of all {noun}")
    intro = paragraph(
        f"The fullest cells of a grid of {side:g} in plan, seen from above; "
        f"{len(cells):,} cells hold points."
    )
    heights = _height_rows(xyz[:, 2], found)
    bars = part("bar_table", ("z", f"{noun}, and share of the points there"), heights)
    cells = table(header, rows, numbers=(2, 3, 4))
    return join(intro, cells, part("heading", "By height"), bars)


def _height_rows(z, found):
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
