"""Maps of a cloud from above, the front and the side, and the cells where most was found."""

from functools import partial

import numpy as np

from sklearn_mcmd._errors import counted
from sklearn_mcmd.plotting import plot_cloud
from sklearn_mcmd.plotting._displays import FOUND
from sklearn_mcmd.plotting._views import look, round_length, thinned
from sklearn_mcmd.report._contents import Map, Table, percent

LEAST_MARKED = 1.6  # size of a marked point, at least
ENLARGED = 1.15  # the same over the size of the others

VIEWS = {
    "top": "from above, x to the right, y up",
    "front": "from the front, x to the right, z up",
    "side": "from the side, y to the right, z up",
}
MOST_DRAWN = 120_000  # points of a map; more cover each other at this size
CELLS = 10  # along the longer side of the cloud, at least; twice as many at most
LISTED = 8  # cells of the table


def maps(what, plot):
    """Maps by a function that draws the cloud on axes as it is seen from a view."""
    return [Map(f"{what}, {words}", partial(plot, view=view)) for view, words in VIEWS.items()]


def display_maps(what, display):
    """Maps of what a display shows."""
    return maps(what, partial(display.plot, max_points=MOST_DRAWN))


def marked_maps(xyz, is_marked, near, noun):
    """Maps of marked points, over the others, of those that are `near`."""
    xyz, is_marked = xyz[near], is_marked[near]
    rows = thinned(is_marked, MOST_DRAWN)
    xyz, marked = xyz[rows], xyz[rows[is_marked[rows]]]

    def plot(view, ax):
        plot_cloud(xyz, view=view, scale_bar=True, ax=ax)
        size = max(LEAST_MARKED, ENLARGED * float(np.sqrt(ax.collections[0].get_sizes()[0])))
        ax.scatter(*look(marked, view)[0].T, s=size**2, c=FOUND, linewidths=0, zorder=4)

    return maps(f"{counted(np.count_nonzero(is_marked), noun)} (orange)", plot)


def fullest_cells(xyz, is_marked, near, noun):
    """Tables of the marked points among those that are `near`: of the fullest cells, if any."""
    xyz, is_marked = xyz[near], is_marked[near]
    if not is_marked.any():
        return []
    extent = float(np.ptp(xyz[:, :2], axis=0).max())
    # Of 1, 2 or 5 times a power of ten, so that the bounds of cells are round.
    side = round_length(extent / CELLS) if extent > 0 else 1.0
    cells, inverse = np.unique(np.floor(xyz[:, :2] / side), axis=0, return_inverse=True)
    n_all = np.bincount(inverse.ravel())
    n_marked = np.bincount(inverse.ravel(), is_marked).astype(int)
    rows = [
        (
            *(f"{_number(a)} to {_number(a + side)}" for a in (cells[i] * side).tolist()),
            f"{n_marked[i]:,}",
            percent(n_marked[i], n_all[i]),
            percent(n_marked[i], n_marked.sum()),
        )
        for i in np.argsort(-n_marked, kind="stable")[:LISTED]
        if n_marked[i]
    ]
    title = (
        f"Places: the fullest cells of a grid of {side:g} in plan, of {len(cells):,} with points"
    )
    header = ("x", "y", noun, "of the cell's points", f"of all {noun}")
    return [Table(title, rows, header, numbers=(2, 3, 4))]


def _number(value):
    return f"{round(value, 9) + 0.0:.10g}"
