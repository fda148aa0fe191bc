"""One frame of a depth camera in a room."""

from collections.abc import Sequence
from itertools import pairwise
from numbers import Real

import numpy as np
from scipy.ndimage import gaussian_filter
from sklearn.utils import Bunch

from sklearn_mcmd._sklearn import Interval, validate_params
from sklearn_mcmd.datasets._sensing import SENSOR_PARAMETERS, Beams, Junk, Sensor, sense
from sklearn_mcmd.datasets._surfaces import Cylinder, Patch
from sklearn_mcmd.datasets._things import World, box, wire
from sklearn_mcmd.datasets._vegetation import leaves

# Meters. The camera looks along y, somewhat down.
_CAMERA = np.array([0.0, 0.0, 1.35])
_DOWN = np.radians(8)
_AXIS = np.array([0.0, np.cos(_DOWN), -np.sin(_DOWN)])
_REACH = 6.0
#: Half the width and height of the image at depth 1; pixels over which errors are alike.
_HALF = np.array([0.61, 0.4575])
_ALIKE = 1.3


@validate_params(
    {**SENSOR_PARAMETERS, "step": [Interval(Real, 0, None, closed="neither")]},
    prefer_skip_nested_validation=True,
)
def make_depth_frame(
    n_samples: int = 100_000,
    *,
    step: float = 0.0029,
    noise: float = 0.37,
    outlier_share: float = 0.02,
    outlier_kinds: Sequence[str] = ("mixed_pixel", "range_error"),
    far_share: float = 0.0,
    random_state: int | np.random.RandomState | None = None,
) -> Bunch:
    """Make one frame of a depth camera in a room.

    A camera at a height of 1.35 m looks into a room of 4.3 m by 4.4 m: walls with an open door,
    floor, a table, a chair, shelves with books, boxes, plants and cables. There is one beam a
    pixel. Depth, the distance along the camera's axis, is rounded to steps that grow with its
    square: 12 mm at 2 m, 46 mm at 4 m.

    Parameters
    ----------
    n_samples : int, default=100_000
        Number of points, outliers included.
    step : float, default=0.0029
        Step of the depth at 1 m, in meters: the inverse of a depth is rounded to whole multiples
        of it (in 1/m).
    noise : float, default=0.37
        Standard deviation of ranges before they are rounded, in steps at that range. Errors are
        alike in neighboring pixels.
    outlier_share : float, default=0.02
        Share of outliers in [0, 1), rounded to a whole number of points.
    outlier_kinds : list or tuple of str, default=("mixed_pixel", "range_error")
        Kinds of outliers, in (nearly) equal shares, as in :func:`make_mobile_scan`.
    far_share : float, default=0.0
        Share of far gross outliers in [0, 1), as in :func:`make_mobile_scan`.
    random_state : int, RandomState instance or None, default=None
        Seed. The same seed gives the same cloud.

    Returns
    -------
    scan : :class:`~sklearn.utils.Bunch`
        With the arrays of :func:`make_mobile_scan`, but for times. ``noise_scale`` holds rounding
        as well, as a standard deviation; ``stretch`` is 0 for regular points.

    Raises
    ------
    ValueError
        As :func:`make_mobile_scan`.

    See Also
    --------
    make_mobile_scan : Says what all scanned scenes have in common.

    Notes
    -----
    The step and its growth, the field of view (0.61 and 0.46 to each side at depth 1) and the
    range of depths are those of a frame of a depth camera in an office (``office1.pcd`` of the
    Point Cloud Library, 254,456 points): its 125 depths are 0.0028 to 0.0030 times their square
    apart. So is the noise: there on flat parts 83 % of the pixels have the depth of their right
    neighbor, residuals are 0.49 steps, and 25 % of the points lie in islands of one step with
    fewer than 50 points; here 83 %, 0.50 steps and 22 %.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.datasets import make_depth_frame
    >>> frame = make_depth_frame(20_000, random_state=0)
    >>> frame.class_names
    ['wall', 'floor', 'furniture', 'thing', 'plant', 'cable']
    """
    total = np.hypot(noise, np.sqrt(1 / 12))  # rounding adds a twelfth of a step squared
    return sense(
        _room,
        Sensor(
            make_beams=_beams,
            noise_at=lambda ranges: total * step * ranges**2,
            reach=_REACH,
            record=lambda origins, directions, ranges, _: _round_depth(
                origins, directions, ranges, step
            ),
            deviate=lambda beams, beam, rng: noise / total * _alike(beams, beam, rng),
        ),
        n_samples,
        Junk(outlier_share, list(outlier_kinds), far_share),
        random_state,
    )


def _beams(n, rng):
    """One beam a pixel, row by row."""
    n_rows = max(1, round(np.sqrt(n * _HALF[1] / _HALF[0])))
    n_columns = max(1, round(n / n_rows))
    v, u = (half * (2 * (np.arange(m) + 0.5) / m - 1)
            for half, m in zip(_HALF[::-1], (n_rows, n_columns), strict=True))  # fmt: skip
    v, u = (grid.ravel() for grid in np.meshgrid(v, u, indexing="ij"))
    down = np.array([0.0, -_AXIS[2], _AXIS[1]])
    directions = _AXIS + u[:, None] * [1.0, 0.0, 0.0] - v[:, None] * down
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    row = np.repeat(np.arange(n_rows), n_columns)
    return Beams(np.tile(_CAMERA, (len(row), 1)), directions, row, np.zeros(len(row), int))


def _alike(beams, beam, rng):
    """Standard normal errors that are alike in neighboring pixels."""
    n_rows = beams.line[-1] + 1
    field = gaussian_filter(rng.standard_normal((n_rows, len(beams.line) // n_rows)), _ALIKE)
    return (field / field.std()).ravel()[beam]


def _round_depth(origins, directions, ranges, step):
    """The inverse of a depth is rounded, so that steps grow with its square."""
    cosine = directions @ _AXIS
    level = np.maximum(np.round(1 / (step * cosine * ranges)), 1.0)
    return origins + (1 / (step * level * cosine))[:, None] * directions


def _room(rng):
    x0, x1, y1, top = -2.0, 2.3, 4.4, 2.7
    walls = [
        Patch("back_wall", (x0, y1, 0), (x1 - x0, 0, 0), (0, 0, top),
              holes=[(0.3, 1.2, 0.0, 2.1)]),
        Patch("left_wall", (x0, 0, 0), (0, y1, 0), (0, 0, top)),
        Patch("right_wall", (x1, y1, 0), (0, -y1, 0), (0, 0, top)),
        Patch("ceiling", (x0, 0, top), (0, y1, 0), (x1 - x0, 0, 0)),
        Patch("corridor", (x0 - 2, y1 + 2.5, 0), (5, 0, 0), (0, 0, top)),
    ]  # fmt: skip
    floor = [Patch("floor", (x0, 0, 0), (x1 - x0, 0, 0), (0, y1 + 2.5, 0))]
    table = [
        box("table", (-0.3, 2.1, 0.72), (1.8, 0.9, 0.035)),
        *(Cylinder("table_leg", (x, y, 0), (0, 0, 0.72), 0.025)
          for x in (-0.22, 1.42) for y in (2.18, 2.92)),
    ]  # fmt: skip
    chair = [
        box("chair", (-1.2, 2.0, 0.44), (0.45, 0.45, 0.03)),
        box("chair_back", (-1.2, 2.42, 0.55), (0.45, 0.03, 0.4)),
        *(Cylinder("chair_leg", (x, y, 0), (0, 0, 0.44), 0.013)
          for x in (-1.18, -0.78) for y in (2.02, 2.43)),
    ]  # fmt: skip
    books = np.cumsum(rng.uniform(0.02, 0.06, (3, 16)), axis=1)
    shelf = [
        box("shelf_side", (1.25, 3.95, 0), (0.03, 0.45, 1.9)),
        box("shelf_side", (2.25, 3.95, 0), (0.03, 0.45, 1.9)),
        *(box("shelf_board", (1.28, 3.97, z), (0.97, 0.42, 0.025)) for z in (0.4, 0.85, 1.3, 1.75)),
        *(box("book", (1.29 + left, rng.uniform(4.0, 4.12), z),
              (right - left - 0.002, 0.25, rng.uniform(0.2, 0.36)))[:3]
          for z, edges in zip((0.425, 0.875, 1.325), books, strict=True)
          for left, right in pairwise(edges)),
    ]  # fmt: skip
    things = [
        box("monitor", (0.3, 2.65, 0.9), (0.6, 0.05, 0.36)),
        Cylinder("monitor_foot", (0.6, 2.7, 0.755), (0, 0, 0.15), 0.025),
        box("parcel", (1.0, 2.3, 0.755), (0.3, 0.25, 0.2)),
        box("crate", (-0.2, 3.2, 0.0), (0.5, 0.4, 0.35)),
        Cylinder("lamp", (0.9, 3.0, 2.1), (0, 0, 0.25), 0.18),
    ]
    pot = np.array([-1.5, 3.3, 0.0])
    plants = [
        Cylinder("pot", pot, (0, 0, 0.3), 0.15),
        leaves("plant", (pot[0], pot[1], 0.75), (0.45, 0.45, 0.5), 60, 0.05, rng),
        leaves("small_plant", (0.05, 2.7, 0.95), (0.12, 0.12, 0.16), 25, 0.025, rng),
    ]
    cables = [
        wire("cable", (0.4, 2.98, 0.8), (0.2, 3.1, 0.02), 0.05, 0.012),
        wire("cable", (0.7, 2.98, 0.8), (1.2, 4.3, 0.3), 0.3, 0.012),
        wire("lamp_cable", (0.9, 3.0, 2.35), (0.9, 3.0, top), 0.0, 0.01),
        wire("cable", (-1.9, 3.9, 2.2), (-0.5, 4.2, 2.3), 0.15, 0.012),
    ]
    return World(
        {
            "wall": walls,
            "floor": floor,
            "furniture": table + chair + shelf,
            "thing": things,
            "plant": plants,
            "cable": cables,
        }
    )
