"""Where the beams of a sensor end: the one ray caster of all scanned scenes.

A beam may be a cone, cast as sub-rays that carry equal energy each. Its intensity is Gaussian
across, and its divergence is the full angle at which it falls to 1/e^2 of that on the axis, as data
sheets state it.

- A phase-shift scanner has one range for all light that comes back: the mean over the beam,
  weighted by energy. So has a pulsed one where echoes follow each other within its resolution,
  half the length of the pulse; echoes farther apart it tells from each other, and of these it
  writes down the strongest here. (Echoes merge within c tau / 2: M. Hebert and E. Krotkov, "3D
  measurements from imaging laser radars: how good are they?", Image and Vision Computing 10,
  1992; S. Chaudhry, D. Salido-Monzú and A. Wieser, "A modeling approach for predicting the
  resolution capability in terrestrial laser scanning", Remote Sensing 13, 2021, for phases.)
- Energy falls with the square of the range. Surfaces reflect alike, whatever their tilt.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.datasets._outliers import CLEARANCE
from sklearn_mcmd.datasets._surfaces import Soft, first_hits

REGULAR, MIXED, SNOW = 0, 1, 2  # kinds of echoes
IN_DOUBT = -1  # the kind of an echo whose label is not sure
PULSED = 0.75  # resolution of pulses of 5 ns, in meters
PHASE_SHIFT = np.inf  # scanners that compare phases tell no echoes from each other
_RAYS = 19  # sub-rays of a beam; the first is its axis
_BLOCK = 1 << 13  # beams that are cast at once, so that their sub-rays need little memory
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


class Rays(NamedTuple):
    """Sub-rays that met something: their beams in ascending order, range and part."""

    beam: np.ndarray
    origins: np.ndarray
    directions: np.ndarray
    ranges: np.ndarray
    part: np.ndarray


class Echoes(NamedTuple):
    """Where beams end: the beam, range, part, 1 for a first echo, the true point, and the kind."""

    beam: np.ndarray
    ranges: np.ndarray
    part: np.ndarray
    order: np.ndarray
    place: np.ndarray
    kind: np.ndarray

    def take(self, rows):
        return Echoes(*(values[rows] for values in self))


def join_echoes(echoes):
    return Echoes(*map(np.concatenate, zip(*echoes, strict=True)))


def cast(target, sensor, beams, rng):
    """All echoes of beams, block by block and in each by their order; also those in doubt.

    The target, a `World` or a `Scene`, has ``parts``, of each whether a beam may go past it and
    meet something else (``through``), and the ``distance`` of points to the nearest.
    """
    numbers, echoes = np.arange(len(beams.origins)), []
    step = _BLOCK if sensor.divergence else max(len(numbers), 1)  # beams without width at once
    for start in range(0, max(len(numbers), 1), step):
        echoes += _cast_block(target, sensor, beams, numbers[start : start + step], rng)
    return join_echoes(echoes)


def _cast_block(target, sensor, beams, numbers, rng):
    """All echoes of the beams of these numbers: those of each order."""
    ways = cone(beams.directions[numbers], sensor.divergence)
    n_rays = ways.shape[1]
    rays = Rays(
        beam=np.repeat(numbers, n_rays),
        origins=np.repeat(beams.origins[numbers], n_rays, axis=0),
        directions=ways.reshape(-1, 3),
        ranges=np.zeros(ways[..., 0].size),
        part=None,
    )
    apart = sensor.reach * np.linalg.norm(ways - ways[:, :1], axis=2).max(initial=0.0)
    bundle = (n_rays, apart)
    echoes = []
    for order in range(1, _MOST_ECHOES + 1):
        rays = _meet(target, sensor, rays, rng, *bundle)
        found, of_ray = _echoes(target, sensor, beams, rays, order)
        echoes.append(found)
        if not target.through.any():
            break
        on = target.through[found.part] & (rng.random(len(found.part)) < sensor.passing)
        on = (of_ray >= 0) & on[of_ray] & target.through[rays.part]
        rays, bundle = Rays(*(values[on] for values in rays)), ()
        if len(rays.beam) == 0:
            break
    return echoes


def _meet(target, sensor, rays, rng, bundle=1, apart=0.0):
    """What rays meet behind their ranges; only those that meet something."""
    start = np.where(rays.ranges > 0, rays.ranges + 1e-3, 0.0)
    origin = rays.origins + start[:, None] * rays.directions
    left = sensor.reach - start
    ends = origin + left[:, None] * rays.directions
    fraction, part = first_hits(target.parts, origin, ends, rng, bundle, apart)
    met = part >= 0
    return Rays(
        beam=rays.beam[met],
        origins=rays.origins[met],
        directions=rays.directions[met],
        ranges=start[met] + fraction[met] * left[met],
        part=part[met],
    )


def _echoes(target, sensor, beams, rays, order):
    """Echoes of beams, and which one each ray is in, or -1."""
    if sensor.divergence == 0:
        beam, ranges, part, of_ray = rays.beam, rays.ranges, rays.part, np.arange(len(rays.beam))
        place = rays.origins + ranges[:, None] * rays.directions
        kind = np.full(len(beam), REGULAR, np.int8)
    else:
        beam, ranges, of_ray = merge(rays, sensor.resolution)
        points = beams.origins[beam] + ranges[:, None] * beams.directions[beam]
        part, place, kind = truths(target, rays, of_ray, points, sensor.noise_at(ranges))
    numbers = np.full(len(beam), order, np.int8)
    return Echoes(
        beam=beam, ranges=ranges, part=part, order=numbers, place=place, kind=kind
    ), of_ray


def cone(directions, divergence):
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


def truths(target, rays, echo, points, scale):
    """What m echoes are truly of, from their points without noise and the ranges' deviations there.

    `echo` is as `merge` gives it. Returns, of each echo,

    - the nearest of the parts that its sub-rays met;
    - where that part was met, next to the axis; in leaves and grass the echo itself;
    - its kind: `MIXED` where it is farther than the clearance of all outliers from every surface,
      `IN_DOUBT` where it is at a surface that its beam did not meet, or next to leaves.
    """
    member = np.flatnonzero(echo >= 0)
    of, met = echo[member], rays.part[member]
    soft = np.array([isinstance(part, Soft) for part in target.parts])
    lowest, highest = np.full(len(points), len(target.parts)), np.full(len(points), -1)
    np.minimum.at(lowest, of, met)
    np.maximum.at(highest, of, met)
    part = highest.copy()
    unsure = (lowest < highest) | soft[highest]
    nearest = np.where(unsure, np.inf, 0.0)
    for number in np.unique(met[unsure[of]]):
        here = np.unique(of[(met == number) & unsure[of]])
        away = target.parts[number].distance(points[here])
        nearer = away < nearest[here]
        part[here[nearer]], nearest[here[nearer]] = number, away[nearer]
    kind = np.zeros(len(points), np.int8)
    checked = np.flatnonzero(nearest > CLEARANCE * scale)
    kind[checked[target.distance(points[checked]) > CLEARANCE * scale[checked]]] = MIXED
    inside = soft[part] & (nearest == 0)
    known = (kind == MIXED) | inside | (~soft[part] & (nearest <= CLEARANCE * scale))
    kind[~known] = IN_DOUBT

    own = member[met == part[of]]
    _, first = np.unique(echo[own], return_index=True)
    first = own[first]
    place = rays.origins[first] + rays.ranges[first, None] * rays.directions[first]
    place[inside] = points[inside]
    return part, place, kind
