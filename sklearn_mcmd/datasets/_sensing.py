"""From a world and a sensor's beams to a cloud with the truth of every point."""

from collections.abc import Callable
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from sklearn.utils import Bunch, check_random_state

from sklearn_mcmd._sklearn import Interval
from sklearn_mcmd.datasets._sensor_outliers import FAR, MAKERS
from sklearn_mcmd.datasets._surfaces import first_hits

__all__ = ["SENSOR_PARAMETERS", "Beams", "Junk", "Sensor", "sense"]

#: Constraints of the parameters that all sensors share.
SENSOR_PARAMETERS = {
    "n_samples": [Interval(Integral, 1, None, closed="left")],
    "noise": [Interval(Real, 0, None, closed="left")],
    "outlier_share": [Interval(Real, 0, 1, closed="left")],
    "outlier_kinds": [list, tuple],
    "far_share": [Interval(Real, 0, 1, closed="left")],
    "random_state": ["random_state"],
}

#: Beams that measure how many echoes a beam has, and echoes beyond what is needed, as a share:
#: as many at random are lost, as from dark surfaces.
_PILOT, _SURPLUS = 1 << 14, 0.03

#: A beam has at most so many echoes.
_MOST_ECHOES = 5

#: Neighbors whose mean distance is the spacing at a point.
_NEIGHBORS = 8


class Beams(NamedTuple):
    """Beams in the order in which a sensor sends them.

    ``origins`` and unit ``directions`` (n, 3); ``line`` (n,), the number of the scan line, ring
    or image row; ``stretch`` (n,), the number of the swath or stretch.
    """

    origins: np.ndarray
    directions: np.ndarray
    line: np.ndarray
    stretch: np.ndarray


def record_where_it_was(origins, directions, ranges, stretch):
    """The end of each beam."""
    return origins + ranges[:, None] * directions


def deviate_alone(beams, beam, rng):
    """Errors in standard deviations, independent of each other."""
    return rng.standard_normal(len(beam))


class Sensor(NamedTuple):
    """How a sensor measures.

    ``make_beams(n, rng)`` gives about n beams, ``noise_at(ranges)`` the standard deviation of
    ranges, ``deviate(beams, beam, rng)`` the errors of echoes of those beams in standard
    deviations, and ``record(origins, directions, ranges, stretch)`` the points that it writes
    down; ``reach`` is its longest range, and ``passing`` the chance that a beam goes on behind
    what lets it through.
    """

    make_beams: Callable
    noise_at: Callable
    reach: float
    passing: float = 0.0
    record: Callable = record_where_it_was
    deviate: Callable = deviate_alone


class Junk(NamedTuple):
    """Outliers that a scene shall hold."""

    share: float
    kinds: list
    far_share: float


class Echoes(NamedTuple):
    """Where beams end: number of the beam, range, number of the part, and 1 for a first echo."""

    beam: np.ndarray
    ranges: np.ndarray
    part: np.ndarray
    order: np.ndarray


class Scan(NamedTuple):
    """What makers of outliers know.

    World, sensor and beams; ``first``, of each beam the range (inf) and the part (-1) of its
    first echo; the regular points, the beam of each, the mean distance of each to its eight
    neighbors, and a tree of them.
    """

    world: object
    sensor: Sensor
    beams: Beams
    first: tuple
    points: np.ndarray
    beam: np.ndarray
    spacing: np.ndarray
    tree: cKDTree

    @property
    def diagonal(self):
        return np.linalg.norm(np.ptp(self.points, axis=0))


def sense(make_world, sensor, n_samples, junk, random_state):
    """A cloud of n_samples points with the truth of each, as the makers of scenes document it.

    Parameters
    ----------
    make_world : callable
        The world, from a generator.
    sensor : Sensor
    n_samples : int
    junk : Junk
    random_state : int, RandomState instance or None
    """
    sizes = _sizes(junk, n_samples)
    n_regular = n_samples - sum(sizes.values())
    seed = check_random_state(random_state).randint(np.iinfo(np.int32).max)
    # One stream a purpose: the true points stay the same whatever the noise and the outliers.
    streams = np.random.default_rng(seed).spawn(5)
    world_rng, points_rng, noise_rng, outlier_rng, order_rng = streams
    world = make_world(world_rng)
    beams, first, echoes = _find_echoes(world, sensor, n_regular, points_rng)
    origins, directions = beams.origins[echoes.beam], beams.directions[echoes.beam]
    true_points = origins + echoes.ranges[:, None] * directions
    scale = sensor.noise_at(echoes.ranges)
    ranges = echoes.ranges + scale * sensor.deviate(beams, echoes.beam, noise_rng)
    points = sensor.record(origins, directions, ranges, beams.stretch[echoes.beam])

    scan = _scan(world, sensor, beams, first, echoes.beam, true_points)
    rows = [(MAKERS | FAR)[kind](scan, size, outlier_rng) for kind, size in sizes.items() if size]
    outliers, viewpoints = np.split(np.concatenate([np.empty((0, 6)), *rows]), 2, axis=1)
    outlier_range = np.linalg.norm(outliers - viewpoints, axis=1)

    names = ["regular", *MAKERS, *FAR]
    codes = np.repeat([names.index(kind) for kind in sizes], list(sizes.values()))
    order = order_rng.permutation(n_samples)

    def join(regular, filling):
        filling = np.broadcast_to(filling, (n_samples - n_regular, *regular.shape[1:]))
        return np.concatenate([regular, filling]).astype(regular.dtype)[order]

    return Bunch(
        data=join(points, outliers),
        target=join(np.ones(n_regular, np.int64), -1),
        true_points=join(true_points, np.nan),
        normals=join(_normals(world, true_points, origins, echoes.part), np.nan),
        surface=join(echoes.part, -1),
        classification=join(world.class_of[echoes.part], -1),
        echo=join(echoes.order, 0),
        stretch=join(beams.stretch[echoes.beam], -1),
        viewpoints=join(origins, viewpoints),
        noise_scale=join(scale, sensor.noise_at(outlier_range)),
        outlier_kind=join(np.zeros(n_regular, np.int8), codes),
        surface_names=[part.name for part in world.parts],
        class_names=world.class_names,
        outlier_kind_names=names,
        feature_names=["x", "y", "z"],
    )


def _scan(world, sensor, beams, first, beam, points):
    tree = cKDTree(points)
    if len(points) == 1:
        spacing = np.ones(1)
    else:
        near = tree.query(points, k=min(_NEIGHBORS + 1, len(points)))[0]
        spacing = near[:, 1:].mean(axis=1)
    return Scan(world, sensor, beams, first, points, beam, spacing, tree)


def _sizes(junk, n_samples):
    """How many outliers of each kind."""
    unknown = [kind for kind in junk.kinds if kind not in MAKERS]
    if unknown or len(set(junk.kinds)) < len(junk.kinds) or not junk.kinds:
        raise ValueError(
            f"outlier_kinds={junk.kinds!r} must name, once each, one or more of {list(MAKERS)}; "
            "for a cloud without these outliers set outlier_share=0."
        )
    n_near, n_far = round(junk.share * n_samples), round(junk.far_share * n_samples)
    if n_near + n_far >= n_samples:
        raise ValueError(
            f"outlier_share={junk.share:g} and far_share={junk.far_share:g} of "
            f"n_samples={n_samples} leave no regular point: lower the shares or give more points."
        )
    return _equal_parts(n_near, junk.kinds) | _equal_parts(n_far, list(FAR))


def _equal_parts(n, names):
    return {name: n // len(names) + (i < n % len(names)) for i, name in enumerate(names)}


def _find_echoes(world, sensor, n, rng):
    """Beams, first echo of each, and n echoes."""
    pilot = sensor.make_beams(_PILOT, np.random.default_rng(0))
    _, found = _cast(world, sensor, pilot, np.random.default_rng(0))
    n_beams = (1 + _SURPLUS) * n * len(pilot.line) / max(len(found.beam), 1) + 16
    while True:
        beams = sensor.make_beams(n_beams, rng)
        first, found = _cast(world, sensor, beams, rng)
        if len(found.beam) >= n:
            chosen = np.sort(rng.permutation(len(found.beam))[:n])
            return beams, first, Echoes(*(values[chosen] for values in found))
        n_beams *= (1 + _SURPLUS) * max(1.0, n / max(len(found.beam), 1))


def _cast(world, sensor, beams, rng):
    """First echo of each beam (range, part), and all echoes."""
    n = len(beams.line)
    beam, start = np.arange(n), np.zeros(n)
    echoes, first = [], None
    for order in range(1, _MOST_ECHOES + 1):
        origin, direction = beams.origins[beam], beams.directions[beam]
        origin = origin + start[:, None] * direction
        left = sensor.reach - start
        ends = origin + left[:, None] * direction
        fraction, part = first_hits(world.parts, origin, ends, rng)
        ranges = start + fraction * left
        if first is None:
            first = ranges, part
        met = part >= 0
        beam, ranges, part = beam[met], ranges[met], part[met]
        echoes.append(Echoes(beam, ranges, part, np.full(len(part), order, np.int8)))
        on = world.through[part] & (rng.random(len(part)) < sensor.passing)
        beam, start = beam[on], ranges[on] + 1e-3
        if len(beam) == 0:
            break
    return first, Echoes(*map(np.concatenate, zip(*echoes, strict=True)))


def _normals(world, points, viewpoints, part):
    """True normals toward the sensor, NaN where there is no surface."""
    normals = np.empty_like(points)
    for number in np.unique(part):
        mine = np.flatnonzero(part == number)
        normals[mine] = world.parts[number].normals(points[mine])
    away = np.einsum("ij,ij->i", normals, viewpoints - points) < 0
    normals[away] *= -1.0
    return normals
