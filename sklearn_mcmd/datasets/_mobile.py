"""A street scanned from a vehicle that stands still for a while."""

from collections.abc import Sequence
from numbers import Real

import numpy as np
from sklearn.utils import Bunch

from sklearn_mcmd._sklearn import Interval, validate_params
from sklearn_mcmd.datasets._road import (
    CROWN_RADIUS,
    CROWN_Z,
    KERB_Y,
    PATH_Z,
    UP,
    Opening,
    facing,
    pole,
    recess,
)
from sklearn_mcmd.datasets._sensing import (
    SENSOR_PARAMETERS,
    WEATHER_PARAMETERS,
    Beams,
    Junk,
    Sensor,
    Trajectory,
    sense,
)
from sklearn_mcmd.datasets._surfaces import Cylinder, Patch
from sklearn_mcmd.datasets._things import World, box, capped, car, wire
from sklearn_mcmd.datasets._vegetation import Grass, leaves, tree

# Meters. The street lies in 0 <= x <= 15; the vehicle drives along y = -1.5.
_LENGTH, _LANE_Y, _HEIGHT = 15.0, -1.5, 2.2
_STOP = (8.0, 8.8)
_WALL_Y, _WALL_TOP = 7.0, 12.0
_FLOORS = (1.0, 4.2, 7.0, 9.7)  # feet of the windows
#: Share of windows through which beams go.
_CLEAR = 0.4
#: The plane in which the beam turns stands so far off the cross-section of the street.
_TILT = np.radians(25)
#: The beam leaves the vehicle only above this elevation.
_LOWEST = -np.radians(60)
_REACH = 60.0
#: Distance of lines over that of points on a line, at this range.
_ASPECT, _AT_RANGE = 5.0, 6.0
_PASSING = 0.25
#: Turns a second, and the share of a turn after which the beam looks into the vehicle.
_RATE, _BLIND = 100.0, 0.9


@validate_params(
    {
        **SENSOR_PARAMETERS,
        **WEATHER_PARAMETERS,
        "noise_growth": [Interval(Real, 1, None, closed="left")],
        "density_ratio": [Interval(Real, 1, None, closed="left")],
    },
    prefer_skip_nested_validation=True,
)
def make_mobile_scan(
    n_samples: int = 100_000,
    *,
    noise: float = 0.005,
    noise_growth: float = 3.0,
    density_ratio: float = 10.0,
    outlier_share: float = 0.02,
    outlier_kinds: Sequence[str] = ("mixed_pixel", "range_error", "ghost"),
    far_share: float = 0.002,
    beam_divergence: float = 0.0,
    snow: float = 0.0,
    random_state: int | np.random.RandomState | None = None,
) -> Bunch:
    """Make a scan of a street from a vehicle that stands still for a while.

    15 m of a street: road, kerb and footpath, a facade with windows, parked cars, posts, signs
    and wires; on the other side grass, a fence, bushes and trees. A beam turns in a plane 25
    degrees off the street's cross-section, so points lie on lines. Over 0.8 m the vehicle all but
    stands still: there lines lie ten times as dense, in a stripe across everything.

    Every point is where its beam ends: at what it meets first, or behind leaves, grass and
    wires, which a part of the beams goes past.

    Parameters
    ----------
    n_samples : int, default=100_000
        Number of points, outliers included. The scene has a fixed size, so more points are
        denser.
    noise : float, default=0.005
        Standard deviation of ranges at range 0, in meters.
    noise_growth : float, default=3.0
        Noise at a range of 60 m over that at range 0, at least 1; linear in between.
    density_ratio : float, default=10.0
        Lines a meter where the vehicle stands over those elsewhere, at least 1.
    outlier_share : float, default=0.02
        Share of outliers in [0, 1), rounded to a whole number of points.
    outlier_kinds : list or tuple of str, default=("mixed_pixel", "range_error", "ghost")
        Kinds of outliers, in (nearly) equal shares:

        - ``"mixed_pixel"``: between two surfaces that neighboring beams meet, at least 15 cm and
          5 median spacings apart, anywhere on the way;
        - ``"range_error"``: 5 to 20 local spacings before or behind what the beam meets;
        - ``"ghost"``: balls of 10 to 60 points, 1 to 3 median spacings in radius, anywhere in the
          bounding box (in a cloud of few points: up to 1 % of its diagonal);
        - ``"low"``: such balls 2 to 10 m behind what beams meet, as echoes by way of a second
          surface are;
        - ``"high"``: alone, 5 to 40 m before what beams meet, as birds and haze are;
        - ``"particle"``: alone, snow or dust near the sensor: half of them within 3.9 m;
        - ``"no_return"``: where the sensor is, as some write down beams without an echo.

    far_share : float, default=0.002
        Share of far gross outliers in [0, 1): in a box of three times the scene's extent, off
        all regular points by more than a tenth of their diagonal. Half of them are alone
        (``"far_single"``), half in balls of 10 to 60 points (``"far_clump"``).
    beam_divergence : float, default=0.0
        Full angle of each beam in radians, to 1/e^2 of the intensity on its axis, as data sheets
        state it: 0.0003 to 0.003 is usual. A beam has the mean range of what it meets within
        0.75 m, the resolution of pulses of 5 ns, weighted by energy; of several such groups, that
        of the strongest. Where it is farther than four standard deviations of the noise
        from every surface, the point is an outlier of kind ``"mixed_pixel"``, besides those of
        `outlier_share`.
    snow : float, default=0.0
        Snowfall in mm of water an hour. Flakes take the place of what beams meet, or of nothing,
        as :func:`make_lidar_turn` explains: outliers of kind ``"snow"``, besides those of
        `outlier_share`.
    random_state : int, RandomState instance or None, default=None
        Seed. The same seed gives the same cloud.

    Returns
    -------
    scan : :class:`~sklearn.utils.Bunch`
        In meters, z up, rows shuffled:

        - ``data``, float64 (n_samples, 3);
        - ``target``, int64 (n_samples,): +1 regular, -1 outlier;
        - ``true_points``, float64 (n_samples, 3): where beams end, without noise; of a wide beam,
          where it met the surface next to its axis; NaN for outliers;
        - ``normals``, float64 (n_samples, 3): true unit normals toward the sensor; NaN where there
          is no surface (leaves, grass, wires) and for outliers;
        - ``surface``, int64 (n_samples,): number of the flat, round or soft part in
          ``surface_names``, of which parts of one thing may share one; -1 for outliers;
        - ``classification``, int64 (n_samples,): number of the class in ``class_names``; -1 for
          outliers;
        - ``echo``, int8 (n_samples,): 1 for the first echo of a beam, 2 for what it meets behind,
          and so on; 0 for outliers;
        - ``stretch``, int64 (n_samples,): 1 where the vehicle stood, else 0; -1 for outliers;
        - ``sensor_origins``, float64 (n_samples, 3): where the sensor was;
        - ``gps_time``, float64 (n_samples,): when, in seconds; and ``trajectory``, times (m,) and
          positions (m, 3), of which :func:`sklearn_mcmd.io.sensor_origins` makes
          ``sensor_origins`` again;
        - ``noise_scale``, float64 (n_samples,): standard deviation of a range like that;
        - ``outlier_kind``, int8 (n_samples,): number of the kind in ``outlier_kind_names``; 0,
          "regular", for no outlier;
        - ``surface_names``, ``class_names``, ``outlier_kind_names``, ``feature_names``: lists of
          str.

    Raises
    ------
    ValueError
        If a kind of outlier is unknown or given twice, if no regular point is left, if the points
        are too few to show an edge for mixed pixels, or if the noise is so large that nothing
        is an outlier.

    See Also
    --------
    make_airborne_scan : Swaths that overlap, roofs and the edge of a forest.
    make_lidar_turn : Rings whose spacing grows a hundredfold.
    make_depth_frame : Depth in steps.
    make_street : A street of even density, with the distance to the nearest edge.

    Notes
    -----
    An outlier keeps four standard deviations of the noise from every surface, and out of leaves
    and grass; a far one, a tenth of the diagonal from all regular points. So the labels have no
    error. Flakes and mixed pixels of wide beams have noise besides. Beams whose label would be in
    doubt are lost.

    The beam turns 100 times a second, and the vehicle moves on while the beam looks into it.

    Leaves, and what is behind windows, differ between seeds; other surfaces do not. Lines are
    five times as far apart as points 6 m off: a raw scan of a street (Jakarto, 10,310 points) has
    lines 3.7 cm apart with points every 4 to 8 mm. Where the vehicle stands it is the other way
    around.

    Examples
    --------
    >>> from sklearn_mcmd.datasets import make_mobile_scan
    >>> scan = make_mobile_scan(5000, random_state=0)
    >>> scan.data.shape, int((scan.target == -1).sum())
    ((5000, 3), 110)
    >>> scan.class_names[:4]
    ['road', 'facade', 'post', 'sign']
    """
    return sense(
        _street,
        Sensor(
            make_beams=lambda n, rng: _beams(n, density_ratio, rng),
            noise_at=lambda ranges: noise * (1 + (noise_growth - 1) * ranges / _REACH),
            reach=_REACH,
            passing=_PASSING,
            divergence=beam_divergence,
            snow=snow,
            tell=lambda _, beams, beam: {
                "gps_time": beams.time[beam],
                "trajectory": _trajectory(beams),
            },
        ),
        n_samples,
        Junk(outlier_share, list(outlier_kinds), far_share),
        random_state,
    )


def _beams(n, density_ratio, rng):
    """Turns of one beam; where the vehicle stands, `density_ratio` times as many a meter."""
    begin, end = _STOP
    knots = np.array([0.0, begin, end, _LENGTH])
    ways = np.cumsum([0.0, begin, density_ratio * (end - begin), _LENGTH - end])
    span = np.pi - 2 * _LOWEST
    step = np.sqrt(ways[-1] * span / (n * _ASPECT * _AT_RANGE))
    way = np.arange(rng.random(), ways[-1] / (_ASPECT * _AT_RANGE * step)) * (
        _ASPECT * _AT_RANGE * step
    )
    x = np.interp(way, ways, knots)
    angles = np.arange(_LOWEST, np.pi - _LOWEST, step)
    angle = (angles + step * rng.random((len(x), 1))).ravel()
    line = np.repeat(np.arange(len(x)), len(angles))
    standing = (x >= begin) & (x < end)
    origins = np.column_stack([x[line], np.full(len(line), _LANE_Y), np.full(len(line), _HEIGHT)])
    flat = np.cos(angle)
    directions = np.column_stack([np.sin(_TILT) * flat, np.cos(_TILT) * flat, np.sin(angle)])
    share = np.minimum((angle - _LOWEST) / (2 * np.pi), _BLIND)
    time = (line + share) / _RATE
    return Beams(origins, directions, line, standing[line].astype(int), time)


def _trajectory(beams):
    """The vehicle moves on while the beam looks into it."""
    _, first = np.unique(beams.line, return_index=True)
    line = np.repeat(beams.line[first], 2)
    share = np.tile([0.0, _BLIND], len(first))
    return Trajectory((line + share) / _RATE, np.repeat(beams.origins[first], 2, axis=0))


def _street(rng):
    """Half of the street has houses, the other half grass and trees."""
    low, high = -6.0, _LENGTH + 6.0
    along = np.array([high - low, 0, 0])
    gutter = np.arcsin(KERB_Y / CROWN_RADIUS)
    gutter_z = CROWN_Z - CROWN_RADIUS * (1 - np.cos(gutter))
    axis = (low, 0, CROWN_Z - CROWN_RADIUS)
    road = [
        Cylinder("road", axis, along, CROWN_RADIUS, start=UP, arc=gutter),
        Cylinder("road", np.add(axis, along), -along, CROWN_RADIUS, start=UP, arc=gutter),
        Patch("kerb", (low, KERB_Y, gutter_z), along, (PATH_Z - gutter_z) * UP),
        Patch("footpath", (low, KERB_Y, PATH_Z), along, (0, _WALL_Y + 0.3 - KERB_Y, 0)),
    ]
    openings = [Opening(x, x + 1.1, z, z + 1.5) for x in np.arange(3.1, 20, 2.4) for z in _FLOORS]
    facade = [
        Patch(
            "wall",
            (low, _WALL_Y, PATH_Z),
            along,
            (_WALL_TOP - PATH_Z) * UP,
            holes=[(x0 - low, x1 - low, z0 - PATH_Z, z1 - PATH_Z) for x0, x1, z0, z1 in openings],
        ),
        box("cornice", (low, _WALL_Y - 0.15, 3.35), (high - low, 0.15, 0.2)),
        box("balcony", (7.6, _WALL_Y - 0.9, 6.0), (3.2, 0.9, 0.15)),
        *(pole("downpipe", (x, _WALL_Y - 0.07), 0.05, _WALL_TOP) for x in (4.9, 14.5)),
        Patch("eaves", (low, _WALL_Y - 0.5, _WALL_TOP), (0, 0.5, 0), along),
        Patch("gutter", (low, _WALL_Y - 0.5, _WALL_TOP), along, (0, 0, 0.15)),
    ]
    for opening in openings:
        frame = recess("window", _WALL_Y, opening, 0.2, sill=True)
        if rng.random() < _CLEAR:  # beams go through the pane, into a room
            x, y, z = opening.x0 - 1.5, _WALL_Y + rng.uniform(1.5, 5.0), opening.z0 - 0.9
            frame[0] = Patch("room", (x, y, z), (4.0, 0, 0), (0, 0, 2.7))
        facade += frame
    turn = np.radians(20)
    side, toward = facing(turn)
    post = np.array([4.0, 3.5])
    plate = np.array([*post, 2.0]) + 0.05 * toward - 0.3 * side
    light = np.array([11.0, 3.4])
    posts = [
        pole("lamp", (6.5, 3.6), 0.09, 6.5),
        Cylinder("lamp_arm", (6.5, 3.6, 6.4), (0, -1.5, 0.3), 0.05),
        pole("sign_post", post, 0.03, 2.7),
        pole("light_post", light, 0.06, 3.2),
        pole("wire_pole_1", (1.5, -4.0), 0.12, 7.0),
        pole("wire_pole_2", (14.0, -4.0), 0.12, 7.0),
        *(capped("fence_post", (x, -9, 0), 0.04, 1.2) for x in np.arange(-4, 20, 2.0)),
    ]
    corner = np.array([light[0] - 0.15, light[1] - 0.25, 2.3])
    signs = [
        Patch("sign", plate, 0.6 * side, (0, 0, 0.6)),
        Patch("light_front", corner, (0.3, 0, 0), (0, 0, 0.8)),
        Patch("light_left", corner, (0, 0, 0.8), (0, 0.2, 0)),
        Patch("light_right", corner + np.array([0.3, 0, 0]), (0, 0.2, 0), (0, 0, 0.8)),
    ]
    wires = [
        *(wire("wire", (1.5, y, z), (14.0, y, z), 0.25, 0.03)
          for y, z in ((-4.3, 6.7), (-3.7, 6.7), (-4.0, 7.0))),
        wire("wire", (1.5, -4, 6.9), (3.0, _WALL_Y, 6.0), 0.3, 0.03),
        wire("wire", (14, -4, 6.9), (12, _WALL_Y, 6), 0.3, 0.03),
        *(wire("fence_wire", (-4, -9, z), (18, -9, z), 0.02, 0.02) for z in (0.5, 0.8, 1.1)),
    ]  # fmt: skip
    trees = [
        tree("tree", (x, y, 0), rng.uniform(5, 8), rng.uniform(3, 4.5), rng)
        for x, y in ((-1.0, -7.0), (5.0, -6.5), (10.5, -7.5), (17.0, -6.5), (2, -14), (9, -15),
                     (15, -13))
    ]  # fmt: skip
    bushes = [leaves("bush", (x, -11, 0.7), (1.0, 1.0, 0.7), 8, 0.4, rng) for x in (3.0, 7.5, 13.0)]
    return World(
        {
            "road": road,
            "facade": facade,
            "post": posts,
            "sign": signs,
            "wire": wires,
            "vegetation": trees + bushes,
            "grass": [Grass("grass", (low, -25, -0.02), along, (0, 25 - KERB_Y, 0), 0.08)],
            "vehicle": [
                car("car_1", (3.0, 1.9, -0.03), 0.03),
                car("car_2", (12.5, 2.0, -0.03), np.pi + 0.02),
            ],
        }
    )
