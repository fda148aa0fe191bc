"""From where a cloud is seen, which of its points are drawn, and how long a meter is there."""

import numpy as np

from sklearn_mcmd._extras import import_extra

VIEW = (-64.0, 26.0)  # azimuth and elevation of the camera, degrees
VIEWS = {"top": (-90.0, 90.0), "front": (-90.0, 0.0), "side": (0.0, 0.0), "perspective": VIEW}
EYE = 2.6  # of the perspective view, in radii of the cloud from its middle
NEAREST = 0.25  # no point is enlarged as if it were nearer than this share of that distance


def look(points, view):
    """Places of points (n, 3) on the picture plane, and how near they are, in units of the cloud.

    The view is a name, or azimuth and elevation.

    In perspective a length in the middle of the cloud is true, nearer ones are enlarged.
    """
    right, up, toward = camera(view)
    places, nearness = np.column_stack([points @ right, points @ up]), points @ toward
    if isinstance(view, str) and view == "perspective":
        low, high = np.percentile(np.column_stack([places, nearness]), [1, 99], axis=0)
        *middle, depth = (low + high) / 2
        eye = EYE * np.linalg.norm(high - low) / 2
        if eye > 0:
            # Similar triangles: what is as far as the middle keeps its length.
            enlarged = eye / np.maximum(eye - (nearness - depth), NEAREST * eye)
            places = middle + (places - middle) * enlarged[:, None]
    return places, nearness


def camera(view):
    """Unit vectors to the right, up and toward the camera."""
    azimuth, elevation = np.radians(_angles(view))
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    level = np.array([np.cos(azimuth), np.sin(azimuth)])
    toward = np.append(np.cos(elevation) * level, np.sin(elevation))
    return right, np.cross(toward, right), toward


def thinned(labels, most):
    """Rows of at most `most` points, in order, that keep rare classes visible.

    Half of the draws are of points, half of classes, which have equal chances.
    """
    if len(labels) <= most:
        return np.arange(len(labels))
    _, classes, sizes = np.unique(labels, return_inverse=True, return_counts=True)
    # The first to come of exponential waiting times, whose rates are the chances, are a draw
    # without replacement.
    chance = 1 / len(labels) + 1 / (len(sizes) * sizes[classes])
    waiting = np.random.default_rng(0).exponential(size=len(labels)) / chance
    return np.sort(np.argpartition(waiting, most)[:most])


def draw_scale_bar(ax, note=""):
    """A bar of 1, 2 or 5 times a power of ten below the lower left corner, and its length."""
    artists = import_extra("mpl_toolkits.axes_grid1.anchored_artists", "plot", "Plotting")
    length = round_length(0.2 * np.ptp(ax.get_xlim()))
    place = {"bbox_to_anchor": (0, 0), "bbox_transform": ax.transAxes, "frameon": False}
    words = f"{length:g}{note}"
    ax.add_artist(
        artists.AnchoredSizeBar(ax.transData, length, words, "upper left", color="0.2", **place)
    )


def _angles(view):
    if not isinstance(view, str):
        angles = np.asarray(view)
        numbers = angles.dtype.kind in "biuf"
        if not numbers or angles.shape != (2,) or not np.isfinite(angles).all():
            raise ValueError(f"view must be a name or azimuth and elevation, got {view!r}.")
        return angles
    if view not in VIEWS:
        raise ValueError(
            f"view={view!r} is unknown; known are {', '.join(VIEWS)}, or azimuth and elevation."
        )
    return VIEWS[view]


def round_length(longest):
    """The largest of 1, 2 or 5 times a power of ten that is no longer."""
    power = 10.0 ** np.floor(np.log10(longest))
    return max(factor * power for factor in (1.0, 2.0, 5.0) if factor * power <= longest)
