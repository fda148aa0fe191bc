"""One turn of a spinning lidar on a campus."""

from collections.abc import Sequence
from numbers import Integral, Real

import numpy as np
from sklearn.utils import Bunch

from sklearn_mcmd._sklearn import Interval, validate_params
from sklearn_mcmd.datasets._sensing import SENSOR_PARAMETERS, Beams, Junk, Sensor, sense
from sklearn_mcmd.datasets._surfaces import Patch
from sklearn_mcmd.datasets._things import box, capped, car, house
from sklearn_mcmd.datasets._vegetation import Grass, hedge, leaves, tree
from sklearn_mcmd.datasets._world import World

# Meters; the sensor's foot is the origin.
_HEIGHT, _REACH = 1.5, 100.0
_ELEVATIONS = np.radians([-30.67, 10.67])
_PASSING = 0.1


@validate_params(
    {
        **SENSOR_PARAMETERS,
        "n_rings": [Interval(Integral, 2, None, closed="left")],
        "noise_growth": [Interval(Real, 1, None, closed="left")],
    },
    prefer_skip_nested_validation=True,
)
def make_spinning_turn(
    n_samples: int = 70_000,
    *,
    n_rings: int = 32,
    noise: float = 0.01,
    noise_growth: float = 4.0,
    outlier_share: float = 0.03,
    outlier_kinds: Sequence[str] = ("particle", "mixed_pixel", "ghost", "no_return"),
    far_share: float = 0.0,
    random_state: int | np.random.RandomState | None = None,
) -> Bunch:
    """Make one turn of a spinning lidar.

    A sensor 1.5 m above a yard: walls 4 to 50 m away, and shrubs, trees, pillars, poles, cars and
    pedestrians between them. Its rays leave in rings of equal elevation, at equal steps of
    azimuth. So on the ground rings are 0.14 m apart nearby and more than 30 m far away, while
    points on a ring are a few centimeters apart.

    Parameters
    ----------
    n_samples : int, default=70_000
        Number of points, outliers included.
    n_rings : int, default=32
        Number of rings, at equal steps of elevation from -30.67 to 10.67 degrees.
    noise : float, default=0.01
        Standard deviation of ranges at range 0, in meters.
    noise_growth : float, default=4.0
        Noise at a range of 100 m over that at range 0, at least 1; linear in between.
    outlier_share : float, default=0.03
        Share of outliers in [0, 1), rounded to a whole number of points.
    outlier_kinds : list or tuple of str
        Kinds of outliers, in (nearly) equal shares, as in :func:`make_mobile_scan`; by default
        particles, mixed pixels, ghosts and beams without an echo.
    far_share : float, default=0.0
        Share of far gross outliers in [0, 1), as in :func:`make_mobile_scan`.
    random_state : int, RandomState instance or None, default=None
        Seed. The same seed gives the same cloud.

    Returns
    -------
    scan : :class:`~sklearn.utils.Bunch`
        With the arrays of :func:`make_mobile_scan`; ``stretch`` is 0 for regular points.

    Raises
    ------
    ValueError
        As :func:`make_mobile_scan`.

    See Also
    --------
    make_mobile_scan : Says what all scanned scenes have in common.

    Notes
    -----
    The rings are those of a scanner with 32 beams, of which one turn on a campus (``fast_gicp``,
    69,792 points) is the model. There the median distance to the nearest other point is 1.3, 3.9
    and 13.6 cm at ranges of 3 to 6, 10 to 15 and 40 to 70 m, here 1.4, 3.8 and 13.5 cm. Half the
    points lie within 4.0 m there and 5.0 m here. The real turn also holds 5,106 points where the
    sensor is, of beams without an echo.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.datasets import make_spinning_turn
    >>> turn = make_spinning_turn(10_000, random_state=0)
    >>> turn.class_names[:4]
    ['ground', 'building', 'pole', 'vegetation']
    >>> np.unique(turn.viewpoints, axis=0).tolist()
    [[0.0, 0.0, 1.5]]
    """
    return sense(
        _campus,
        Sensor(
            make_beams=lambda n, rng: _beams(n, n_rings, rng),
            noise_at=lambda ranges: noise * (1 + (noise_growth - 1) * ranges / _REACH),
            reach=_REACH,
            passing=_PASSING,
        ),
        n_samples,
        Junk(outlier_share, list(outlier_kinds), far_share),
        random_state,
    )


def _beams(n, n_rings, rng):
    """Rings of equal steps of elevation; in each equal steps of azimuth, shifted by chance."""
    n_steps = max(1, round(n / n_rings))
    step = 2 * np.pi / n_steps
    azimuth = (np.arange(n_steps) + rng.random((n_rings, 1))).ravel() * step
    ring = np.repeat(np.arange(n_rings), n_steps)
    elevation = np.linspace(*_ELEVATIONS, n_rings)[ring]
    flat = np.cos(elevation)
    directions = np.column_stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
    )
    origins = np.tile([0.0, 0.0, _HEIGHT], (len(ring), 1))
    return Beams(origins, directions, ring, np.zeros(len(ring), int))


def _campus(rng):
    """A yard with walls 4 to 50 m away and much that stands in it."""
    houses = [
        ("hall", (4, 8.5, 0), 0.1, (18, 8), 6.0, 9.0),
        ("annex", (14, -4, 0), 1.45, (11, 6), 4.0, 6.0),
        ("wing", (-18, 1, 0), 1.5, (14, 8), 5.0, 8.0),
        ("tower", (24, -27, 0), 0.4, (12, 10), 14.0, 18.0),
        ("block", (-20, -44, 0), -0.2, (30, 10), 9.0, 12.0),
        ("store", (16, -56, 0), 0.15, (24, 12), 7.0, 10.0),
    ]
    trees = [
        tree("tree", (x, y, 0), rng.uniform(5, 8), rng.uniform(3, 4.5), rng)
        for x, y in ((7, -12), (-8, -11), (10, -21), (-3, -24), (4, -37), (-13, -29), (-8, 7))
    ]
    shrubs = [
        leaves("shrub", (*place, 0.5), (0.7, 0.7, 0.5), 10, 0.18, rng)
        for place in rng.uniform((-11, -17), (8, -7), (24, 2))
    ]
    poles = ((5, -4), (-6, 4.5), (12, -14), (-10, -20), (20, -33), (2, -33))
    pillars = [(x, -6.5) for x in np.arange(-7, 8, 2.0)]
    stands = [(x, -4.6) for x in np.arange(-5.5, -2, 0.4)]
    pedestrians = ((2.6, 2.2), (-4, -3), (6, -13), (-2, -15), (11, -25), (-5, -20))
    cars = ((-7, -1.5, 1.5), (0, -9.5, 0.2), (-11, -14, 1.2), (2, -20, 1.2), (-9, -36, 0.1))
    return World(
        {
            "ground": [Patch("ground", (-60, -75, 0), (120, 0, 0), (0, 100, 0))],
            "building": [
                *(part for args in houses for part in house(*args)),
                *box("steps", (-2, 3.2, 0), (3.0, 0.8, 0.3)),
                *box("bench", (1.5, -5.5, 0), (1.8, 0.45, 0.45)),
                *(p for x, y in pillars for p in capped("pillar", (x, y, 0), 0.16, 3.2)),
            ],
            "pole": [
                *(p for x, y in poles for p in capped("pole", (x, y, 0), 0.1, 7.0)),
                *(p for x, y in stands for p in capped("stand", (x, y, 0), 0.025, 0.9)),
            ],
            "vegetation": [
                *(part for parts in trees for part in parts),
                *shrubs,
                hedge("hedge", (9, -12, 0), (9, 0.9, 1.3), rng),
                hedge("hedge", (-12, -18, 0), (8, 0.9, 1.1), rng),
            ],
            "grass": [Grass("grass", (-11, -19, 0.001), (19, 0, 0), (0, 12, 0), 0.06)],
            "vehicle": [p for x, y, turn in cars for p in car("car", (x, y, 0), turn)],
            "pedestrian": [
                p for x, y in pedestrians for p in capped("pedestrian", (x, y, 0), 0.22, 1.7)
            ],
        }
    )
