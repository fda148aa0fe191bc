"""The page: its parts put together, shown in notebooks, and saved."""

import html
import json
import math
import os
from base64 import b64encode
from collections.abc import Collection, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import cache
from hashlib import sha256
from importlib.resources import files
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sklearn_mcmd._errors import agreed, counted, warn_caller
from sklearn_mcmd.io._files import read_points, replacing
from sklearn_mcmd.io._point_cloud import PointCloud
from sklearn_mcmd.io._units import length_unit
from sklearn_mcmd.view._attributes import free_name, is_wanted, plan_attributes
from sklearn_mcmd.view._encoding import Grid, pack_points, shuffled

# WebGL takes float32; the products of its matrices must be finite too.
LARGEST_EXTENT = 1e18
SUFFIXES = (".html", ".htm")  # of a page's name
# In the order in which they are joined; together they are the page's one script.
SCRIPTS = ("decode", "colors", "scene", "camera", "renderer", "measure", "panel", "picture", "main")
# What the page colors by at first: the first of these that the clouds have.
FIRST_COLORS = ["region", "edge", "outlier", "outlier_score", "distance", "residual", "normal"]
FIRST_COLORS += ["color", "classification", "surface_variation", "mean_curvature", "intensity"]


@dataclass(eq=False, repr=False)
class CloudPage:
    """One HTML page that shows point clouds, made by :func:`sklearn_mcmd.plotting.view`.

    It opens in a browser without a network. In Jupyter it shows itself.

    Parameters
    ----------
    html : str
        The page.
    n_points : int
        Points of the clouds.
    n_shown : int
        Points in the page; fewer than `n_points` if the clouds were thinned.
    error : float
        Largest difference of a coordinate in the page to the cloud's, 0 if they are equal.
        Cards, lengths and the section box have these coordinates.
    spacing : float
        Median distance of a point in the page to the nearest other one; of a thinned cloud it is
        larger than in the file.
    height : int, default=640
        Height of the frame in Jupyter, in pixels.
    drawn_error : float, default=0.0
        Largest distance along an axis of a point in the picture to its coordinate in the page.
        The graphics card takes float32 from the median on, so a stray point 1000 km away is drawn
        within 3 cm.

    See Also
    --------
    sklearn_mcmd.plotting.view : Makes the page.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.plotting import view
    >>> xyz = np.random.default_rng(0).uniform(size=(1000, 3)).round(3)
    >>> page = view(xyz, names=["A cube"])
    >>> page.n_shown, page.error
    (1000, 0.0)
    >>> page.save("cube.html")  # doctest: +SKIP
    """

    html: str
    _: KW_ONLY
    n_points: int
    n_shown: int
    error: float
    spacing: float
    height: int = 640
    drawn_error: float = 0.0

    def __post_init__(self) -> None:
        check_count(self.height, "height")

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page. An existing file is replaced only by a complete new one.

        Parameters
        ----------
        path : str or os.PathLike
            A name that ends in ``.html`` or ``.htm``.

        Returns
        -------
        pathlib.Path
            The path of the file.

        Raises
        ------
        PointFileError
            If the folder is missing or the file cannot be written.
        ValueError
            If the name does not end so.
        """
        target = check_suffix(path)
        with replacing(target) as temporary:
            temporary.write_text(self.html, encoding="utf-8", errors="replace")
        return target

    def __repr__(self) -> str:
        size = f"{len(self.html) / 1e6:.1f} MB"
        return f"CloudPage({self.n_shown:,} of {self.n_points:,} points, {size})"

    def _repr_html_(self):
        # The sandbox keeps the page from the notebook; a picture may be downloaded. The policy lets
        # the script run by its digest, which in ASCII does not depend on the notebook's encoding.
        page = html.escape(self.html).encode("ascii", "xmlcharrefreplace").decode()
        return (
            f'<iframe srcdoc="{page}" sandbox="allow-scripts allow-downloads" '
            f'style="width:100%;height:{self.height}px;border:0;border-radius:8px" '
            'allow="fullscreen"></iframe>'
        )


def view(
    *clouds: "PointCloud | ArrayLike | str | os.PathLike[str]",
    names: Sequence[str] | None = None,
    title: str | None = None,
    color: str | None = None,
    only: Collection[str] | None = None,
    max_points: int = 5_000_000,
    height: int = 640,
) -> CloudPage:
    """Make one HTML page that shows clouds in a browser, offline, and itself in Jupyter.

    Parameters
    ----------
    *clouds : PointCloud, array-like of shape (n, 3), or path
        Clouds or files to show. A `PointCloud` brings attributes to color by. Of two clouds, such
        as before and after, a slider shows each on its side.
    names : sequence of str, default=None
        A name for each cloud. None takes the files' names.
    title : str, default=None
        Title of the page. None takes the names.
    color : str, default=None
        Attribute to color by at first, or ``"height"``, which is z unless the clouds have an
        attribute of that name; then z is ``"height (2)"``. None chooses a result, such as
        ``region``, else colors, class, intensity or height.
    only : collection of str, default=None
        Attributes to put into the page. None takes all.
    max_points : int, default=5_000_000
        Largest number of points in the page, at least one for each cloud. Of more, so many are
        chosen at random.
    height : int, default=640
        Height in Jupyter, in pixels.

    Returns
    -------
    CloudPage
        The page, with ``save(path)``.

    Warns
    -----
    UserWarning
        If points are left out, because there are too many or a coordinate is not finite; if
        attributes are left out, because they hold no numbers.

    See Also
    --------
    plot_cloud : A still picture.

    Notes
    -----
    Coordinates in the page are those of the cloud if these are multiples of a decimal step, such
    as a millimeter, of at least 1/256 of the spacing. Else they are off by at most a sixteenth of
    the spacing; ``CloudPage.error`` tells. Numbers have 16 bits, and normals are within 0.06
    degrees.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.io import PointCloud
    >>> from sklearn_mcmd.plotting import view
    >>> xyz = np.random.default_rng(0).uniform(size=(1000, 3)).round(3)
    >>> page = view(PointCloud(xyz, {"region": np.arange(1000) % 3}), title="A cube")
    >>> page.n_shown, page.error
    (1000, 0.0)
    """
    if len(clouds) == 0:
        raise ValueError("A page needs at least one cloud, got none.")
    check_count(max_points, "max_points")
    if max_points < len(clouds):
        raise ValueError(
            f"max_points must be at least the number of clouds, {len(clouds)}, got {max_points}."
        )
    if isinstance(only, str):
        raise ValueError(f"only must be a collection of names, got the string {only!r}.")
    if isinstance(names, str) or (names is not None and len(names) != len(clouds)):
        raise ValueError(
            f"names must have one entry for each of {len(clouds)} clouds, got {names!r}."
        )
    if names is None:
        names = [
            Path(cloud).name if isinstance(cloud, str | os.PathLike) else f"cloud {number}"
            for number, cloud in enumerate(clouds, 1)
        ]
    finite = [_as_cloud(cloud) for cloud in clouds]
    _check_extent(finite, names)
    sizes = [len(rows) for _, rows in finite]
    rows = [
        finite_rows[shuffled(size, most)]
        for (_, finite_rows), size, most in zip(
            finite, sizes, shares(sizes, max_points), strict=True
        )
    ]
    kept = [cloud.subset(chosen) for (cloud, _), chosen in zip(finite, rows, strict=True)]
    n_shown = sum(map(len, rows))
    if n_shown < sum(sizes):
        warn_caller(f"the page holds {counted(n_shown, 'point', of=sum(sizes))}, chosen at random")
    manifest, blocks = _pack(kept, rows, only)
    for told, name, size, cloud in zip(manifest["clouds"], names, sizes, kept, strict=True):
        told |= {"name": str(name), "total": size, "dropped": cloud.n_dropped}
    attributes = [attribute["name"] for attribute in manifest["attributes"]]
    units = {length_unit(cloud) for cloud in kept}
    manifest |= {
        "title": title or ", ".join(map(str, names)),
        "own_height": free_name("height", attributes),
        "unit": units.pop() if len(units) == 1 else None,
        "start": _first_color(color, [*attributes, free_name("height", attributes)]),
    }
    return CloudPage(
        _fill(manifest, blocks),
        n_points=sum(sizes),
        n_shown=n_shown,
        error=manifest["error"],
        spacing=manifest["spacing"],
        height=height,
        drawn_error=manifest["drawn"],
    )


def check_suffix(path: str | os.PathLike[str]) -> Path:
    """The path, if its name is that of a page."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path}: the name of a page ends in .html")
    return path


def shares(sizes, most):
    """How many points of each cloud a page of `most` points holds: one, and of the rest a share."""
    total = sum(sizes)
    if total <= most:
        return sizes
    n_clouds = len(sizes)
    return [1 + (size - 1) * (most - n_clouds) // (total - n_clouds) for size in sizes]


def _pack(clouds, rows, only):
    """What the page is told, and blocks of compressed bytes as text."""
    grid = Grid.of([cloud.xyz for cloud in clouds])
    sources, constants, skipped = plan_attributes([c.attributes for c in clouds], only)
    if skipped:
        warn_caller(f"attributes that hold no numbers are left out: {', '.join(skipped)}")
    missing = [name for name in only or () if not any(name in kept for kept in constants)]
    missing = [name for name in missing if not any(is_wanted(s.info, {name}) for s in sources)]
    if missing:
        raise ValueError(f"no cloud has an attribute {', '.join(map(repr, missing))}")
    told, blocks = [], list[bytes]()
    steps = [grid.encode(cloud.xyz) for cloud in clouds]
    for number, order in enumerate(rows):
        present = [i for i, source in enumerate(sources) if source.codes[number] is not None]
        columns = [column for i in present for column in sources[i].codes[number]]
        told.append(
            {
                "n": len(order),
                "attributes": present,
                "constants": {k: _plain(v) for k, v in constants[number].items()},
                "chunks": pack_points(steps[number], order, columns, blocks),
            }
        )
    middle = np.rint(np.median(steps[0], axis=0)).astype(np.int64)
    reach = max(int(np.abs(part.astype(np.int64) - middle).max()) for part in steps)
    manifest = grid._asdict() | {
        "low": grid.low.tolist(),
        "extent": np.max([part.max(axis=0) for part in steps], axis=0).tolist(),
        "middle": middle.tolist(),
        "drawn": float(np.spacing(np.float32(reach * grid.step)) / 2),
        "heights": _usual_range(np.concatenate([part[:, 2] for part in steps])),
        "attributes": [source.info for source in sources],
        "clouds": told,
    }
    return manifest, blocks


def _usual_range(steps):
    """The range of whole numbers, without a few that are far from all others."""
    low, high, least, largest = np.percentile(steps, [2, 98, 0, 100])
    reach = high - low
    return [int(max(least, low - reach)), int(min(largest, high + reach))]


def _fill(manifest, blocks):
    """The page with its data. JSON escapes what could end a script; blocks need no escape."""
    told = json.dumps(manifest, allow_nan=False, separators=(",", ":"))
    for character in "<>&\u2028\u2029":
        told = told.replace(character, f"\\u{ord(character):04x}")
    scripts = (f'<script type="text/plain" class="block">{block}</script>' for block in blocks)
    before, after = _template().split("<!--data-->")
    title = html.escape(manifest["title"])
    return "".join(
        [
            before.replace("<!--title-->", title),
            f'<script type="application/json" id="manifest">{told}</script>\n',
            "\n".join(scripts) + after,
        ]
    )


@cache
def _template():
    """The page without data and title."""
    folder = files("sklearn_mcmd.view") / "static"

    def text(name):
        return (folder / name).read_text(encoding="utf-8")

    script = "\n".join(['\n"use strict";', *(text(f"{name}.js") for name in SCRIPTS)]) + "\n"
    digest = b64encode(sha256(script.encode()).digest()).decode()
    return (
        text("page.html")
        .replace("/*style*/", text("view.css"))
        .replace("/*digest*/", f"sha256-{digest}")
        .replace("\n/*script*/\n", script)
    )


def _first_color(color, attributes):
    if color is None:
        return next((name for name in FIRST_COLORS if name in attributes), attributes[-1])
    if color not in attributes:
        raise ValueError(f"no attribute {color!r} to color by; there are {', '.join(attributes)}")
    return color


def _as_cloud(cloud):
    """A cloud, and its rows with finite coordinates, at least one."""
    if isinstance(cloud, str | os.PathLike):
        cloud = read_points(cloud)
    elif not isinstance(cloud, PointCloud):
        cloud = PointCloud(np.asarray(cloud))
    rows = np.flatnonzero(np.isfinite(cloud.xyz).all(axis=1))
    if len(rows) < len(cloud):
        n_left_out = len(cloud) - len(rows)
        words = f"{counted(n_left_out, 'point')} without finite coordinates"
        warn_caller(f"{words} {agreed(n_left_out, 'are')} left out")
    if len(rows) == 0:
        raise ValueError("A cloud without points (with finite coordinates) cannot be shown.")
    return cloud, rows


def check_count(value, name):
    if isinstance(value, bool) or not isinstance(value, Integral) or value < 1:
        raise ValueError(f"{name} must be a whole number of at least 1, got {value!r}.")


def _check_extent(clouds, names):
    """Refuse coordinates so far apart that float32 cannot hold their squares."""
    ends = [
        end for cloud, rows in clouds for end in (cloud.xyz[rows].min(0), cloud.xyz[rows].max(0))
    ]
    low, high = np.min(ends, axis=0), np.max(ends, axis=0)
    axis = int(np.argmax(high / 2 - low / 2))
    if high[axis] / 2 - low[axis] / 2 > LARGEST_EXTENT / 2:
        raise ValueError(
            f"{', '.join(map(str, names))}: {'xyz'[axis]} reaches from {low[axis]:.3g} to "
            f"{high[axis]:.3g}; a page holds extents up to {LARGEST_EXTENT:g}"
        )


def _plain(value: Any) -> Any:
    """A number as JSON has it: NaN and infinity become text."""
    return value if not isinstance(value, float) or math.isfinite(value) else str(value)
