"""Where the beams of any sensor end: cones, pulses, several echoes a beam, sensors that move.

A beam may be a cone, cast as sub-rays that carry equal energy each. Its intensity is Gaussian
across, and its divergence is the full angle at which it falls to 1/e^2 of that on the axis, as data
sheets state it. Energy falls with the square of the range. Surfaces reflect alike, whatever their
tilt. A pulsed sensor has one range for echoes that follow each other within its resolution, half
the length of the pulse: their mean, weighted by energy. Echoes farther apart it tells from each
other, and of these it writes down the strongest here. (Echoes merge within c tau / 2: M. Hebert and
E. Krotkov, "3D measurements from imaging laser radars: how good are they?", Image and Vision
Computing 10, 1992.)
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.datasets._outliers import CLEARANCE
from sklearn_mcmd.datasets._surfaces import Soft, first_hits

REGULAR, MIXED, SNOW = 0, 1, 2  # kinds of echoes
IN_DOUBT = -1  # the kind of an echo whose label is not sure
PULSED = 0.75  # resolution of pulses of 5 ns, in meters
_MOST_ECHOES = 5  # a beam has at most so many
_RAYS = 19  # sub-rays of a beam; the first is its axis
_BLOCK = 1 << 13  # beams that are cast at once, so that their sub-rays need little memory


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


class Rays(NamedTuple):
    """Sub-rays: their beams in ascending order, how far they came, and the part that they met."""

    beam: np.ndarray
    origins: np.ndarray
    directions: np.ndarray
    ranges: np.ndarray
    part: np.ndarray | None = None

    @property
    def places(self):
        return self.origins + self.ranges[:, None] * self.directions


class Echoes(NamedTuple):
    """Where beams end: the beam, range, part, the true point, the kind, and 1 for a first echo."""

    beam: np.ndarray
    ranges: np.ndarray
    part: np.ndarray
    place: np.ndarray
    kind: np.ndarray
    order: np.ndarray

    def take(self, rows):
        return Echoes._make(values[rows] for values in self)


def join_echoes(echoes):
    return Echoes._make(map(np.concatenate, zip(*echoes, strict=True)))


def cast(world, sensor, beams, rng):
    """All echoes of beams, block by block and in each by their order; also those in doubt."""
    echoes = []
    for numbers in blocks(len(beams.origins), sensor.divergence):
        echoes += _cast_block(world, sensor, beams, numbers, rng)
    return join_echoes(echoes)


def blocks(n, divergence):
    """Numbers of n beams, as many as are cast at once; those without width all at once."""
    step = _BLOCK if divergence else max(n, 1)
    return [np.arange(start, min(start + step, n)) for start in range(0, max(n, 1), step)]


def _cast_block(world, sensor, beams, numbers, rng):
    """All echoes of the beams of these numbers: those of each order."""
    rays, bundle, apart = _send(beams, numbers, sensor.reach, sensor.divergence)
    echoes = []
    for order in range(1, _MOST_ECHOES + 1):
        rays = _meet(world.parts, rays, sensor.reach, rng, bundle, apart)
        if sensor.divergence == 0:
            beam, ranges, of_ray = rays.beam, rays.ranges, np.arange(len(rays.beam))
            part, place, kind = rays.part, rays.places, np.full(len(beam), REGULAR, np.int8)
        else:
            beam, ranges, of_ray = merge(rays, sensor.resolution)
            points = beams.origins[beam] + ranges[:, None] * beams.directions[beam]
            part, place, kind = _truths(world, rays, of_ray, points, sensor.noise_at(ranges))
        echoes.append(
            Echoes(beam, ranges, part, place, kind, order=np.full(len(part), order, np.int8))
        )
        if not world.through.any():
            break
        on = world.through[part] & (rng.random(len(part)) < sensor.passing)
        on = (of_ray >= 0) & on[of_ray] & world.through[rays.part]
        rays, bundle, apart = Rays._make(values[on] for values in rays), 1, 0.0
        if len(rays.beam) == 0:
            break
    return echoes


def _send(beams, numbers, reach, divergence):
    """Sub-rays of the beams of these numbers, how many each has, and how far apart they get."""
    ways = _cone(beams.directions[numbers], divergence)
    n_rays = ways.shape[1]
    rays = Rays(
        beam=np.repeat(numbers, n_rays),
        origins=np.repeat(beams.origins[numbers], n_rays, axis=0),
        directions=ways.reshape(-1, 3),
        ranges=np.zeros(ways[..., 0].size),
    )
    return rays, n_rays, reach * np.linalg.norm(ways - ways[:, :1], axis=2).max(initial=0.0)


def _meet(parts, rays, reach, rng, bundle, apart):
    """What rays meet behind their ranges; only those that meet something."""
    start = np.where(rays.ranges > 0, rays.ranges + 1e-3, 0.0)
    origin = rays.origins + start[:, None] * rays.directions
    left = reach - start
    ends = origin + left[:, None] * rays.directions
    fraction, part = first_hits(parts, origin, ends, rng, bundle, apart)
    met = part >= 0
    return Rays(
        beam=rays.beam[met],
        origins=rays.origins[met],
        directions=rays.directions[met],
        ranges=start[met] + fraction[met] * left[met],
        part=part[met],
    )


def _cone(directions, divergence):
    """Directions of sub-rays (n, m, 3) of beams (n, 3), the axis first; m = 1 without divergence.

    They lie on a sunflower's spiral: the k-th is where a share (k + 1/2) / m of the energy is
    nearer to the axis.
    """
    if divergence == 0:
        return directions[:, None]
    k = np.arange(_RAYS)
    radius = divergence / 2 * np.sqrt(-np.log1p(-(k + 0.5) / _RAYS) / 2)
    radius[0] = 0.0
    turn = k * np.pi * (3 - np.sqrt(5))
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(directions, first)
    rays = (
        directions[:, None]
        + (radius * np.cos(turn))[:, None] * first[:, None]
        + (radius * np.sin(turn))[:, None] * second[:, None]
    )
    rays[:, 1:] /= np.linalg.norm(rays[:, 1:], axis=2, keepdims=True)
    return rays


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


def _truths(world, rays, echo, points, scale):
    """What m echoes are truly of, from their points without noise and the ranges' deviations there.

    `echo` is the number of the echo that each ray is in, or -1. Returns, of each echo,

    - the nearest of the parts that its sub-rays met;
    - where that part was met, next to the axis; in leaves and grass the echo itself;
    - its kind: `MIXED` where it is farther than the clearance of all outliers from every surface,
      `IN_DOUBT` where it is at a surface that its beam did not meet, or next to leaves.
    """
    member = np.flatnonzero(echo >= 0)
    of, met = echo[member], rays.part[member]
    soft = np.array([isinstance(part, Soft) for part in world.parts])
    lowest, highest = np.full(len(points), len(world.parts)), np.full(len(points), -1)
    np.minimum.at(lowest, of, met)
    np.maximum.at(highest, of, met)
    part = highest.copy()
    unsure = (lowest < highest) | soft[highest]
    nearest = np.where(unsure, np.inf, 0.0)
    for number in np.unique(met[unsure[of]]):
        here = np.unique(of[(met == number) & unsure[of]])
        away = world.parts[number].distance(points[here])
        nearer = away < nearest[here]
        part[here[nearer]], nearest[here[nearer]] = number, away[nearer]
    kind = np.zeros(len(points), np.int8)
    checked = np.flatnonzero(nearest > CLEARANCE * scale)
    kind[checked[world.distance(points[checked]) > CLEARANCE * scale[checked]]] = MIXED
    inside = soft[part] & (nearest == 0)
    sure = (kind == MIXED) | inside | (~soft[part] & (nearest <= CLEARANCE * scale))
    kind[~sure] = IN_DOUBT

    of_part = member[met == part[of]]
    first = of_part[np.unique(echo[of_part], return_index=True)[1]]
    place = rays.places[first]
    place[inside] = points[inside]
    return part, place, kind
