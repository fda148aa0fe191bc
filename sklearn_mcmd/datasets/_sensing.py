"""From a world and a sensor's beams to a cloud with the truth of every point."""

from collections.abc import Callable
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from sklearn.utils import Bunch, check_random_state

from sklearn_mcmd._sklearn import Interval
from sklearn_mcmd.datasets._echoes import (
    PULSED,
    REGULAR,
    SNOW,
    Rays,
    blocks,
    cone,
    merge,
    own_codes,
    rows_of,
    truths,
)
from sklearn_mcmd.datasets._outliers import CLEARANCE, check_kinds
from sklearn_mcmd.datasets._sensor_outliers import FAR, MAKERS
from sklearn_mcmd.datasets._snow import flake_echoes
from sklearn_mcmd.datasets._surfaces import first_hits

__all__ = [
    "SENSOR_PARAMETERS",
    "WEATHER_PARAMETERS",
    "Beams",
    "Junk",
    "Sensor",
    "Trajectory",
    "sense",
]

#: Constraints of the parameters that all sensors share.
SENSOR_PARAMETERS = {
    "n_samples": [Interval(Integral, 1, None, closed="left")],
    "noise": [Interval(Real, 0, None, closed="left")],
    "outlier_share": [Interval(Real, 0, 1, closed="left")],
    "outlier_kinds": [list, tuple],
    "far_share": [Interval(Real, 0, 1, closed="left")],
    "random_state": ["random_state"],
}

#: Those of sensors whose beams are as wide as said, and who may stand in snow.
WEATHER_PARAMETERS = {
    "beam_divergence": [Interval(Real, 0, None, closed="left")],
    "snow": [Interval(Real, 0, None, closed="left")],
}

#: Beams that measure how many echoes a beam has, and echoes beyond what is needed, as a share:
#: as many at random are lost, as from dark surfaces.
_PILOT, _SURPLUS = 1 << 14, 0.03

#: A beam has at most so many echoes.
_MOST_ECHOES = 5

#: Neighbors whose mean distance is the spacing at a point.
_NEIGHBORS = 8


class Trajectory(NamedTuple):
    """Positions (m, 3) of a sensor at times (m,), between which it moves evenly."""

    times: np.ndarray
    positions: np.ndarray


class Beams(NamedTuple):
    """Beams in the order in which a sensor sends them.

    ``origins`` and unit ``directions`` (n, 3); ``line`` (n,), the number of the scan line, ring
    or image row; ``stretch`` (n,), the number of the swath or stretch; ``time`` (n,) in seconds,
    of sensors that move.
    """

    origins: np.ndarray
    directions: np.ndarray
    line: np.ndarray
    stretch: np.ndarray
    time: np.ndarray | None = None


def record_where_it_was(origins, directions, ranges, stretch):
    """The end of each beam."""
    return origins + ranges[:, None] * directions


def tell_nothing(scan, beams, beam):
    """No further arrays."""
    return {}


def deviate_alone(beams, beam, rng):
    """Errors in standard deviations, independent of each other."""
    return rng.standard_normal(len(beam))


class Sensor(NamedTuple):
    """How a sensor measures.

    ``make_beams(n, rng)`` gives about n beams, ``noise_at(ranges)`` the standard deviation of
    ranges, ``deviate(beams, beam, rng)`` the errors of echoes of those beams in standard
    deviations, and ``record(origins, directions, ranges, stretch)`` the points that it writes
    down; ``reach`` is its longest range, and ``passing`` the chance that a beam goes on behind
    what lets it through. ``divergence`` of beams is in radians, ``snow`` in mm of water an hour.
    ``tell(scan, beams, beam)`` gives further arrays of the cloud by name, from the beam of each
    point (of outliers that lie on no beam: one from where they are seen).
    """

    make_beams: Callable
    noise_at: Callable
    reach: float
    passing: float = 0.0
    record: Callable = record_where_it_was
    deviate: Callable = deviate_alone
    divergence: float = 0.0
    snow: float = 0.0
    tell: Callable = tell_nothing


class Junk(NamedTuple):
    """Outliers that a scene shall hold."""

    share: float
    kinds: list
    far_share: float


class Echoes(NamedTuple):
    """Where beams end.

    Number of the beam, range, number of the part, 1 for a first echo, the true point, and the kind
    of the echo.
    """

    beam: np.ndarray
    ranges: np.ndarray
    part: np.ndarray
    order: np.ndarray
    place: np.ndarray
    kind: np.ndarray


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

    ``make_world(rng)`` is the `World`.
    """
    sizes = _sizes(junk, n_samples)
    n_echoes = n_samples - sum(sizes.values())
    seed = check_random_state(random_state).randint(np.iinfo(np.int32).max)
    # One stream a purpose: the true points stay the same whatever the noise and the outliers.
    streams = np.random.default_rng(seed).spawn(6)
    world_rng, points_rng, noise_rng, outlier_rng, order_rng, snow_rng = streams
    world = make_world(world_rng)
    beams, first, echoes = _find_echoes(world, sensor, n_echoes, points_rng, snow_rng)
    origins, directions = beams.origins[echoes.beam], beams.directions[echoes.beam]
    scale = sensor.noise_at(echoes.ranges)
    ranges = echoes.ranges + scale * sensor.deviate(beams, echoes.beam, noise_rng)
    points = sensor.record(origins, directions, ranges, beams.stretch[echoes.beam])

    n_outliers = n_samples - n_echoes
    join, truth = rows_of(echoes.kind, n_outliers, order_rng.permutation(n_samples))
    regular = echoes.kind == REGULAR
    scan = _scan(world, sensor, beams, first, echoes.beam[regular], echoes.place[regular])
    rows = [(MAKERS | FAR)[kind](scan, size, outlier_rng) for kind, size in sizes.items() if size]
    rows = np.concatenate([np.empty((0, 7)), *rows])
    outliers, sensor_origins, beam = rows[:, :3], rows[:, 3:6], rows[:, 6]
    outlier_range = np.linalg.norm(outliers - sensor_origins, axis=1)

    names = ["regular", *MAKERS, *FAR, *(["snow"] if sensor.snow else [])]
    codes = np.repeat([names.index(kind) for kind in sizes], list(sizes.values()))
    cloud = Bunch(
        data=join(points, outliers),
        target=truth(np.ones(n_echoes, np.int64), -1),
        true_points=truth(echoes.place, np.nan),
        normals=truth(_normals(world, echoes.place, origins, echoes.part), np.nan),
        surface=truth(echoes.part, -1),
        classification=truth(world.class_of[echoes.part], -1),
        echo=truth(echoes.order, 0),
        stretch=truth(beams.stretch[echoes.beam], -1),
        sensor_origins=join(origins, sensor_origins),
        noise_scale=join(scale, sensor.noise_at(outlier_range)),
        outlier_kind=join(own_codes(echoes.kind, names), codes),
        surface_names=[part.name for part in world.parts],
        class_names=world.class_names,
        outlier_kind_names=names,
        feature_names=["x", "y", "z"],
    )
    cloud.update(sensor.tell(cloud, beams, join(echoes.beam, beam)))
    return cloud


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
    check_kinds(junk.kinds, MAKERS, "these outliers")
    n_near, n_far = round(junk.share * n_samples), round(junk.far_share * n_samples)
    if n_near + n_far >= n_samples:
        raise ValueError(
            f"outlier_share={junk.share:g} and far_share={junk.far_share:g} of "
            f"n_samples={n_samples} leave no regular point: lower the shares or give more points."
        )
    return _equal_parts(n_near, junk.kinds) | _equal_parts(n_far, list(FAR))


def _equal_parts(n, names):
    return {name: n // len(names) + (i < n % len(names)) for i, name in enumerate(names)}


def _find_echoes(world, sensor, n, rng, snow_rng):
    """Beams, first echo of each but for snow, and n echoes."""
    pilot = sensor.make_beams(_PILOT, np.random.default_rng(0))
    _, found = _cast(world, sensor, pilot, *(np.random.default_rng(0) for _ in range(2)))
    n_beams = (1 + _SURPLUS) * n * len(pilot.line) / max(len(found.beam), 1) + 16
    while True:
        beams = sensor.make_beams(n_beams, rng)
        first, found = _cast(world, sensor, beams, rng, snow_rng)
        if len(found.beam) >= n:
            chosen = np.sort(rng.permutation(len(found.beam))[:n])
            return beams, first, Echoes(*(values[chosen] for values in found))
        n_beams *= (1 + _SURPLUS) * max(1.0, n / max(len(found.beam), 1))


def _cast(world, sensor, beams, rng, snow_rng):
    """First echo of each beam (range, part), and all echoes."""
    n = len(beams.line)
    first, echoes = (np.full(n, np.inf), np.full(n, -1)), []
    for rows in blocks(n, sensor.divergence):
        echoes += _cast_block(world, sensor, beams, np.arange(n)[rows], rng)
    echoes = Echoes(*map(np.concatenate, zip(*echoes, strict=True)))
    begin = echoes.order == 1
    for values, found in zip(first, (echoes.ranges, echoes.part), strict=True):
        values[echoes.beam[begin]] = found[begin]
    known = echoes.kind >= 0
    if not known.all():
        echoes = Echoes(*(values[known] for values in echoes))
    return first, _let_it_snow(world, sensor, beams, first[0], echoes, snow_rng)


def _cast_block(world, sensor, beams, numbers, rng):
    """All echoes of the beams of these numbers: those of each order."""
    ways = cone(beams.directions[numbers], sensor.divergence)
    n_rays = ways.shape[1]
    rays = Rays(
        np.repeat(numbers, n_rays),
        np.repeat(beams.origins[numbers], n_rays, axis=0),
        ways.reshape(-1, 3),
        np.zeros(ways[..., 0].size),
        None,
    )
    apart = sensor.reach * np.linalg.norm(ways - ways[:, :1], axis=2).max(initial=0.0)
    echoes = []
    for order in range(1, _MOST_ECHOES + 1):
        whole = order == 1
        rays = _meet(world, sensor, rays, rng, *((n_rays, apart) if whole else ()))
        found, of_ray = _echoes(world, sensor, beams, rays, order)
        on = world.through[found.part] & (rng.random(len(found.part)) < sensor.passing)
        on = (of_ray >= 0) & on[of_ray] & world.through[rays.part]
        rays = Rays(*(values[on] for values in rays))
        echoes.append(found)
        if len(rays.beam) == 0:
            break
    return echoes


def _meet(world, sensor, rays, rng, bundle=1, apart=0.0):
    """What rays meet behind their ranges; only those that meet something."""
    start = np.where(rays.ranges > 0, rays.ranges + 1e-3, 0.0)
    origin = rays.origins + start[:, None] * rays.directions
    left = sensor.reach - start
    ends = origin + left[:, None] * rays.directions
    fraction, part = first_hits(world.parts, origin, ends, rng, bundle, apart)
    met = part >= 0
    ranges = start[met] + fraction[met] * left[met]
    return Rays(rays.beam[met], rays.origins[met], rays.directions[met], ranges, part[met])


def _echoes(world, sensor, beams, rays, order):
    """Echoes of beams, and which one each ray is in, or -1; kind -1 where the label is in doubt."""
    if sensor.divergence == 0:
        beam, ranges, part, of_ray = rays.beam, rays.ranges, rays.part, np.arange(len(rays.beam))
        place = rays.origins + ranges[:, None] * rays.directions
        kind = np.full(len(beam), REGULAR, np.int8)
    else:
        beam, ranges, of_ray = merge(rays, PULSED)
        points = beams.origins[beam] + ranges[:, None] * beams.directions[beam]
        scale = sensor.noise_at(ranges)
        part, place, kind, known = truths(world.parts, world.distance, rays, of_ray, points, scale)
        kind[~known] = -1
    return Echoes(beam, ranges, part, np.full(len(beam), order, np.int8), place, kind), of_ray


def _let_it_snow(world, sensor, beams, target, echoes, rng):
    """Flakes in place of the echoes of some beams; those at surfaces are lost in their echoes."""
    if sensor.snow == 0:
        return echoes
    beam, ranges = flake_echoes(target, sensor.snow, sensor.reach, sensor.divergence, rng)
    place = beams.origins[beam] + ranges[:, None] * beams.directions[beam]
    apart = world.distance(place) > CLEARANCE * sensor.noise_at(ranges)
    beam, ranges, place = beam[apart], ranges[apart], place[apart]
    n = len(beam)
    flakes = Echoes(
        beam, ranges, np.zeros(n, int), np.ones(n, np.int8), place, np.full(n, SNOW, np.int8)
    )
    left = ~np.isin(echoes.beam, beam)
    return Echoes(*(np.concatenate([a[left], b]) for a, b in zip(echoes, flakes, strict=True)))


def _normals(world, points, sensor_origins, part):
    """True normals toward the sensor, NaN where there is no surface."""
    normals = np.empty_like(points)
    for number in np.unique(part):
        mine = np.flatnonzero(part == number)
        normals[mine] = world.parts[number].normals(points[mine])
    away = np.einsum("ij,ij->i", normals, sensor_origins - points) < 0
    normals[away] *= -1.0
    return normals
