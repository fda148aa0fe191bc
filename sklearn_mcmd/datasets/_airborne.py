"""A village at the edge of a forest, scanned from the air in two swaths."""

from collections.abc import Sequence
from itertools import pairwise
from numbers import Real

import numpy as np
from sklearn.utils import Bunch

from sklearn_mcmd._sklearn import Interval, validate_params
from sklearn_mcmd.datasets._sensing import SENSOR_PARAMETERS, Beams, Junk, Sensor, Trajectory, sense
from sklearn_mcmd.datasets._surfaces import Patch
from sklearn_mcmd.datasets._things import World, capped, car, house, wire
from sklearn_mcmd.datasets._vegetation import Grass, tree

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
#: Speed of the aircraft, and seconds from the begin of one flight to that of the next.
_SPEED, _NEXT = 60.0, 600.0


@validate_params(
    {
        **SENSOR_PARAMETERS,
        "density_ratio": [Interval(Real, 1, None, closed="left")],
        "misfit": [Interval(Real, None, None, closed="neither")],
    },
    prefer_skip_nested_validation=True,
)
def make_airborne_scan(
    n_samples: int = 60_000,
    *,
    noise: float = 0.014,
    density_ratio: float = 4.0,
    misfit: float = 0.03,
    outlier_share: float = 0.02,
    outlier_kinds: Sequence[str] = ("range_error", "ghost", "low", "high"),
    far_share: float = 0.002,
    random_state: int | np.random.RandomState | None = None,
) -> Bunch:
    """Make an airborne scan of a village and a forest, in two swaths that overlap.

    80 m by 60 m: houses, trees, cars, grass, a ditch, wires on poles, and the edge of a forest
    on a slope. Two flights 800 m up look at it from both sides, 11 to 20 degrees off the
    vertical. Their swaths overlap by 10 m. A beam may go on behind leaves and wires, so crowns
    return several echoes of a beam and some reach the ground.

    Parameters
    ----------
    n_samples : int, default=60_000
        Number of points, outliers included.
    noise : float, default=0.014
        Standard deviation of ranges, in meters.
    density_ratio : float, default=4.0
        Density of the first swath (0 < y < 36) over that of the second (26 < y < 60), at
        least 1. Where they overlap the densities add up.
    misfit : float, default=0.03
        Height of the second swath above the truth, in meters: swaths never fit quite.
    outlier_share : float, default=0.02
        Share of outliers in [0, 1), rounded to a whole number of points.
    outlier_kinds : list or tuple of str, default=("range_error", "ghost", "low", "high")
        Kinds of outliers, in (nearly) equal shares, as in :func:`make_mobile_scan`.
    far_share : float, default=0.002
        Share of far gross outliers in [0, 1), as in :func:`make_mobile_scan`.
    random_state : int, RandomState instance or None, default=None
        Seed. The same seed gives the same cloud.

    Returns
    -------
    scan : :class:`~sklearn.utils.Bunch`
        With the arrays of :func:`make_mobile_scan`; ``stretch`` is the number of the swath, 0
        or 1. ``true_points`` are without the misfit. ``gps_time`` and ``trajectory`` are those of
        two straight flights at 60 m/s.

    Raises
    ------
    ValueError
        As :func:`make_mobile_scan`.

    See Also
    --------
    make_mobile_scan : Says what all scanned scenes have in common.

    Notes
    -----
    Numbers follow two airborne scans: a part of Amsterdam (AHN3, 45,345 points) and a village
    (IGN LiDAR HD, 249,000 points). There are 15 and 23 points a square meter, here by default 15
    in the first swath, 4 in the second and 22 in both. Residuals of planes on the ground are 14
    and 12 mm. Points of vegetation are 27 and 17 cm from the nearest other one (median), here
    30 cm; 18 and 9 % of all echoes are not the first, here 8 %. Swaths of the village are
    adjusted: their misfit is 7 mm.

    Examples
    --------
    >>> from sklearn_mcmd.datasets import make_airborne_scan
    >>> scan = make_airborne_scan(5000, random_state=0)
    >>> scan.class_names
    ['ground', 'grass', 'building', 'vegetation', 'vehicle', 'pole', 'wire']
    """
    return sense(
        _village,
        Sensor(
            make_beams=lambda n, rng: _beams(n, density_ratio, rng),
            noise_at=lambda ranges: np.full(len(ranges), float(noise)),
            record=lambda origins, directions, ranges, stretch: (
                origins
                + ranges[:, None] * directions
                + np.outer(stretch == 1, [0.0, 0.0, float(misfit)])
            ),
            reach=2 * _ALTITUDE,
            passing=_PASSING,
            tell=lambda _, beams, beam: {"gps_time": beams.time[beam], "trajectory": _trajectory()},
        ),
        n_samples,
        Junk(outlier_share, list(outlier_kinds), far_share),
        random_state,
    )


def _beams(n, density_ratio, rng):
    """Lines across the flight; the second swath is sparser by `density_ratio`."""
    areas = np.array([_SIZE[0] * (high - low) for low, high in _SWATHS])
    density = n / (areas @ [1.0, 1.0 / density_ratio]) / np.array([1.0, density_ratio])
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
    return Trajectory(np.repeat([0.0, _NEXT], 2) + ends[:, 0] / _SPEED, ends)


def _village(rng):
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
    return World(
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
