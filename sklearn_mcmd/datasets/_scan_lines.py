"""What a scanner with a turning mirror sees: points on scan lines, nearest surfaces only."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.datasets._beams import PHASE_SHIFT, Beams, Sensor, Target, cast

LOWEST = -np.radians(60)  # a scanner is blind below this elevation
_PILOT = 250  # rays on a side of the grid that measures the share of the view that holds something
_SURPLUS = 0.02  # share of rays that are lost at random, as those on dark surfaces are


class Lines(NamedTuple):
    """Echoes in bay coordinates: without noise, and truly; part, bay, and kind of the echo."""

    points: np.ndarray
    places: np.ndarray
    surface: np.ndarray
    bay: np.ndarray
    kind: np.ndarray


def scan_lines(scene, n, rng, scanning):
    """n points of the scene's surfaces on vertical scan lines at equal angles: `Lines`.

    From each bay's scanner rays leave in columns of equal azimuth, at equal steps of azimuth and
    elevation, and end at the first surface they meet. So the density falls with the square of the
    range and with the angle of incidence, and what lies behind another surface is in shadow.
    """
    sizes = np.full(scene.n_bays, n // scene.n_bays)
    sizes[: n - sizes.sum()] += 1
    found = [_scan_bay(scene, bay, size, rng, scanning) for bay, size in enumerate(sizes) if size]
    return Lines(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


@lru_cache(maxsize=8)
def angular_area(scene):
    """Azimuth times elevation, in square radians, in which a bay's scanner meets a surface."""
    rng = np.random.default_rng(0)
    view = _view(scene)
    size = np.prod(view[1] - view[0])
    beams, found = _cast(scene, 0, view, np.sqrt(size) / _PILOT, rng)
    return size * (len(found.beam) / len(beams.origins))


def effective_area(scene):
    """Points of a bay = effective area / spacing^2, with the spacing at the nearest surface."""
    return angular_area(scene) * scene.nearest_range**2


def _scan_bay(scene, bay, n, rng, scanning):
    view, step = _view(scene), np.sqrt(angular_area(scene) / ((1 + _SURPLUS) * n + 4))
    while True:
        beams, found = _cast(scene, bay, view, step, rng, scanning)
        found = found.take(found.kind >= 0)
        if len(found.beam) >= n:
            found = found.take(np.sort(rng.permutation(len(found.beam))[:n]))
            ends = found.ranges[:, None] * beams.directions[found.beam]
            points = beams.origins[found.beam] + ends
            return Lines(points, found.place, found.part, np.full(n, bay), found.kind)
        step *= 0.99


def _cast(scene, bay, view, step, rng, scanning=None):
    """Beams of a bay's scanner, column by column, and their echoes."""
    azimuth, elevation = (np.arange(low + step * rng.random(), high, step) for low, high in view.T)
    azimuth, elevation = np.repeat(azimuth, len(elevation)), np.tile(elevation, len(azimuth))
    flat = np.cos(elevation)
    ray = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    divergence = scanning.beam_divergence if scanning else 0.0
    reach = 1.01 * scene.farthest_range
    # Beams without width are as long as they reach, so that coordinates are rounded once less.
    unit = 1.0 if divergence else reach
    sensor = Sensor(
        noise_at=lambda ranges: scanning.noise * scene.growth(ranges, scanning.noise_growth),
        reach=reach / unit,
        divergence=divergence,
        resolution=PHASE_SHIFT,
    )
    target = Target(
        parts=scene.parts,
        through=np.zeros(len(scene.parts), bool),
        distance=lambda points: scene.distance(scene.to_scene(points, bay)),
    )
    beams = Beams(np.tile(scene.scanner, (len(ray), 1)), unit * ray)
    return beams, cast(target, sensor, beams, rng)


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
