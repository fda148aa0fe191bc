"""Histograms of values, with the cutoff that was applied to them."""

import io
import re

import numpy as np

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.report._rendering import part

N_BINS = 64  # bars of a histogram
LONG_TAIL = 20  # a larger ratio of the 99.9 % to the 50 % quantile has a logarithmic axis
LONGEST = 1e12  # ratio of the ends of a logarithmic axis, at most
STEEP = 50  # so has a larger ratio of the highest to the median bar: low ones would not be seen
WITHIN, BEYOND, LINES = "#8d9bac", "#d55e00", "#7b8794"  # to be seen on white and on black
# Facts that a page does not need, and that would differ between runs.
NONE = dict.fromkeys(("Creator", "Date", "Format", "Type"))
SIZE = 5.2, 2.2  # inches of the drawing; it stays readable on a phone
# Words stay words, which take the page's font and color; the same values give the same markup.
STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "report",
    "font.size": 10,
    "axes.edgecolor": LINES,
    "xtick.color": LINES,
    "xtick.labelcolor": "black",
    "ytick.color": LINES,
    "ytick.labelcolor": "black",
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def histogram(
    values, *, cutoff=None, cutoff_name="cutoff", above=True, name="", least=None, what="points"
):
    """A histogram with a line at the cutoff; what is beyond it, `above` or below, is colored.

    Both axes are logarithmic where a linear one would show nothing. The first bar then holds all
    smaller values, the last one all larger; `least` is the first value of a logarithmic axis. NaN
    and infinity are left out of the bars, and counted below. `name` is of the axis, `what` of what
    is counted.
    """
    values = np.asarray(values, dtype=np.float64)
    known = values[np.isfinite(values)]
    if known.size == 0:
        return part("paragraph", "There are no values to draw.", "soft")
    edges, is_log = _edges(known, cutoff, least)
    counts, _ = np.histogram(np.clip(known, edges[0], edges[-1]), edges)
    filled = counts[counts > 0]
    middle = np.sqrt(edges[1:]) * np.sqrt(edges[:-1]) if is_log else (edges[1:] + edges[:-1]) / 2
    beyond = np.zeros(len(counts), bool)
    if cutoff is not None:
        beyond = middle > cutoff if above else middle < cutoff
    drawn = import_extra("matplotlib", "plot", "--report")
    with drawn.rc_context(STYLE):
        figure = import_extra("matplotlib.figure", "plot", "--report").Figure(SIZE)
        ax = figure.add_subplot()
        colors = np.where(beyond, BEYOND, WITHIN)
        ax.bar(edges[:-1], counts, np.diff(edges), align="edge", color=colors, linewidth=0)
        ax.set(xlim=edges[[0, -1]], xlabel=name, ylabel=what)
        ax.set_xscale("log" if is_log else "linear")  # after its limits, which it would move
        if filled.max() > STEEP * np.median(filled):
            ax.set(yscale="log", ylim=(0.5, 2 * filled.max()))
        if cutoff is not None and edges[0] <= cutoff <= edges[-1]:
            ax.axvline(cutoff, color=LINES, linestyle="--")
            ax.set_title(f"{cutoff_name} {cutoff:.3g}", fontsize=11)
        markup = io.StringIO()
        figure.savefig(markup, format="svg", transparent=True, bbox_inches="tight", metadata=NONE)
    missing = len(values) - len(known)
    words = f"{missing:,} without a finite value are not shown." if missing else ""
    return part("histogram", re.search("<svg.*", markup.getvalue(), re.S)[0], name, words)


def _edges(known, cutoff, least):
    low, high = known.min(), known.max()
    usual, top = np.quantile(known, [0.5, 0.999])
    ends = [cutoff] if cutoff is not None else []
    if low >= 0 and top > 0 and (top > LONG_TAIL * usual or least is not None):
        positive = known[known > 0]
        first = least or float(np.quantile(positive, 0.01))
        first = min([first, *(e / 3 for e in ends if e > 0)])
        last = max([min(high, LONGEST * first), 3 * first, *(3 * e for e in ends)])
        return np.geomspace(first, last, N_BINS + 1), True
    low, high = min([low, *ends]), max([top, *(1.2 * e for e in ends)])
    if high <= low:
        high = low + (abs(low) or 1.0)
    return np.linspace(low, high, N_BINS + 1), False
