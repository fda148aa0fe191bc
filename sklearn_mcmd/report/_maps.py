"""Maps of a cloud from above, the front and the side, and the cells where most was found."""

import base64
import io

import numpy as np

from sklearn_mcmd._errors import counted
from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.plotting import plot_cloud
from sklearn_mcmd.plotting._displays import FOUND, Picture
from sklearn_mcmd.plotting._still import ball_picture, distance_colors
from sklearn_mcmd.plotting._views import look, round_length, thinned
from sklearn_mcmd.report._contents import percent
from sklearn_mcmd.report._rendering import join, paragraph, part, table

# Points that were not found, from far to near: to be seen on white and on black.
FAR, NEAR = (0.72, 0.76, 0.81), (0.46, 0.51, 0.58)
DIM = "#98a4b3"  # between them
LEAST_FOUND = 1.6  # size of a point that was found, at least
ENLARGED = 1.15  # the same over the size of the others

VIEWS = {
    "top": "From above: x to the right, y up",
    "front": "From the front: x to the right, z up",
    "side": "From the side: y to the right, z up",
}
MOST_DRAWN = 120_000  # points of a map; more cover each other at this size
WIDTH = 10.0  # inches of a map
DPI = 144  # its pixels an inch
LEAST_SHAPE = 0.12  # height over width of a map; narrower clouds have margins
LARGEST_SHAPE = 0.9  # the same; so have higher ones
CELLS = 10  # along the longer side of the cloud, at least; twice as many at most
LISTED = 8  # cells of the table
PALETTE = 255  # colors of a picture; half of the bytes of true color


def maps(shown, xyz, near, legend=(), views=tuple(VIEWS), unit=""):
    """Figures of a cloud, of the points that are `near`, not far from all others.

    Colors are those of what is `shown`, a display or its `Picture`. The legend has pairs of a color
    and words; a view may come with its caption.
    """

    def draw(rows, view, ax):
        picture = shown if isinstance(shown, Picture) else shown._picture(view)
        colors, labels, *_ = picture
        rows = rows[thinned(labels[rows], MOST_DRAWN)]
        plot_cloud(xyz[rows], color=colors[rows], view=view, ax=ax)

    return _figures(draw, xyz, near, legend, views, unit)


def _figures(draw, xyz, near, legend, views=tuple(VIEWS), unit=""):
    """The same by a function that draws some of the points from a view into axes."""
    rows = np.flatnonzero(near)
    named = [(view, VIEWS[view]) if isinstance(view, str) else view for view in views]
    figures = [_map(draw, xyz, rows, view, caption) for view, caption in named]
    outside = len(xyz) - len(rows)
    words = f"Lengths are in{unit or ' units of the file'}."
    if outside:
        words += (
            f" {counted(outside, 'point', 'lie')} far from the others, and not in the pictures."
        )
    chips = [part("chips", legend)] if legend else []
    return join(*chips, part("maps", figures), part("paragraph", words, "soft"))


def found_maps(xyz, found, near, noun):
    """Maps of which points were `found`, on top of the others, which are shaded by distance."""

    def draw(rows, view, ax):
        rows = rows[thinned(found[rows], MOST_DRAWN)]
        marked = found[rows]
        part, size = xyz[rows[~marked]], LEAST_FOUND
        if len(part):
            colors = distance_colors(look(part, view)[1], FAR, NEAR)
            plot_cloud(part, color=colors, view=view, ax=ax)
            size = max(size, ENLARGED * float(np.sqrt(ax.collections[0].get_sizes()[0])))
        if marked.any():
            plot_cloud(xyz[rows[marked]], color=FOUND, view=view, size=size, ax=ax)

    n = int(np.count_nonzero(found))
    legend = [(FOUND, counted(n, noun)), (DIM, counted(len(found) - n, "other"))]
    return _figures(draw, xyz, near, legend)


def ball():
    """The legend of colors of normals."""
    from PIL import Image

    pixels = np.rint(255 * np.clip(np.flipud(ball_picture("top")), 0.0, 1.0)).astype(np.uint8)
    return part("ball", _encoded(Image.fromarray(pixels, "RGBA")))


def fullest_cells(xyz, found, near, noun):
    """A table of what was `found` among the points that are `near`: the fullest cells."""
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
        f"{counted(len(cells), 'cell', 'hold')} points."
    )
    return intro + table(header, rows, numbers=(2, 3, 4))


def _number(value):
    return f"{round(value, 9) + 0.0:.10g}"


def _map(draw, xyz, rows, view, caption):
    new_figure = import_extra("matplotlib.figure", "plot", "--report").Figure
    from PIL import Image  # comes with it

    places = look(xyz[rows], view)[0]
    low, high = places.min(axis=0), places.max(axis=0)
    width, height = high - low
    # A cloud at one place, or along a line, has some width too.
    least = max(1e-9 * max(width, height), 1e-9 * np.abs(places).max(), 1e-100)
    width, height = max(width, least), max(height, least)
    width, height = 1.03 * width, 1.03 * height
    shape = float(np.clip(height / width, LEAST_SHAPE, LARGEST_SHAPE))
    width, height = max(width, height / shape), max(height, shape * width)
    drawn = new_figure(figsize=(WIDTH, WIDTH * shape), dpi=DPI)
    ax = drawn.add_axes((0.0, 0.0, 1.0, 1.0))
    draw(rows, view, ax)
    middle = (low + high) / 2
    ax.set(
        xlim=(middle[0] - width / 2, middle[0] + width / 2),
        ylim=(middle[1] - height / 2, middle[1] + height / 2),
    )
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="png", transparent=True)
    length = round_length(0.2 * width)
    picture = _encoded(Image.open(buffer).convert("RGBA"))
    return part("map", picture, caption, shape, length / width, length)


def _encoded(image):
    """The address of a PNG of few colors."""
    from PIL import Image

    buffer = io.BytesIO()
    image = image.quantize(PALETTE, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    image.save(buffer, format="png", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
