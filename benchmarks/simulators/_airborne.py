"""A village at the edge of a forest, scanned from the air in two swaths."""

from itertools import pairwise

import numpy as np

from sklearn_mcmd.datasets._surfaces import Patch

from ._beams import Beams, Sensor
from ._outliers import sense_with
from ._things import capped, car, house
from ._vegetation import Grass, tree
from ._wires import WiredWorld, wire

# Meters. The scene lies in 0 <= x <= 80, 0 <= y <= 60.
_SIZE = np.array([80.0, 60.0])
_SWATHS = (0.0, 36.0), (26.0, 60.0)  # where they lie in y
_FLIGHTS = (-190.0, 250.0)  # in y
_ALTITUDE = 800.0
#: Distance of lines over that of points on a line; shake of points, in distances.
_ASPECT, _SHAKE = 2.0, 0.15
#: A beam is so wide at the ground that it meets a wire of this thickness.
_WIRE = 0.16
_PASSING = 0.45
#: Standard deviation of ranges, how much denser the first swath is, and the second too high.
_NOISE, _RATIO, _MISFIT = 0.014, 4.0, 0.03
#: Speed of the aircraft, and seconds from the begin of one flight to that of the next.
_SPEED, _NEXT = 60.0, 600.0


def make_airborne_scan(
    n_samples=60_000,
    *,
    outlier_share=0.02,
    outlier_kinds=("range_error", "ghost", "low", "high"),
    far_share=0.002,
    random_state=None,
):
    """80 m by 60 m: houses, trees, cars, grass, a ditch, wires on poles, and the edge of a forest
    on a slope.

    Two flights 800 m up look at it from both sides, 11 to 20 degrees off the vertical. Their swaths
    overlap by 10 m; the first is four times as dense, the second 3 cm too high.
    Beams may go on behind leaves and wires. Numbers follow two scans, of Amsterdam (AHN3) and of a
    village (IGN LiDAR HD): 15 and 23 points a square meter, here 15 in the first swath, 4 in the
    second; residuals of planes on the ground of 14 and 12 mm; points of vegetation 27 and 17 cm
    from the nearest other one, here 30 cm. Arrays are those of `make_mobile_scan`; ``stretch`` is
    the number of the swath.
    """

    def record(origins, directions, ranges, stretch):
        shift = np.outer(stretch == 1, [0.0, 0.0, _MISFIT])
        return origins + ranges[:, None] * directions + shift

    def extra(scan, beams, beam):
        return {
            "stretch": np.where(scan.target == 1, beams.stretch[beam], -1),
            "gps_time": beams.time[beam],
            "trajectory": _trajectory(),
        }

    sensor = Sensor(
        noise_at=lambda ranges: np.full(len(ranges), _NOISE),
        reach=2 * _ALTITUDE,
        passing=_PASSING,
        make_beams=_beams,
        record=record,
        extra=extra,
    )
    return sense_with(
        _world, sensor, n_samples, outlier_share, outlier_kinds, far_share, random_state
    )


def _beams(n, rng):
    """Lines across the flight; the second swath is sparser."""
    areas = np.array([_SIZE[0] * (high - low) for low, high in _SWATHS])
    density = n / (areas @ [1.0, 1.0 / _RATIO]) / np.array([1.0, _RATIO])
    swaths = []
    for (low, high), per_area in zip(_SWATHS, density, strict=True):
        step = np.array([_ASPECT, 1.0]) / np.sqrt(_ASPECT * per_area)
        x = np.arange(rng.random() * step[0], _SIZE[0], step[0])
        y = np.arange(low + rng.random() * step[1], high, step[1])
        target = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        line = np.repeat(np.arange(len(x)), len(y))
        swaths.append((target + _SHAKE * step * rng.standard_normal(target.shape), line))
    target = np.concatenate([t for t, _ in swaths])
    target = np.clip(target, 0, _SIZE)
    stretch = np.repeat([0, 1], [len(t) for t, _ in swaths])
    origins = np.column_stack(
        [target[:, 0], np.take(_FLIGHTS, stretch), np.full(len(target), _ALTITUDE)]
    )
    directions = np.column_stack([target, np.zeros(len(target))]) - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    line = np.concatenate([swaths[0][1], swaths[0][1].max() + 1 + swaths[1][1]])
    return Beams(origins, directions, line, stretch, stretch * _NEXT + target[:, 0] / _SPEED)


def _trajectory():
    """Both flights are straight, along x, at one speed."""
    ends = np.array([[x, y, _ALTITUDE] for y in _FLIGHTS for x in (0.0, _SIZE[0])])
    return np.repeat([0.0, _NEXT], 2) + ends[:, 0] / _SPEED, ends


def _world(rng):
    length = (80.0, 0, 0)
    ground = [
        Patch("meadow", (0, 0, 0), length, (0, 30, 0)),
        Patch("ditch_near", (0, 30, 0), length, (0, 1.5, -1.0)),
        Patch("ditch_far", (0, 31.5, -1.0), length, (0, 1.5, 1.0)),
        Patch("slope", (0, 33, 0), length, (0, 30, 6.0)),
    ]
    houses = [
        ("house_1", (12, 8, 0), 0.1, (14, 9), 5.0, 8.5),
        ("house_2", (36, 11, 0), 1.3, (12, 9), 4.0, 6.5),
        ("house_3", (64, 10, 0), -0.1, (20, 11), 6.0, 10.0),
        ("house_4", (66, 45, 2.0), 0.5, (13, 9), 3.5, 7.0),
        ("barn", (12, 21, 0), 0.0, (18, 7), 4.5, 6.0),
    ]
    trees = [
        tree("tree", (x, y, 0), rng.uniform(6, 10), rng.uniform(4, 6), rng)
        for x, y in ((25, 6), (27, 21), (48, 7), (50, 24), (75, 22))
    ]
    for x in np.arange(2.0, 50.0, 4.5):
        for y in np.arange(37.0, 62.0, 4.5):
            place = np.array([x, y]) + rng.uniform(-1.2, 1.2, 2)
            foot = (*place, 0.2 * (place[1] - 33))
            trees.append(tree("tree", foot, rng.uniform(9, 15), rng.uniform(4, 6), rng))
    ends = (1.0, 40.0, 79.0)
    wires = [
        wire("wire", (x0, y, z), (x1, y, z), 0.8, _WIRE)
        for x0, x1 in pairwise(ends)
        for y, z in ((26.4, 9.5), (27.6, 9.5), (27.0, 9.9))
    ]
    cars = ((23, 13, 0.4), (45, 19, 1.5), (52, 4, -0.2))
    return WiredWorld(
        {
            "ground": ground,
            "grass": [Grass("grass", (52, 17.5, 0.001), (26, 0, 0), (0, 9, 0), 0.1)],
            "building": [house(*args) for args in houses],
            "vegetation": trees,
            "vehicle": [car("car", (x, y, 0), turn) for x, y, turn in cars],
            "pole": [capped("pole", (x, 27, 0), 0.15, 10.0) for x in ends],
            "wire": wires,
        }
    )
