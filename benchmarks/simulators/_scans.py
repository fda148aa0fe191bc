"""One yard as four sensors see it: a turn, a drive, flights and a depth frame.

A beam without width ends where it first meets the yard. An outlier is a flake on a beam, with a
range of its own before that, or a silent beam, written down as a point where the sensor is.
"""

import numpy as np
from sklearn.utils import Bunch

from sklearn_mcmd.datasets._surfaces import Cylinder, Foliage, Patch, first_hits

REACH, ALTITUDE = 100.0, 800.0  # of ranges, and of flights, in meters
NOISE, GROWTH = 0.01, 4.0  # deviation of ranges in meters, and how many times it is at the reach
FLAKES = np.log(3.9), 0.75  # log-normal ranges of flakes: half of them within 3.9 m
SILENT = 0.25  # share of the outliers
SURPLUS = 0.03  # share of the echoes that are lost at random, as those of dark surfaces are


def make_lidar_turn(n_samples, *, outlier_share=0.03, random_state=None):
    """A turn of a sensor at the origin, 1.5 m above ground: 32 rings at equal steps of elevation,
    with equal steps of azimuth. The outliers are a share of the beams.
    """
    height = np.array([0.0, 0.0, 1.5])

    def send(n_beams, rng):
        n_steps = round(n_beams / 32)
        azimuth = (np.arange(n_steps) + rng.random((32, 1))).ravel() * 2 * np.pi / n_steps
        elevation = np.repeat(np.radians(np.linspace(-30.67, 10.67, 32)), n_steps)
        flat = np.cos(elevation)
        directions = [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
        return np.tile(height, (len(flat), 1)), np.column_stack(directions), np.zeros(len(flat))

    scan = _scan(n_samples, send, REACH, outlier_share, random_state)
    for name in ("data", "true_points", "sensor_origins"):
        scan[name] -= height
    return scan


def make_mobile_scan(n_samples, *, outlier_share=0.02, random_state=None):
    """20 m of a drive at 10 m/s: a beam turns 100 times a second in a plane that stands 25 degrees
    off the cross-section. ``trajectory`` has the times and positions of begin and end.
    """
    trajectory = np.array([0.0, 2.0]), np.array([[-10.0, -1.5, 2.2], [10.0, -1.5, 2.2]])

    def send(n_beams, rng):
        time = (np.arange(n_beams) + rng.random()) / n_beams * 2.0
        angle = 2 * np.pi * 100 * time
        plane = np.radians(25)
        flat = np.cos(angle)
        directions = [np.sin(plane) * flat, np.cos(plane) * flat, np.sin(angle)]
        begin, end = trajectory[1]
        origins = begin + time[:, None] / 2.0 * (end - begin)
        return origins, np.column_stack(directions), time

    scan = _scan(n_samples, send, REACH, outlier_share, random_state)
    scan.trajectory = trajectory
    return scan


def make_airborne_scan(n_samples, *, random_state=None):
    """Two flights 800 m up look at the yard from both sides; the first sends four of five beams."""

    def send(n_beams, rng):
        swath = (np.arange(n_beams) % 5 == 4).astype(int)
        targets = rng.uniform([-40, -40, 0], [40, 40, 0], (len(swath), 3))
        origins = targets * [1, 0, 0] + [0, 0, ALTITUDE]
        origins[:, 1] = np.take([-190.0, 250.0], swath)
        directions = targets - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return origins, directions, np.zeros(len(swath))

    return _scan(n_samples, send, 2 * ALTITUDE, 0.0, random_state)


def make_depth_frame(n_samples, *, step=0.0029, random_state=None):
    """A frame of a depth camera that looks along y and 8 degrees down, one beam a pixel.

    The inverse of a depth, the distance along the camera's axis, is rounded to whole multiples of
    `step` (in 1/m), so that steps of depth grow with its square; its noise is .37 steps.
    """
    axis = np.array([0.0, np.cos(np.radians(8)), -np.sin(np.radians(8))])

    def send(n_beams, rng):
        n_rows = round(np.sqrt(0.75 * n_beams))
        v, u = np.mgrid[-0.4575 : 0.4575 : n_rows * 1j, -0.61 : 0.61 : n_rows / 0.75 * 1j]
        u, v = u.ravel()[:, None], v.ravel()[:, None]
        directions = axis + u * [1.0, 0, 0] + v * np.cross([1.0, 0, 0], axis)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return np.tile([-4.0, -1.0, 1.35], (len(u), 1)), directions, np.zeros(len(u))

    scan = _scan(n_samples, send, 10.0, 0.0, random_state)
    rng = np.random.default_rng(random_state)
    ray = scan.true_points - scan.sensor_origins
    levels = np.round(1 / (step * (ray @ axis)) + rng.normal(0, 0.37, len(ray)))
    depths = 1 / (step * np.maximum(levels, 1))
    scan.data = scan.sensor_origins + (depths / (ray @ axis))[:, None] * ray
    return scan


def _scan(n_samples, send, reach, outlier_share, random_state):
    """n_samples points of what ``send(n_beams, rng)`` sends: origins, unit directions and times.

    ``true_points`` are without noise, and NaN for outliers, whose ``target`` is -1.
    """
    n_beams = n_samples
    while True:  # more beams, all drawn anew, until enough of them end on something
        rng = np.random.default_rng(random_state)
        origins, directions, times = send(n_beams, rng)
        fraction, _ = first_hits(YARD, origins, origins + reach * directions, rng)
        ranges = reach * fraction
        is_outlier, is_silent = rng.random((2, len(ranges))) < [[outlier_share], [SILENT]]
        flakes = np.where(is_silent, 0.0, rng.lognormal(*FLAKES, len(ranges)))
        outlier = is_outlier & (flakes < ranges)
        seen = np.flatnonzero(outlier | np.isfinite(ranges))
        if len(seen) >= n_samples:
            break
        n_beams = int((1 + SURPLUS) * n_beams * n_samples / max(len(seen), 1)) + 1
    rows = rng.permutation(seen)[:n_samples]
    origins, directions, outlier = origins[rows], directions[rows], outlier[rows]
    ranges = np.where(outlier, flakes[rows], ranges[rows])
    deviation = NOISE * (1 + (GROWTH - 1) * ranges / reach)
    noise = np.where(outlier, 0.0, deviation * rng.standard_normal(n_samples))
    true_points = origins + ranges[:, None] * directions
    return Bunch(
        data=true_points + noise[:, None] * directions,
        true_points=np.where(outlier[:, None], np.nan, true_points),
        target=np.where(outlier, -1, 1),
        sensor_origins=origins,
        gps_time=times[rows],
    )


def _box(corner, size):
    """The four sides of a box along the axes, and its top."""
    corner = np.array(corner, float)
    x, y, z = np.diag(np.array(size, float))
    sides = (corner, x, z), (corner, z, y), (corner + x, y, z), (corner + x + y, -x, z)
    return [Patch("box", *side) for side in (*sides, (corner + z, x, y))]


def _upright(x, y, radius, height):
    return Cylinder("post", (x, y, 0), (0, 0, height), radius)


# Meters: of halls and cars a corner (x, y) and the size (x, y, z); of posts the place and radius.
HALLS = ((3, 8, 18, 8, 8), (14, -8, 6, 11, 5), (-24, 4, 14, 8, 7), (20, -40, 14, 12, 14))
HALLS += ((-40, -50, 30, 10, 12), (-6, 14, 6, 4, 4), (-30, 28, 40, 10, 9))
CARS = ((-7, -3, 4.2, 1.8, 1.4), (0, -11, 4.2, 1.8, 1.4), (-11, -16, 1.8, 4.2, 1.4))
CARS += ((5, 4, 1.8, 4.2, 1.4), (1.5, -6.5, 1.8, 0.5, 0.5))
POSTS = ((5, -5, 0.1), (-6, 4.5, 0.1), (12, -14, 0.1), (-10, -20, 0.1), (2.6, 2.2, 0.22))
POSTS += tuple((x, -8.0, 0.16) for x in range(-8, 8, 2))
SHRUBS = np.random.default_rng(0).uniform([-12, -18, 0], [9, 7, 0.5], (100, 3))
TREES = ((7, -13), (-9, -11), (10, -22), (-3, -25), (4, -38), (-13, -30), (-9, 8))
YARD = [
    Patch("ground", (-80, -80, 0), (160, 0, 0), (0, 160, 0)),
    *(part for x, y, *size in HALLS + CARS for part in _box((x, y, 0), size)),
    *(_upright(x, y, radius, 4.0) for x, y, radius in POSTS),
    *(_upright(x, y, 0.2, 2.5) for x, y in TREES),
    *(Foliage("shrub", place, 0.7) for place in SHRUBS if np.linalg.norm(place[:2]) > 3.5),
    *(Foliage("crown", (x, y, 3.9), 1.7) for x, y in TREES),
]
