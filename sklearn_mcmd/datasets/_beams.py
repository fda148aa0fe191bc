"""Where the beams of a scanner end: the ray caster of all simulated scans.

A beam may be a cone, cast as sub-rays that carry equal energy each. Its intensity is Gaussian
across, and its divergence is the full angle at which it falls to 1/e^2 of that on the axis, as data
sheets state it. Energy falls with the square of the range. Surfaces reflect alike, whatever their
tilt. A scanner that compares phases has one range for all light that comes back: the mean over the
beam, weighted by energy (S. Chaudhry, D. Salido-Monzú and A. Wieser, "A modeling approach for
predicting the resolution capability in terrestrial laser scanning", Remote Sensing 13, 2021).
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.datasets._outliers import CLEARANCE
from sklearn_mcmd.datasets._surfaces import Soft, first_hits

REGULAR, MIXED = 0, 1  # kinds of echoes
IN_DOUBT = -1  # the kind of an echo whose label is not sure
_RAYS = 19  # sub-rays of a beam; the first is its axis
_BLOCK = 1 << 13  # beams that are cast at once, so that their sub-rays need little memory


class Beams(NamedTuple):
    """Beams in the order in which a scanner sends them: origins and directions (n, 3)."""

    origins: np.ndarray
    directions: np.ndarray


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
    """Where beams end: the beam, range, part, the true point, and the kind."""

    beam: np.ndarray
    ranges: np.ndarray
    part: np.ndarray
    place: np.ndarray
    kind: np.ndarray

    def take(self, rows):
        return Echoes(*(values[rows] for values in self))


def cast(scene, beams, reach, rng, noise_at, divergence):
    """The echo of each beam that has one, also those in doubt.

    ``reach`` is the longest range, in lengths of the beams' directions; ``noise_at(ranges)`` gives
    the standard deviation of ranges.
    """
    echoes = []
    for numbers in blocks(len(beams.directions), divergence):
        rays, bundle = send(beams, numbers, reach, divergence)
        rays = meet(scene.parts, rays, reach, rng, *bundle)
        if divergence == 0:
            echoes.append(echoes_of_thin_beams(rays))
        else:
            echoes.append(echoes_of_cones(scene, beams, rays, noise_at, *_merge(rays)))
    return Echoes(*map(np.concatenate, zip(*echoes, strict=True)))


def blocks(n, divergence):
    """Numbers of n beams, as many as are cast at once; those without width all at once."""
    step = _BLOCK if divergence else max(n, 1)
    return [np.arange(start, min(start + step, n)) for start in range(0, max(n, 1), step)]


def send(beams, numbers, reach, divergence):
    """Sub-rays of the beams of these numbers, and the bundles in which they leave."""
    ways = cone(beams.directions[numbers], divergence)
    n_rays = ways.shape[1]
    rays = Rays(
        beam=np.repeat(numbers, n_rays),
        origins=np.repeat(beams.origins[numbers], n_rays, axis=0),
        directions=ways.reshape(-1, 3),
        ranges=np.zeros(ways[..., 0].size),
    )
    apart = reach * np.linalg.norm(ways - ways[:, :1], axis=2).max(initial=0.0)
    return rays, (n_rays, apart)


def meet(parts, rays, reach, rng, bundle=1, apart=0.0):
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


def echoes_of_thin_beams(rays):
    kind = np.full(len(rays.beam), REGULAR, np.int8)
    return Echoes(rays.beam, rays.ranges, rays.part, rays.places, kind)


def echoes_of_cones(target, beams, rays, noise_at, beam, ranges, echo):
    """Echoes at these ranges of beams, each of the rays that have its number."""
    points = beams.origins[beam] + ranges[:, None] * beams.directions[beam]
    return Echoes(beam, ranges, *truths(target, rays, echo, points, noise_at(ranges)))


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


def _merge(rays):
    """Beams that have an echo, their mean ranges by energy, and the number of each ray's echo."""
    beam, echo = np.unique(rays.beam, return_inverse=True)
    ranges = rays.ranges[np.lexsort([rays.ranges, rays.beam])]  # clouds keep their last bits
    weight = 1 / ranges**2
    return beam, np.bincount(echo, weight * ranges) / np.bincount(echo, weight), echo


def truths(target, rays, echo, points, scale):
    """What m echoes are truly of, from their points without noise and the ranges' deviations there.

    `echo` is the number of the echo that each ray is in, or -1. Returns, of each echo,

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
    first = own[np.unique(echo[own], return_index=True)[1]]
    place = rays.places[first]
    place[inside] = points[inside]
    return part, place, kind
