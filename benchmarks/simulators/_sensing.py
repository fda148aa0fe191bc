"""From a world and a sensor's beams to a cloud with the truth of every point."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.datasets._labels import labeled_cloud, streams
from sklearn_mcmd.datasets._outliers import CLEARANCE
from sklearn_mcmd.datasets._surfaces import facing_normals

from ._beams import REGULAR, SNOW, Beams, Echoes, Sensor, cast, join_echoes
from ._sensor_outliers import SENSOR_OUTLIERS
from ._snow import flake_echoes

_PILOT = 1 << 14  # beams that measure how many echoes a beam has
_SURPLUS = 0.03  # share of echoes that are lost at random, as those of dark surfaces are
_NEIGHBORS = 8  # whose mean distance is the spacing at a point


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


def sense(make_world, sensor, n_samples, sizes, random_state, makers=SENSOR_OUTLIERS):
    """A cloud of n_samples points with the truth of each, as the makers of scenes document it.

    ``make_world(rng)`` is the `World`, ``sizes`` are the numbers of outliers by kind, and
    ``makers`` make them.
    """
    n_outliers = sum(sizes.values())
    world_rng, points_rng, noise_rng, outlier_rng, order_rng, snow_rng = streams(random_state, 6)
    world = make_world(world_rng)
    beams, first, echoes = _find_echoes(world, sensor, n_samples - n_outliers, points_rng, snow_rng)
    origins, directions = beams.origins[echoes.beam], beams.directions[echoes.beam]
    scale = sensor.noise_at(echoes.ranges)
    ranges = echoes.ranges + scale * sensor.deviate(beams, echoes.beam, noise_rng)
    points = sensor.record(origins, directions, ranges, beams.stretch[echoes.beam])
    normals = facing_normals(world.parts, echoes.place, echoes.part, origins)
    order = order_rng.permutation(n_samples)

    regular = echoes.take(echoes.kind == REGULAR)
    rows = [np.empty((0, 7))]
    if n_outliers and len(regular.beam):
        scan = _scan(world, sensor, beams, first, regular)
        rows += [makers[kind](scan, size, outlier_rng) for kind, size in sizes.items() if size]
    rows = np.concatenate(rows)
    outliers, sensor_origins, beam = rows[:, :3], rows[:, 3:6], rows[:, 6]
    outlier_range = np.linalg.norm(outliers - sensor_origins, axis=1)
    names = ["regular", *makers, *(["snow"] if sensor.snow else [])]
    numbers = [names.index(name) for name in ("regular", "mixed_pixel", "snow") if name in names]
    cloud = labeled_cloud(
        world.parts,
        np.array(numbers)[echoes.kind],
        sizes,
        names,
        order,
        both={
            "data": (points, outliers),
            "sensor_origins": (origins, sensor_origins),
            "noise_scale": (scale, sensor.noise_at(outlier_range)),
            "beam": (echoes.beam, beam),
        },
        regular={
            "true_points": (echoes.place, np.nan),
            "normals": (normals, np.nan),
            "surface": (echoes.part, -1),
            "classification": (world.class_of[echoes.part], -1),
            "echo": (echoes.order, 0),
        },
    )
    cloud.class_names = world.class_names
    cloud.update(sensor.extra(cloud, beams, cloud.pop("beam")))
    return cloud


def _scan(world, sensor, beams, first, regular):
    tree, n = cKDTree(regular.place), len(regular.place)
    if n == 1:
        spacing = np.ones(1)
    else:
        spacing = tree.query(regular.place, k=min(_NEIGHBORS + 1, n))[0][:, 1:].mean(axis=1)
    return Scan(
        world=world,
        sensor=sensor,
        beams=beams,
        first=first,
        points=regular.place,
        beam=regular.beam,
        spacing=spacing,
        tree=tree,
    )


def _find_echoes(world, sensor, n, rng, snow_rng):
    """Beams, first echo of each but for snow, and n echoes."""
    pilot = sensor.make_beams(_PILOT, np.random.default_rng(0))
    _, found = _first_and_all(world, sensor, pilot, *map(np.random.default_rng, (0, 0)))
    n_beams = (1 + _SURPLUS) * n * len(pilot.line) / max(len(found.beam), 1) + 16
    while True:
        beams = sensor.make_beams(n_beams, rng)
        first, found = _first_and_all(world, sensor, beams, rng, snow_rng)
        if len(found.beam) >= n:
            return beams, first, found.take(np.sort(rng.permutation(len(found.beam))[:n]))
        n_beams *= (1 + _SURPLUS) * max(1.0, n / max(len(found.beam), 1))


def _first_and_all(world, sensor, beams, rng, snow_rng):
    """First echo of each beam (range, part), and all echoes whose label is sure."""
    n = len(beams.line)
    echoes = cast(world, sensor, beams, rng)
    begin = echoes.order == 1
    first = np.full(n, np.inf), np.full(n, -1)
    for values, found in zip(first, (echoes.ranges, echoes.part), strict=True):
        values[echoes.beam[begin]] = found[begin]
    echoes = echoes.take(echoes.kind >= 0)
    if sensor.snow:
        echoes = _let_it_snow(world, sensor, beams, first[0], echoes, snow_rng)
    return first, echoes


def _let_it_snow(world, sensor, beams, target, echoes, rng):
    """Flakes in place of the echoes of some beams; those at surfaces are lost in their echoes."""
    beam, ranges = flake_echoes(target, sensor.snow, sensor.reach, sensor.divergence, rng)
    place = beams.origins[beam] + ranges[:, None] * beams.directions[beam]
    apart = world.distance(place) > CLEARANCE * sensor.noise_at(ranges)
    n = np.count_nonzero(apart)
    flakes = Echoes(
        beam=beam[apart],
        ranges=ranges[apart],
        part=np.zeros(n, int),
        order=np.ones(n, np.int8),
        place=place[apart],
        kind=np.full(n, SNOW, np.int8),
    )
    return join_echoes([echoes.take(~np.isin(echoes.beam, flakes.beam)), flakes])
