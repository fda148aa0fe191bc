"""One turn of a spinning lidar on a campus."""

from collections.abc import Sequence
from numbers import Integral, Real

import numpy as np
from sklearn.utils import Bunch

from sklearn_mcmd._sklearn import Interval, validate_params
from sklearn_mcmd.datasets._sensing import SENSOR_PARAMETERS, Beams, Junk, Sensor, sense
from sklearn_mcmd.datasets._surfaces import Patch
from sklearn_mcmd.datasets._things import box, capped, car, house
from sklearn_mcmd.datasets._vegetation import Grass, hedge, tree
from sklearn_mcmd.datasets._world import World

# Metres; the sensor's foot is the origin.
_HEIGHT, _REACH = 1.9, 100.0
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
    outlier_kinds: Sequence[str] = ("particle", "mixed_pixel", "ghost"),
    far_share: float = 0.0,
    random_state: int | np.random.RandomState | None = None,
) -> Bunch:
    """Make one turn of a spinning lidar.

    A sensor 1.9 m above a yard: buildings, trees, hedges, poles, cars and pedestrians 4 to 60 m
    away. Its rays leave in rings of equal elevation, at equal steps of azimuth. So on the ground
    rings are 0.2 m apart nearby and 40 m at the horizon, while points on a ring are a few
    centimetres apart.

    Parameters
    ----------
    n_samples : int, default=70_000
        Number of points, outliers included.
    n_rings : int, default=32
        Number of rings, at equal steps of elevation from -30.67 to 10.67 degrees.
    noise : float, default=0.01
        Standard deviation of ranges at range 0, in metres.
    noise_growth : float, default=4.0
        Noise at a range of 100 m over that at range 0, at least 1; linear in between.
    outlier_share : float, default=0.03
        Share of outliers in [0, 1), rounded to a whole number of points.
    outlier_kinds : list or tuple of str, default=("particle", "mixed_pixel", "ghost")
        Kinds of outliers, in (nearly) equal shares, as in :func:`make_mobile_scan`.
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
    The rings are those of a scanner with 32 beams, whose turn on a campus (``fast_gicp``, 69,792
    points) the buildings' distances follow: half the points within 4.0 m there and 7.0 m here,
    5 % beyond 14 m there and 41 m here. The median distance to the nearest point is 1.3, 3.9 and
    14 cm there at 3 to 6, 10 to 15 and 40 to 70 m, and 1.4, 3.5 and 12 cm here.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn_mcmd.datasets import make_spinning_turn
    >>> turn = make_spinning_turn(10_000, random_state=0)
    >>> turn.class_names[:4]
    ['ground', 'building', 'pole', 'vegetation']
    >>> np.unique(turn.viewpoints, axis=0).tolist()
    [[0.0, 0.0, 1.9]]
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
    """A yard with buildings 7 to 50 m away."""
    houses = [
        ("hall", (3, 11, 0), 0.1, (22, 8), 6.0, 9.0),
        ("wing", (-16, -3, 0), 1.5, (14, 8), 5.0, 8.0),
        ("tower", (31, -18, 0), 0.4, (12, 10), 14.0, 18.0),
        ("block", (-22, -45, 0), -0.2, (30, 10), 9.0, 12.0),
        ("store", (22, -55, 0), 0.15, (24, 12), 7.0, 10.0),
    ]
    trees = [
        tree("tree", (x, y, 0), rng.uniform(6, 9), rng.uniform(3.5, 5), rng)
        for x, y in ((9, -9), (-7, -12), (14, -22), (-3, -27), (5, -40), (-14, -30), (36, 5),
                     (-30, 12))
    ]  # fmt: skip
    poles = ((5, -4), (-6, 5.5), (12, -14), (-10, -20), (20, -33), (2, -33))
    pedestrians = ((4, 4.5), (-5, -5), (8, -17), (-2, -15), (13, -30))
    cars = ((6.5, 0.5, 1.5), (-3, -8.5, 0.2), (15, -8, 0.3), (2, -21, 1.2), (-9, -37, 0.1))
    return World(
        {
            "ground": [Patch("ground", (-90, -90, 0), (180, 0, 0), (0, 180, 0))],
            "building": [
                *(part for args in houses for part in house(*args)),
                *box("steps", (-2, 6.4, 0), (5.0, 0.8, 0.3)),
                *box("bench", (1.5, -5.5, 0), (1.8, 0.45, 0.45)),
            ],
            "pole": [p for x, y in poles for p in capped("pole", (x, y, 0), 0.1, 7.0)],
            "vegetation": [
                *(part for parts in trees for part in parts),
                hedge("hedge", (10, -11, 0), (12, 0.9, 1.3), rng),
                hedge("hedge", (-12, -16, 0), (8, 0.9, 1.1), rng),
            ],
            "grass": [Grass("grass", (8, -40, 0.001), (20, 0, 0), (0, 26, 0), 0.07)],
            "vehicle": [p for x, y, turn in cars for p in car("car", (x, y, 0), turn)],
            "pedestrian": [
                p for x, y in pedestrians for p in capped("pedestrian", (x, y, 0), 0.22, 1.7)
            ],
        }
    )
