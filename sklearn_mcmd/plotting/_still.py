"""Still pictures of point clouds, drawn from far to near."""

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sklearn_mcmd._extras import import_extra
from sklearn_mcmd.io._point_cloud import COLORS, with_results
from sklearn_mcmd.plotting._views import VIEW, camera, draw_scale_bar, look

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Red, green, blue of surfaces and of edges in files.
SURFACE_COLOR, EDGE_COLOR = (170, 170, 170), (215, 30, 30)
OUTLIER_COLOR = (0.84, 0.10, 0.11)  # red, of outliers in pictures
BALL_WORDS = "a ball in these\ncolors; opposite\nnormals look alike"
BALL_PIXELS = 121  # along a side of the ball
FAR, NEAR = (0.80, 0.83, 0.87), (0.24, 0.28, 0.34)  # grays that shade a cloud by distance


def plot_cloud(
    xyz: "ArrayLike",
    *,
    color: Any = None,
    outliers: "ArrayLike | None" = None,
    view: str | tuple[float, float] = VIEW,
    size: float | None = None,
    scale_bar: bool = False,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a cloud as it looks from far away, with near points over far ones.

    Parameters
    ----------
    xyz : array-like of shape (n, 3)
        Coordinates, z up. All points are drawn; a million take some seconds.
    color : color, or array-like of shape (n,), (n, 3) or (n, 4), default=None
        One Matplotlib color, a number for each point (colored by Matplotlib's color map), or a
        color for each point. None shades by distance, from light (far) to dark (near).
    outliers : array-like of bool of shape (n,), default=None
        Points to draw in red, and larger.
    view : {"top", "front", "side", "perspective"} or tuple of two floats
        Azimuth and elevation of the camera, in degrees. The default looks along +y, a little to
        the left, and from above. "top" looks down with x to the right, "front" along +y, "side"
        along -x. All have parallel rays but "perspective", which sees near things larger, from
        the default's side.
    size : float, default=None
        Diameter of a point in typographic points. None chooses one that covers the picture.
    scale_bar : bool, default=False
        Whether a bar shows a length. In perspective it is true in the middle of the cloud.
    ax : matplotlib.axes.Axes, default=None
        Axes to draw on. None makes a new figure.

    Returns
    -------
    ax : matplotlib.axes.Axes
        With equal scales and no frame. Data coordinates are those of the picture plane, in the
        units of `xyz`.

    See Also
    --------
    normal_colors : Colors that make a cloud look like a lit solid.

    Examples
    --------
    >>> from sklearn_mcmd.datasets import make_street
    >>> from sklearn_mcmd.plotting import plot_cloud
    >>> street = make_street(2_000, random_state=0)
    >>> ax = plot_cloud(street.data, outliers=street.target == -1)
    >>> len(ax.collections[0].get_offsets())
    2000
    """
    plt = import_extra("matplotlib.pyplot", "plot", "Plotting")
    points = check_points(xyz, finite=True)
    picture, depth = look(points, view)
    order = np.argsort(depth, kind="stable")

    if ax is None:
        _, ax = plt.subplots(figsize=(8, 6), layout="compressed")
    low, high = picture.min(axis=0), picture.max(axis=0)
    margin = 0.02 * (high - low).max() or 1.0  # a single point has no extent
    ax.set(
        aspect="equal",
        xlim=(low[0] - margin, high[0] + margin),
        ylim=(low[1] - margin, high[1] + margin),
    )
    ax.set_axis_off()

    color = _distance_colors(depth) if color is None else _as_rgb(color, len(points))
    size = _marker_size(ax, high - low, len(points)) if size is None else size
    sizes = np.full(len(points), float(size))
    if outliers is not None:
        marked = np.asarray(outliers)
        if marked.dtype != bool or marked.shape != (len(points),):
            raise ValueError(
                f"outliers must be a boolean mask of shape ({len(points)},), got shape "
                f"{marked.shape} and dtype {marked.dtype}."
            )
        color[marked] = OUTLIER_COLOR
        sizes[marked] *= 1.2
    ax.scatter(
        picture[order, 0],
        picture[order, 1],
        s=sizes[order] ** 2,
        c=color[order],
        linewidths=0,
        rasterized=True,
    )
    if scale_bar:
        draw_scale_bar(ax, " in the middle" if view == "perspective" else "")
    return ax


def normal_colors(
    normals: "ArrayLike", *, view: str | tuple[float, float] = VIEW
) -> NDArray[np.float64]:
    """Colors of a solid lit from the camera's upper left, tinted by the direction of its faces.

    Parameters
    ----------
    normals : array-like of shape (n, 3)
        Unit normals; their sign does not matter. NaN gives gray.
    view : {"top", "front", "side", "perspective"} or tuple of two floats
        The camera, as in :func:`plot_cloud`.

    Returns
    -------
    colors : ndarray of float of shape (n, 3)
        RGB in [0, 1].

    Examples
    --------
    >>> from sklearn_mcmd.plotting import normal_colors
    >>> up, down = normal_colors([[0, 0, 1], [0, 0, -1]])
    >>> bool((up == down).all())
    True
    """
    faces = check_points(normals, "normals")
    right, up, toward = camera(view)
    seen = np.where((faces @ toward < 0)[:, None], -faces, faces)
    light = 0.8 * toward - 0.5 * right + 0.5 * up
    shade = 0.45 + 0.55 * np.clip(seen @ (light / np.linalg.norm(light)), 0.0, 1.0)
    # Faces along x, y and z each have their own hue; other directions mix these.
    hues = np.array([[0.86, 0.42, 0.30], [1.0, 0.88, 0.62], [0.45, 0.66, 0.84]])
    colors = shade[:, None] * (seen**2 @ hues)  # squares of a unit normal sum to 1
    return np.where(np.isnan(colors), 0.6, np.clip(colors, 0.0, 1.0))


def draw_ball(ax, view):
    """The legend of `normal_colors`, right of the axes: a ball, whose normals are known."""
    boxes = import_extra("matplotlib.offsetbox", "plot", "Plotting")
    across, height = np.meshgrid(*[np.linspace(-1.0, 1.0, BALL_PIXELS)] * 2)
    square = across**2 + height**2
    depth = np.sqrt(np.maximum(1.0 - square, 0.0))
    normals = np.stack([across, height, depth], axis=-1) @ np.stack(camera(view))
    colors = normal_colors(normals.reshape(-1, 3), view=view).reshape(*square.shape, 3)
    ball = np.dstack([colors, square <= 1.0])  # transparent around it
    words = boxes.TextArea(BALL_WORDS, textprops={"size": 9, "color": "0.25"})
    both = [boxes.OffsetImage(ball, zoom=0.5, origin="lower"), words]
    both = boxes.VPacker(children=both, align="center", pad=0, sep=3)
    place = {"bbox_to_anchor": (1, 1), "bbox_transform": ax.transAxes, "frameon": False}
    ax.add_artist(boxes.AnchoredOffsetbox("upper left", child=both, **place))


def region_colors(labels: "ArrayLike") -> NDArray[np.float64]:
    """Colors that distinguish regions: neighboring numbers differ most.

    Parameters
    ----------
    labels : array-like of int of shape (n,)
        Regions from 0 on; negative ones, points of no region, are gray.

    Returns
    -------
    colors : ndarray of float of shape (n, 3)
        RGB in [0, 1].

    Examples
    --------
    >>> from sklearn_mcmd.plotting import region_colors
    >>> (255 * region_colors([0, 1, -1])).round().astype(int)
    array([[230,  83,  83],
           [ 90, 121, 196],
           [ 76,  76,  76]])
    """
    number = np.asarray(labels)
    hue = 6.0 * (number * ((np.sqrt(5.0) - 1.0) / 2.0) % 1.0)  # turns by the golden angle
    value = np.take([0.90, 0.77, 0.62], number % 3)
    saturation = np.take([0.64, 0.54, 0.74], number % 3)
    # Red, green and blue of hue, saturation and value: each is full over two of six sectors, falls
    # over one and is least over two.
    sector = (np.array([5.0, 3.0, 1.0]) + hue[:, None]) % 6.0
    shade = np.clip(np.minimum(sector, 4.0 - sector), 0.0, 1.0)
    colors = value[:, None] * (1.0 - saturation[:, None] * shade)
    return np.where((number < 0)[:, None], 0.3, colors)


def with_regions(cloud, labels, colors=None):
    """A cloud with the numbers of regions, painted if `colors`, or if None and it has no colors."""
    columns = {"region": labels.astype(np.int32)}
    return _painted(cloud, columns, colors, lambda: np.rint(255 * region_colors(labels)))


def with_edges(cloud, is_edge, score, colors=None):
    """A cloud with labels and scores of edges, painted likewise."""
    columns = edge_columns(is_edge, score)
    paint = partial(np.where, is_edge[:, None], EDGE_COLOR, SURFACE_COLOR)
    return _painted(cloud, columns, colors, paint)


def edge_columns(is_edge, score):
    """Labels and scores of points (n,), as in files."""
    return {"edge": is_edge.astype(np.uint8), "edge_score": score.astype(np.float32)}


def _painted(cloud, columns, colors, paint):
    if colors is None:
        colors = cloud.attributes.keys().isdisjoint(COLORS)
    if colors:
        bits = paint().astype(np.uint8)
        columns |= dict(zip(COLORS, bits.T.copy(), strict=True))
    return with_results(cloud, columns)


def _distance_colors(depth):
    """A color between that of far and that of near points, for each depth (n,)."""
    # Percentiles, because a single far point would take the contrast from all others.
    low, high = np.percentile(depth, [1, 99])
    share = np.clip((depth - low) / max(high - low, np.finfo(float).tiny), 0.0, 1.0)[:, None]
    return (1 - share) * np.array(FAR) + share * np.array(NEAR)


def _marker_size(ax, extent, n_points):
    """Diameter at which the points would cover the picture once, between 0.4 and 6."""
    figure = ax.get_figure()
    figure.draw_without_rendering()  # fixes the layout
    box = ax.get_window_extent()
    # Points of type, 72 an inch, for a unit of the cloud. Each point gets its share of the area.
    scale = 72.0 / figure.dpi * np.min([box.width, box.height] / np.maximum(extent, 1e-300))
    return float(np.clip(scale * np.sqrt(extent[0] * extent[1] / n_points), 0.4, 6.0))


def color_modules():
    """Matplotlib's modules of colored values and of colors."""
    return (import_extra(f"matplotlib.{name}", "plot", "Plotting") for name in ("cm", "colors"))


def _as_rgb(color, n_points):
    cm, colors = color_modules()
    values = None if isinstance(color, str) else np.asarray(color)
    if values is not None and values.shape == (n_points,) and values.dtype.kind in "biuf":
        return cm.ScalarMappable().to_rgba(values)[:, :3].copy()
    return np.broadcast_to(colors.to_rgba_array(color)[:, :3], (n_points, 3)).copy()


def check_points(xyz, name="xyz", finite=False):
    xyz = np.asarray(xyz, dtype=np.float64)
    if xyz.ndim != 2 or xyz.shape[1] != 3 or len(xyz) == 0:
        raise ValueError(f"{name} must have shape (n, 3) with n > 0, got {xyz.shape}.")
    if finite and not np.isfinite(xyz).all():
        raise ValueError(f"{name} must be finite, got NaN or infinity.")
    return xyz
