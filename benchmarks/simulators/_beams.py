"""Where the beams of any sensor end: pulses, several echoes a beam, sensors that move.

A pulsed sensor has one range for echoes that follow each other within its resolution, half the
length of the pulse; echoes farther apart it tells from each other, and of these it writes down the
strongest here. (Echoes merge within c tau / 2: M. Hebert and E. Krotkov, "3D measurements from
imaging laser radars: how good are they?", Image and Vision Computing 10, 1992.)
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.datasets._beams import (
    Rays,
    blocks,
    echoes_of_cones,
    echoes_of_thin_beams,
    meet,
    send,
)

SNOW = 2  # a kind of echoes, besides those of the package
PULSED = 0.75  # resolution of pulses of 5 ns, in meters
_MOST_ECHOES = 5  # a beam has at most so many


class Beams(NamedTuple):
    """Beams in the order in which a sensor sends them.

    ``origins`` and ``directions`` (n, 3); ``line`` (n,), the number of the scan line, ring or image
    row; ``stretch`` (n,), the number of the swath or stretch; ``time`` (n,) in seconds, of sensors
    that move.
    """

    origins: np.ndarray
    directions: np.ndarray
    line: np.ndarray | None = None
    stretch: np.ndarray | None = None
    time: np.ndarray | None = None


class Sensor(NamedTuple):
    """How a sensor measures.

    ``noise_at(ranges)`` gives the standard deviation of ranges; ``reach`` is the longest range, in
    lengths of the beams' directions, and ``passing`` the chance that a beam goes on behind what
    lets it through. ``divergence`` of beams is in radians, ``resolution`` in meters, ``snow`` in mm
    of water an hour. For `sense`, ``make_beams(n, rng)`` gives about n beams,
    ``deviate(beams, beam, rng)`` the errors of echoes of those beams in standard deviations,
    ``record(origins, directions, ranges, stretch)`` the points that it writes down, and
    ``extra(scan, beams, beam)`` further arrays of the cloud by name, from the beam of each point
    (of outliers that lie on no beam: one from where they are seen).
    """

    noise_at: Callable
    reach: float
    passing: float = 0.0
    divergence: float = 0.0
    resolution: float = PULSED
    snow: float = 0.0
    make_beams: Callable | None = None
    deviate: Callable = lambda beams, beam, rng: rng.standard_normal(len(beam))
    record: Callable = lambda origins, directions, ranges, stretch: (
        origins + ranges[:, None] * directions
    )
    extra: Callable = lambda scan, beams, beam: {}


class Echoes(NamedTuple):
    """Where beams end: the beam, range, part, the true point, the kind, and 1 for a first echo."""

    beam: np.ndarray
    ranges: np.ndarray
    part: np.ndarray
    place: np.ndarray
    kind: np.ndarray
    order: np.ndarray

    def take(self, rows):
        return Echoes(*(values[rows] for values in self))


def join_echoes(echoes):
    return Echoes(*map(np.concatenate, zip(*echoes, strict=True)))


def cast(world, sensor, beams, rng):
    """All echoes of beams, block by block and in each by their order; also those in doubt."""
    echoes = []
    for numbers in blocks(len(beams.origins), sensor.divergence):
        echoes += _cast_block(world, sensor, beams, numbers, rng)
    return join_echoes(echoes)


def _cast_block(world, sensor, beams, numbers, rng):
    """All echoes of the beams of these numbers: those of each order."""
    rays, bundle = send(beams, numbers, sensor.reach, sensor.divergence)
    echoes = []
    for order in range(1, _MOST_ECHOES + 1):
        rays = meet(world.parts, rays, sensor.reach, rng, *bundle)
        if sensor.divergence == 0:
            found, of_ray = echoes_of_thin_beams(rays), np.arange(len(rays.beam))
        else:
            beam, ranges, of_ray = merge(rays, sensor.resolution)
            found = echoes_of_cones(world, beams, rays, sensor.noise_at, beam, ranges, of_ray)
        echoes.append(Echoes(*found, order=np.full(len(found.part), order, np.int8)))
        if not world.through.any():
            break
        on = world.through[found.part] & (rng.random(len(found.part)) < sensor.passing)
        on = (of_ray >= 0) & on[of_ray] & world.through[rays.part]
        rays, bundle = Rays(*(values[on] for values in rays)), ()
        if len(rays.beam) == 0:
            break
    return echoes


def merge(rays, resolution):
    """One echo for each beam: the strongest of those that the resolution tells apart.

    Returns the m beams that have an echo, its range (m,), and for each ray the number of the echo
    that it is in, or -1.
    """
    order = np.lexsort([rays.ranges, rays.beam])
    beam, ranges = rays.beam[order], rays.ranges[order]
    apart = (np.diff(beam) > 0) | (np.diff(ranges) > resolution)
    group = np.concatenate([[0], np.cumsum(apart)])[: len(beam)]
    starts = np.flatnonzero(np.concatenate([[True], apart]))[: len(beam)]
    weight = 1 / ranges**2
    energy = np.bincount(group, weight)
    mean = np.bincount(group, weight * ranges) / energy
    # Of equally strong echoes the first.
    strongest = np.lexsort([np.arange(len(starts)), -energy, beam[starts]])
    leads = np.concatenate([[True], np.diff(beam[starts][strongest]) > 0])[: len(starts)]
    chosen = strongest[leads]
    number = np.full(len(starts), -1)
    number[chosen] = np.arange(len(chosen))
    echo = np.empty(len(order), int)
    echo[order] = number[group]
    return beam[starts][chosen], mean[chosen], echo
