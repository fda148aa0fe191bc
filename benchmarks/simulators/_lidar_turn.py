"""One turn of a spinning lidar on a campus."""

import numpy as np

from sklearn_mcmd.datasets._labels import outlier_sizes
from sklearn_mcmd.datasets._surfaces import Patch

from ._beams import Beams, Sensor
from ._sensing import sense
from ._sensor_outliers import SENSOR_OUTLIERS
from ._things import World, box, capped, car, house
from ._vegetation import Grass, hedge, leaves, tree

_GROUND, _REACH = -1.5, 100.0  # meters; the sensor is the origin
_N_RINGS = 32  # at equal steps of elevation
_ELEVATIONS = np.radians([-30.67, 10.67])  # of the lowest and the highest ring
_NOISE_GROWTH = 4.0  # at the end of the reach, over that at range 0
_PASSING = 0.1  # chance that a beam goes on behind leaves


def make_lidar_turn(
    n_samples=70_000,
    *,
    noise=0.01,
    outlier_share=0.03,
    outlier_kinds=("particle", "mixed_pixel", "ghost", "no_return"),
    beam_divergence=0.0,
    snow=0.0,
    random_state=None,
):
    """A sensor at the origin, 1.5 m above a yard: walls 4 to 50 m away, and shrubs, trees, pillars,
    poles, cars and pedestrians between them.

    Its rays leave in 32 rings, at equal steps of elevation from -30.67 to 10.67 degrees and at
    equal steps of azimuth. So on the ground rings are 0.14 m apart nearby and more than 30 m far
    away, while points on a ring are a few centimeters apart. `noise` of ranges in meters grows to
    four times as much at 100 m. `outlier_kinds` are those of `SENSOR_OUTLIERS`. Beams of some
    divergence, usually 0.002 to 0.003, mix what they meet within 0.75 m. `snow` is the snowfall in
    mm of water an hour, 1 is light, 2.5 heavy: its outliers come besides those of `outlier_share`.

    The arrays are those of `make_street` but ``edge_distance`` and ``spacing``. True points are
    where beams end; normals are NaN in leaves and grass, too. Besides them there are

    - ``classification``, int64: number of the class in ``class_names``; -1 for outliers;
    - ``echo``, int8: 1 for the first echo of a beam, 2 for what it meets behind, and so on; 0 for
      outliers;
    - ``ring``, int64: from below; of outliers that lie on no beam, the ring nearest in elevation.

    Its model is one turn on a campus (``fast_gicp``, 69,792 points). There the median distance to
    the nearest other point is 1.3, 3.9 and 13.6 cm at ranges of 3 to 6, 10 to 15 and 40 to 70 m,
    here 1.4, 3.8 and 13.5 cm. Half the points lie within 4.0 m there and 5.0 m here. The real turn
    also holds 5,106 points where the sensor is, of beams without an echo.
    """
    sensor = Sensor(
        noise_at=lambda ranges: noise * (1 + (_NOISE_GROWTH - 1) * ranges / _REACH),
        reach=_REACH,
        passing=_PASSING,
        divergence=beam_divergence,
        snow=snow,
        make_beams=_beams,
        extra=lambda scan, beams, beam: {"ring": _rings(scan, beams.line[beam])},
    )
    sizes = outlier_sizes(n_samples, outlier_share, outlier_kinds, SENSOR_OUTLIERS)
    return sense(_campus, sensor, n_samples, sizes, random_state)


def _beams(n, rng):
    """Rings of equal steps of elevation; in each equal steps of azimuth, shifted by chance."""
    n_steps = max(1, round(n / _N_RINGS))
    step = 2 * np.pi / n_steps
    azimuth = (np.arange(n_steps) + rng.random((_N_RINGS, 1))).ravel() * step
    ring = np.repeat(np.arange(_N_RINGS), n_steps)
    elevation = np.linspace(*_ELEVATIONS, _N_RINGS)[ring]
    flat = np.cos(elevation)
    directions = np.column_stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
    )
    return Beams(np.zeros((len(ring), 3)), directions, ring, np.zeros(len(ring), int))


def _rings(scan, ring):
    """Ring of each point; of an outlier that is off the beams, the one nearest in elevation."""
    ranges = np.linalg.norm(scan.data, axis=1)
    off = np.flatnonzero((scan.target == -1) & (ranges > 0))
    low, high = _ELEVATIONS
    share = (np.arcsin(scan.data[off, 2] / ranges[off]) - low) / (high - low)
    ring[off] = np.clip(np.rint(share * (_N_RINGS - 1)), 0, _N_RINGS - 1)
    return ring


def _campus(rng):
    """A yard with walls 4 to 50 m away and much that stands in it."""
    g = _GROUND
    houses = [
        ("hall", (4, 8.5, g), 0.1, (18, 8), 6.0, 9.0),
        ("annex", (14, -4, g), 1.45, (11, 6), 4.0, 6.0),
        ("wing", (-18, 1, g), 1.5, (14, 8), 5.0, 8.0),
        ("tower", (24, -27, g), 0.4, (12, 10), 14.0, 18.0),
        ("block", (-20, -44, g), -0.2, (30, 10), 9.0, 12.0),
        ("store", (16, -56, g), 0.15, (24, 12), 7.0, 10.0),
    ]
    trees = [
        tree("tree", (x, y, g), rng.uniform(5, 8), rng.uniform(3, 4.5), rng)
        for x, y in ((7, -12), (-8, -11), (10, -21), (-3, -24), (4, -37), (-13, -29), (-8, 7))
    ]
    shrubs = [
        leaves("shrub", (*place, g + 0.5), (0.7, 0.7, 0.5), 10, 0.18, rng)
        for place in rng.uniform((-11, -17), (8, -7), (24, 2))
    ]
    poles = ((5, -4), (-6, 4.5), (12, -14), (-10, -20), (20, -33), (2, -33))
    pillars = [(x, -6.5) for x in np.arange(-7, 8, 2.0)]
    stands = [(x, -4.6) for x in np.arange(-5.5, -2, 0.4)]
    pedestrians = ((2.6, 2.2), (-4, -3), (6, -13), (-2, -15), (11, -25), (-5, -20))
    cars = ((-7, -1.5, 1.5), (0, -9.5, 0.2), (-11, -14, 1.2), (2, -20, 1.2), (-9, -36, 0.1))
    return World(
        {
            "ground": [Patch("ground", (-60, -75, g), (120, 0, 0), (0, 100, 0))],
            "building": [
                *(house(*args) for args in houses),
                box("steps", (-2, 3.2, g), (3.0, 0.8, 0.3)),
                box("bench", (1.5, -5.5, g), (1.8, 0.45, 0.45)),
                *(capped("pillar", (x, y, g), 0.16, 3.2) for x, y in pillars),
            ],
            "pole": [
                *(capped("pole", (x, y, g), 0.1, 7.0) for x, y in poles),
                *(capped("stand", (x, y, g), 0.025, 0.9) for x, y in stands),
            ],
            "vegetation": [
                *trees,
                *shrubs,
                hedge("hedge", (9, -12, g), (9, 0.9, 1.3), rng),
                hedge("hedge", (-12, -18, g), (8, 0.9, 1.1), rng),
            ],
            "grass": [Grass("grass", (-11, -19, g + 0.001), (19, 0, 0), (0, 12, 0), 0.06)],
            "vehicle": [car("car", (x, y, g), turn) for x, y, turn in cars],
            "pedestrian": [capped("pedestrian", (x, y, g), 0.22, 1.7) for x, y in pedestrians],
        }
    )
