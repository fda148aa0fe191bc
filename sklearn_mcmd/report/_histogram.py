"""Histograms as markup, which follows the theme and stays readable on a phone."""

import numpy as np

from sklearn_mcmd.report._html import text

__all__ = ["histogram"]

N_BINS = 64
# From this ratio of the 99.9 % to the 50 % quantile on, a linear axis shows one bar and a tail.
LONG_TAIL = 20
# From this ratio of the highest to the median bar on, low bars are not seen on a linear axis.
STEEP = 50


def histogram(
    values, *, cutoff=None, cutoff_name="cutoff", above=True, name="", least=None, what="points"
):
    """A histogram with a line at the cutoff; what is beyond it, `above` or below, is colored.

    Both axes are logarithmic where a linear one would show nothing. The first bar then holds all
    smaller values, the last one all larger; `least` is the first value of a logarithmic axis. NaN
    and infinity are left out of the bars, and counted in the caption. `name` is of the axis, `what`
    of what is counted.
    """
    values = np.asarray(values, dtype=np.float64)
    known = values[np.isfinite(values)]
    if known.size == 0:
        return '<p class="soft">There are no values to draw.</p>'
    edges, is_log = _edges(known, cutoff, least)
    counts, _ = np.histogram(np.clip(known, edges[0], edges[-1]), edges)
    filled = counts[counts > 0]
    steep = filled.max() > STEEP * np.median(filled)
    heights = np.log10(counts + 1) if steep else counts.astype(float)
    heights = 100 * heights / heights.max()
    place = _placer(edges, is_log)
    middle = np.sqrt(edges[1:]) * np.sqrt(edges[:-1]) if is_log else (edges[1:] + edges[:-1]) / 2
    beyond = np.zeros(len(counts), bool)
    if cutoff is not None:
        beyond = middle > cutoff if above else middle < cutoff
    bars = "".join(
        f'<rect x="{i + 0.06:.2f}" width="0.88" y="{100 - h:.2f}" height="{h:.2f}" '
        f'class="{"out" if out else "in"}"/>'
        for i, (h, out) in enumerate(zip(heights, beyond, strict=True))
        if h > 0
    )
    line = ""
    if cutoff is not None and edges[0] <= cutoff <= edges[-1]:
        at = place(cutoff)
        side = "left" if at < 60 else "right"
        line = (
            f'<div class="cut {side}" style="left:{at:.2f}%"><span>{text(cutoff_name)} '
            f"{cutoff:.3g}</span></div>"
        )
    ticks = "".join(
        f'<span style="left:{place(tick):.2f}%">{tick:,.6g}</span>'
        for tick in _ticks(edges, is_log)
    )
    scales = [what + (", logarithmic" if steep else "") + f", up to {counts.max():,} a bar"]
    missing = len(values) - len(known)
    if missing:
        scales.append(f"{missing:,} without a finite value are not shown")
    return (
        f'<div class="hist" role="img" aria-label="Histogram of {text(name)}"><div class="plot">'
        f'<svg viewBox="0 0 {len(counts)} 100" preserveAspectRatio="none" aria-hidden="true">'
        f'{bars}</svg>{line}</div><div class="ticks">{ticks}</div>'
        f'<p class="axis"><b>{text(name)}</b>{" (logarithmic)" if is_log else ""}; height: '
        f"{text('; '.join(scales))}</p></div>"
    )


def _edges(known, cutoff, least):
    low, high = known.min(), known.max()
    usual, top = np.quantile(known, [0.5, 0.999])
    ends = [cutoff] if cutoff is not None else []
    if low >= 0 and top > 0 and (top > LONG_TAIL * usual or least is not None):
        positive = known[known > 0]
        first = least or float(np.quantile(positive, 0.01))
        first = min([first, *(e / 3 for e in ends if e > 0)])
        last = max([high, 3 * first, *(3 * e for e in ends)])
        return np.geomspace(first, last, N_BINS + 1), True
    low, high = min([low, *ends]), max([top, *(1.2 * e for e in ends)])
    if high <= low:
        high = low + (abs(low) or 1.0)
    return np.linspace(low, high, N_BINS + 1), False


def _placer(edges, is_log):
    """A value's place along the axis, in percent."""
    low, high = (np.log(edges[[0, -1]]) if is_log else edges[[0, -1]]).tolist()

    def place(value):
        return 100 * ((np.log(value) if is_log else value) - low) / (high - low)

    return place


def _ticks(edges, is_log):
    low, high = edges[0], edges[-1]
    if is_log:
        powers = np.arange(np.ceil(np.log10(low) - 1e-9), np.floor(np.log10(high) + 1e-9) + 1)
        step = -(-len(powers) // 6) or 1
        ticks = 10.0 ** powers[::step]
        return ticks if len(ticks) > 1 else np.array([low, high])
    rough = (high - low) / 5
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(f * power for f in (1, 2, 5, 10) if f * power >= rough)
    ticks = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    return ticks + 0.0
