"""One frame of a depth camera in a room."""

from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter

from sklearn_mcmd.datasets._surfaces import Cylinder, Patch

from ._beams import Beams, Sensor
from ._outliers import sense_with
from ._things import box
from ._vegetation import leaves
from ._wires import WiredWorld, wire

# Meters. The camera looks along y, somewhat down.
_CAMERA = np.array([0.0, 0.0, 1.35])
_DOWN = np.radians(8)
_AXIS = np.array([0.0, np.cos(_DOWN), -np.sin(_DOWN)])
_REACH = 6.0
#: Half the width and height of the image at depth 1; pixels over which errors are alike.
_HALF = np.array([0.61, 0.4575])
_ALIKE = 1.3
_NOISE = 0.37  # in steps


def make_depth_frame(
    n_samples=100_000,
    *,
    step=0.0029,
    outlier_share=0.02,
    outlier_kinds=("mixed_pixel", "range_error"),
    far_share=0.0,
    random_state=None,
):
    """A camera at a height of 1.35 m looks into a room of 4.3 m by 4.4 m: walls with an open door,
    floor, a table, a chair, shelves with books, boxes, plants and cables.

    There is one beam a pixel. The inverse of a depth, the distance along the camera's axis, is
    rounded to whole multiples of `step` (in 1/m), so steps of depth grow with its square: 12 mm at
    2 m, 46 mm at 4 m. Noise is .37 steps, alike in neighboring pixels; ``noise_scale`` holds
    rounding as well. The step, the field of view, the range of depths and the noise are those of a
    frame of an office (``office1.pcd`` of the Point Cloud Library). Arrays are those of
    `make_lidar_turn`, but for rings.
    """
    total = np.hypot(_NOISE, np.sqrt(1 / 12))  # rounding adds a twelfth of a step squared
    sensor = Sensor(
        noise_at=lambda ranges: total * step * ranges**2,
        reach=_REACH,
        make_beams=_beams,
        record=lambda origins, directions, ranges, _: _round_depth(
            origins, directions, ranges, step
        ),
        deviate=lambda beams, beam, rng: _NOISE / total * _alike(beams, beam, rng),
    )
    return sense_with(
        _world, sensor, n_samples, outlier_share, outlier_kinds, far_share, random_state
    )


def _beams(n, rng):
    """One beam a pixel, row by row."""
    n_rows = max(1, round(np.sqrt(n * _HALF[1] / _HALF[0])))
    n_columns = max(1, round(n / n_rows))
    v, u = (2 * (np.arange(m) + 0.5) / m - 1 for m in (n_rows, n_columns))
    v, u = (g.ravel() for g in np.meshgrid(_HALF[1] * v, _HALF[0] * u, indexing="ij"))
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


def legs(name, xs, ys, height, radius):
    return [Cylinder(name, (x, y, 0), (0, 0, height), radius) for x in xs for y in ys]


def _world(rng):
    x0, x1, y1, top = -2.0, 2.3, 4.4, 2.7
    door = [(0.3, 1.2, 0.0, 2.1)]
    walls = [
        Patch("back_wall", (x0, y1, 0), (x1 - x0, 0, 0), (0, 0, top), holes=door),
        Patch("left_wall", (x0, 0, 0), (0, y1, 0), (0, 0, top)),
        Patch("right_wall", (x1, y1, 0), (0, -y1, 0), (0, 0, top)),
        Patch("ceiling", (x0, 0, top), (0, y1, 0), (x1 - x0, 0, 0)),
        Patch("corridor", (x0 - 2, y1 + 2.5, 0), (5, 0, 0), (0, 0, top)),
    ]
    floor = [Patch("floor", (x0, 0, 0), (x1 - x0, 0, 0), (0, y1 + 2.5, 0))]
    table = [
        box("table", (-0.3, 2.1, 0.72), (1.8, 0.9, 0.035)),
        *legs("table_leg", (-0.22, 1.42), (2.18, 2.92), 0.72, 0.025),
    ]
    chair = [
        box("chair", (-1.2, 2.0, 0.44), (0.45, 0.45, 0.03)),
        box("chair_back", (-1.2, 2.42, 0.55), (0.45, 0.03, 0.4)),
        *legs("chair_leg", (-1.18, -0.78), (2.02, 2.43), 0.44, 0.013),
    ]
    books = np.cumsum(rng.uniform(0.02, 0.06, (3, 16)), axis=1)
    shelf = [
        box("shelf_side", (1.25, 3.95, 0), (0.03, 0.45, 1.9)),
        box("shelf_side", (2.25, 3.95, 0), (0.03, 0.45, 1.9)),
        *(box("shelf_board", (1.28, 3.97, z), (0.97, 0.42, 0.025)) for z in (0.4, 0.85, 1.3, 1.75)),
    ]
    for z, edges in zip((0.425, 0.875, 1.325), books, strict=True):
        for left, right in pairwise(edges):
            corner = (1.29 + left, rng.uniform(4.0, 4.12), z)
            shelf += box("book", corner, (right - left - 0.002, 0.25, rng.uniform(0.2, 0.36)))[:3]
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
    return WiredWorld(
        {
            "wall": walls,
            "floor": floor,
            "furniture": table + chair + shelf,
            "thing": things,
            "plant": plants,
            "cable": cables,
        }
    )
