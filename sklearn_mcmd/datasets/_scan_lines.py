"""What a scanner with a turning mirror sees: points on scan lines, nearest surfaces only."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.datasets._echoes import (
    PHASE_SHIFT,
    REGULAR,
    SNOW,
    Rays,
    blocks,
    cone,
    merge,
    truths,
)
from sklearn_mcmd.datasets._outliers import CLEARANCE
from sklearn_mcmd.datasets._snow import flake_echoes
from sklearn_mcmd.datasets._surfaces import first_hits

#: A scanner is blind below this elevation.
LOWEST = -np.radians(60)

#: Rays on a side of the grid that measures the share of the view that holds something.
_PILOT = 250

#: More rays than needed by this share; as many at random are lost, as dark surfaces do.
_SURPLUS = 0.02


class Optics(NamedTuple):
    """Beams and weather: the divergence in radians, snow in mm of water an hour, the standard
    deviation of ranges from points (n, 3) of a bay, and the generator of flakes.
    """

    divergence: float
    snow: float
    noise_at: Callable
    rng: np.random.Generator


class Lines(NamedTuple):
    """Echoes in bay coordinates: without noise, and truly; part, bay, and kind of the echo."""

    points: np.ndarray
    places: np.ndarray
    surface: np.ndarray
    bay: np.ndarray
    kind: np.ndarray


#: Flakes farther than this are not seen among what a bay holds.
_REACH = 100.0


def scan_lines(scene, n, rng, optics=None):
    """n points of the scene's surfaces on vertical scan lines at equal angles: `Lines`.

    From each bay's scanner rays leave in columns of equal azimuth, at equal steps of azimuth and
    elevation, and end at the first surface they meet. So the density falls with the square of the
    range and with the angle of incidence, and what lies behind another surface is in shadow.
    Without `optics` beams have no width, and the air is clear.
    """
    sizes = np.full(scene.n_bays, n // scene.n_bays)
    sizes[: n - sizes.sum()] += 1
    area = angular_area(scene)
    found = [_scan_bay(scene, bay, size, area, rng, optics) for bay, size in enumerate(sizes)]
    return Lines(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


@lru_cache(maxsize=8)
def angular_area(scene):
    """Azimuth times elevation, in square radians, in which a bay's scanner meets a surface."""
    rng = np.random.default_rng(0)
    view = _view(scene)
    size = np.prod(view[1] - view[0])
    found = _cast(scene, 0, _grid(view, np.sqrt(size) / _PILOT, rng), rng, None)
    return size * np.mean(found.surface >= 0)


def effective_area(scene):
    """Points of a bay = effective area / spacing^2, with the spacing at the nearest surface."""
    return angular_area(scene) * scene.nearest_range**2


def _scan_bay(scene, bay, n, area, rng, optics):
    if n == 0:
        none = np.empty(0, int)
        return Lines(np.empty((0, 3)), np.empty((0, 3)), none, none, none)
    view, step = _view(scene), np.sqrt(area / ((1 + _SURPLUS) * n + 4))
    while True:
        found = _cast(scene, bay, _grid(view, step, rng), rng, optics)
        met = np.flatnonzero(found.surface >= 0)
        if len(met) >= n:
            chosen = np.sort(rng.permutation(met)[:n])
            return Lines(*(values[chosen] for values in found))
        step *= 0.99


def _grid(view, step, rng):
    """Azimuth and elevation of rays on scan lines, column by column."""
    azimuth, elevation = (np.arange(low + step * rng.random(), high, step) for low, high in view.T)
    return np.repeat(azimuth, len(elevation)), np.tile(elevation, len(azimuth))


def _cast(scene, bay, angles, rng, optics):
    """Where rays of a bay's scanner end, and the part that each meets, -1 where none."""
    azimuth, elevation = angles
    flat = np.cos(elevation)
    ray = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    rows = blocks(len(ray), optics.divergence if optics else 0.0)
    found = [_cast_block(scene, bay, ray[block], rng, optics) for block in rows]
    found = Lines(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))
    return _let_it_snow(scene, ray, found, optics) if optics and optics.snow else found


def _cast_block(scene, bay, ray, rng, optics):
    ways = cone(ray, optics.divergence if optics else 0.0)
    n, n_rays = ways.shape[:2]
    reach = 1.01 * scene.farthest_range
    way = reach * ways.reshape(-1, 3)
    apart = reach * np.linalg.norm(ways - ways[:, :1], axis=2).max(initial=0.0)
    nearest, surface = first_hits(
        scene.parts, scene.scanner, scene.scanner + way, rng, n_rays, apart
    )
    points = np.full(ray.shape, np.nan)
    if n_rays == 1:
        met = surface >= 0
        points[met] = scene.scanner + nearest[met, None] * way[met]
        return Lines(points, points, surface, np.full(n, bay), np.full(n, REGULAR))
    met = np.flatnonzero(surface >= 0)
    rays = Rays(
        met // n_rays,
        np.broadcast_to(scene.scanner, (len(met), 3)),
        ways.reshape(-1, 3)[met],
        reach * nearest[met],
        surface[met],
    )
    return _merge(scene, bay, ray, rays, optics)


def _merge(scene, bay, ray, rays, optics):
    """What beams of some width give: all light that comes back has one range."""
    beam, ranges, echo = merge(rays, PHASE_SHIFT)
    echoes = scene.scanner + ranges[:, None] * ray[beam]
    met, place, kind, known = truths(
        scene.parts,
        lambda points: scene.distance(scene.to_scene(points, bay)),
        rays,
        echo,
        echoes,
        optics.noise_at(echoes),
    )
    n, beam = len(ray), beam[known]
    points, places = np.full((2, n, 3), np.nan)
    surface, kinds = np.full(n, -1), np.full(n, REGULAR)
    points[beam], places[beam] = echoes[known], place[known]
    surface[beam], kinds[beam] = met[known], kind[known]
    return Lines(points, places, surface, np.full(n, bay), kinds)


def _let_it_snow(scene, ray, found, optics):
    """Flakes in place of what some rays meet; those at surfaces are lost in their echoes."""
    target = np.linalg.norm(found.points - scene.scanner, axis=1)
    target[found.surface < 0] = np.inf
    beam, ranges = flake_echoes(target, optics.snow, _REACH, optics.divergence, optics.rng)
    flakes = scene.scanner + ranges[:, None] * ray[beam]
    away = scene.distance(scene.to_scene(flakes, found.bay[beam]))
    apart = away > CLEARANCE * optics.noise_at(flakes)
    beam, flakes = beam[apart], flakes[apart]
    points, surface, kind = found.points.copy(), found.surface.copy(), found.kind.copy()
    points[beam], surface[beam], kind[beam] = flakes, 0, SNOW
    return Lines(points, found.places, surface, found.bay, kind)


def _view(scene):
    """Least and greatest azimuth and elevation that can hold a part of a bay: (2, 2) radians."""
    low, high = scene.bay_bounds - scene.scanner
    azimuths = np.array([-np.pi, np.pi])
    if (low[:2] > 0).any() or (high[:2] < 0).any():  # all parts are on one side
        x, y = (grid.ravel() for grid in np.meshgrid([low[0], high[0]], [low[1], high[1]]))
        middle = np.arctan2(y.mean(), x.mean())
        apart = (np.arctan2(y, x) - middle + np.pi) % (2 * np.pi) - np.pi
        azimuths = middle + np.array([apart.min(), apart.max()])
    elevations = [[], []]
    for part in scene.parts:
        low, high = part.bounds - scene.scanner
        nearest = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)[:2])
        farthest = np.linalg.norm(np.maximum(np.abs(low), np.abs(high))[:2])
        elevations[0].append(np.arctan2(low[2], nearest if low[2] < 0 else farthest))
        elevations[1].append(np.arctan2(high[2], nearest if high[2] > 0 else farthest))
    limits = max(min(elevations[0]), LOWEST), max(elevations[1])
    return np.column_stack([azimuths, limits])
