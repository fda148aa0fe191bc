"""The echo of a beam that is a cone: sub-rays, and the one range that they give together.

A beam's intensity is Gaussian across, and its divergence is the full angle at which it falls to
1/e^2 of that on the axis, as data sheets state it. Sub-rays carry equal energy each.

- A phase-shift scanner has one range for all light that comes back: the mean over the beam,
  weighted by energy. So has a pulsed one where echoes follow each other within its resolution,
  half the length of the pulse; echoes farther apart it tells from each other, and of these it
  writes down the strongest here. (Echoes merge within c tau / 2: M. Hebert and E. Krotkov, "3D
  measurements from imaging laser radars: how good are they?", Image and Vision Computing 10,
  1992; S. Chaudhry, D. Salido-Monzú and A. Wieser, "A modeling approach for predicting the
  resolution capability in terrestrial laser scanning", Remote Sensing 13, 2021, for phases.)
- Energy falls with the square of the range. Surfaces reflect alike, whatever their tilt.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.datasets._outliers import CLEARANCE
from sklearn_mcmd.datasets._surfaces import Soft

__all__ = [
    "MIXED",
    "PHASE_SHIFT",
    "PULSED",
    "REGULAR",
    "SNOW",
    "Rays",
    "blocks",
    "cone",
    "merge",
    "truths",
]

#: Kinds of echoes.
REGULAR, MIXED, SNOW = 0, 1, 2

#: Resolution in meters: pulses of 5 ns, and scanners that compare phases.
PULSED, PHASE_SHIFT = 0.75, np.inf

#: Sub-rays of a beam. The first is its axis.
_RAYS = 19

#: Beams that are cast at once, so that their sub-rays need little memory.
_BLOCK = 1 << 13


class Rays(NamedTuple):
    """Sub-rays that met something: their beams in ascending order, range and part."""

    beam: np.ndarray
    origins: np.ndarray
    directions: np.ndarray
    ranges: np.ndarray
    part: np.ndarray


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


def blocks(n, divergence):
    """Slices of n beams that are cast at once: all of those without divergence."""
    step = _BLOCK if divergence else max(n, 1)
    return [slice(start, start + step) for start in range(0, max(n, 1), step)]


def own_codes(kinds, names):
    """The code of each echo that is no regular one, by the name of its kind; 0 of the others."""
    own = np.zeros(len(kinds), np.int8)
    for kind, name in ((MIXED, "mixed_pixel"), (SNOW, "snow")):
        own[kinds == kind] = names.index(name) if name in names else 0
    return own


def rows_of(kinds, n_outliers, order):
    """Functions that put values of echoes and outliers in order: all, or the truth of regular ones.

    Raise if no echo is regular.
    """
    regular = kinds == REGULAR
    if not regular.any():
        raise ValueError(
            "Snow and mixed pixels leave no regular point: give more points (n_samples), or less "
            "snow."
        )

    def join(of_echoes, of_outliers):
        of_outliers = np.broadcast_to(of_outliers, (n_outliers, *of_echoes.shape[1:]))
        return np.concatenate([of_echoes, of_outliers]).astype(of_echoes.dtype)[order]

    def truth(of_echoes, nothing):
        wide = regular.reshape(-1, *[1] * (of_echoes.ndim - 1))
        return join(np.where(wide, of_echoes, nothing).astype(of_echoes.dtype), nothing)

    return join, truth


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


def truths(parts, distance, rays, echo, points, scale):
    """What m echoes are truly of, from their points without noise and the ranges' deviations there.

    `distance` is that of points to the nearest part of the whole scene, `echo` as `merge` gives it.
    Returns, of each echo,

    - the nearest of the parts that its sub-rays met;
    - where that part was met, next to the axis; in leaves and grass the echo itself;
    - its kind: `MIXED` where it is farther than the clearance of all outliers from every surface;
    - whether its label is known: not where it would be in doubt, because the echo is at a surface
      that its beam did not meet, or next to leaves.
    """
    member = np.flatnonzero(echo >= 0)
    of, met = echo[member], rays.part[member]
    soft = np.array([isinstance(part, Soft) for part in parts])
    lowest, highest = np.full(len(points), len(parts)), np.full(len(points), -1)
    np.minimum.at(lowest, of, met)
    np.maximum.at(highest, of, met)
    part = highest.copy()
    unsure = (lowest < highest) | soft[highest]
    nearest = np.where(unsure, np.inf, 0.0)
    for number in np.unique(met[unsure[of]]):
        here = np.unique(of[(met == number) & unsure[of]])
        away = parts[number].distance(points[here])
        nearer = away < nearest[here]
        part[here[nearer]], nearest[here[nearer]] = number, away[nearer]
    kind = np.zeros(len(points), np.int8)
    checked = np.flatnonzero(nearest > CLEARANCE * scale)
    kind[checked[distance(points[checked]) > CLEARANCE * scale[checked]]] = MIXED
    inside = soft[part] & (nearest == 0)
    known = (kind == MIXED) | inside | (~soft[part] & (nearest <= CLEARANCE * scale))

    own = member[met == part[of]]
    _, first = np.unique(echo[own], return_index=True)
    first = own[first]
    place = rays.origins[first] + rays.ranges[first, None] * rays.directions[first]
    place[inside] = points[inside]
    return part, place, kind, known
