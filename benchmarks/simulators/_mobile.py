"""A street scanned from a vehicle that stands still for a while."""

import numpy as np

from sklearn_mcmd.datasets._street import (
    CROWN_RADIUS,
    CROWN_Z,
    KERB_Y,
    PATH_Z,
    UP,
    facing,
    pole,
    recess,
)
from sklearn_mcmd.datasets._surfaces import Cylinder, Patch

from ._beams import Beams, Sensor
from ._outliers import sense_with
from ._things import box, capped, car
from ._vegetation import Grass, leaves, tree
from ._wires import WiredWorld, wire

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
#: Standard deviation of near ranges, how many times it grows over the reach, and how many times
#: denser lines are where the vehicle stands.
_NOISE, _GROWTH, _RATIO = 0.005, 3.0, 10.0
#: Distance of lines over that of points on a line, at this range.
_ASPECT, _AT_RANGE = 5.0, 6.0
_PASSING = 0.25
#: Turns a second, and the share of a turn after which the beam looks into the vehicle.
_RATE, _BLIND = 100.0, 0.9


def make_mobile_scan(
    n_samples=100_000,
    *,
    outlier_share=0.02,
    outlier_kinds=("mixed_pixel", "range_error", "ghost"),
    far_share=0.002,
    random_state=None,
):
    """15 m of a street: road, kerb, footpath, a facade with windows, cars, posts, signs and wires;
    on the other side grass, a fence, bushes and trees.

    A beam turns 100 times a second in a plane 25 degrees off the street's cross-section, so points
    lie on lines. Over 0.8 m the vehicle all but stands still: there lines lie ten times
    as dense, in a stripe across everything. Lines are five times as far apart as points 6 m off: a
    raw scan of a street (Jakarto, 10,310 points) has lines 3.7 cm apart with points every 4 to
    8 mm. Noise of 5 mm grows three times over 60 m. Besides the arrays of `make_lidar_turn`, but
    for rings, there are ``stretch`` (1 where the vehicle stood), ``gps_time`` and ``trajectory``:
    times and positions.
    """

    def extra(scan, beams, beam):
        return {
            "stretch": np.where(scan.target == 1, beams.stretch[beam], -1),
            "gps_time": beams.time[beam],
            "trajectory": _trajectory(beams),
        }

    sensor = Sensor(
        noise_at=lambda ranges: _NOISE * (1 + (_GROWTH - 1) * ranges / _REACH),
        reach=_REACH,
        passing=_PASSING,
        make_beams=_beams,
        extra=extra,
    )
    return sense_with(
        _world, sensor, n_samples, outlier_share, outlier_kinds, far_share, random_state
    )


def _beams(n, rng):
    """Turns of one beam; where the vehicle stands, there are more a meter."""
    begin, end = _STOP
    knots = np.array([0.0, begin, end, _LENGTH])
    ways = np.cumsum([0.0, begin, _RATIO * (end - begin), _LENGTH - end])
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
    return (line + share) / _RATE, np.repeat(beams.origins[first], 2, axis=0)


def _world(rng):
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
    facade = _facade(low, along, rng)
    feet = (-1.0, -7.0), (5.0, -6.5), (10.5, -7.5), (17.0, -6.5), (2, -14), (9, -15), (15, -13)
    trees = [tree("tree", (x, y, 0), rng.uniform(5, 8), rng.uniform(3, 4.5), rng) for x, y in feet]
    bushes = [leaves("bush", (x, -11, 0.7), (1.0, 1.0, 0.7), 8, 0.4, rng) for x in (3.0, 7.5, 13.0)]
    return WiredWorld(
        {
            "road": road,
            "facade": facade,
            **_posts_signs_and_wires(),
            "vegetation": trees + bushes,
            "grass": [Grass("grass", (low, -25, -0.02), along, (0, 25 - KERB_Y, 0), 0.08)],
            "vehicle": [
                car("car_1", (3.0, 1.9, -0.03), 0.03),
                car("car_2", (12.5, 2.0, -0.03), np.pi + 0.02),
            ],
        }
    )


def _facade(low, along, rng):
    openings = [(x, x + 1.1, z, z + 1.5) for x in np.arange(3.1, 20, 2.4) for z in _FLOORS]
    facade = [
        Patch(
            "wall",
            (low, _WALL_Y, PATH_Z),
            along,
            (_WALL_TOP - PATH_Z) * UP,
            holes=[(x0 - low, x1 - low, z0 - PATH_Z, z1 - PATH_Z) for x0, x1, z0, z1 in openings],
        ),
        box("cornice", (low, _WALL_Y - 0.15, 3.35), (along[0], 0.15, 0.2)),
        box("balcony", (7.6, _WALL_Y - 0.9, 6.0), (3.2, 0.9, 0.15)),
        *(pole("downpipe", (x, _WALL_Y - 0.07), 0.05, _WALL_TOP) for x in (4.9, 14.5)),
        Patch("eaves", (low, _WALL_Y - 0.5, _WALL_TOP), (0, 0.5, 0), along),
        Patch("gutter", (low, _WALL_Y - 0.5, _WALL_TOP), along, (0, 0, 0.15)),
    ]
    for opening in openings:
        frame = recess("window", _WALL_Y, opening, 0.2, sill=True)
        if rng.random() < _CLEAR:  # beams go through the pane, into a room
            x, y, z = opening[0] - 1.5, _WALL_Y + rng.uniform(1.5, 5.0), opening[2] - 0.9
            frame[0] = Patch("room", (x, y, z), (4.0, 0, 0), (0, 0, 2.7))
        facade += frame
    return facade


def _posts_signs_and_wires():
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
    along_street = (-4.3, 6.7), (-3.7, 6.7), (-4.0, 7.0)
    wires = [
        *(wire("wire", (1.5, y, z), (14.0, y, z), 0.25, 0.03) for y, z in along_street),
        wire("wire", (1.5, -4, 6.9), (3.0, _WALL_Y, 6.0), 0.3, 0.03),
        wire("wire", (14, -4, 6.9), (12, _WALL_Y, 6), 0.3, 0.03),
        *(wire("fence_wire", (-4, -9, z), (18, -9, z), 0.02, 0.02) for z in (0.5, 0.8, 1.1)),
    ]
    return {"post": posts, "sign": signs, "wire": wires}
