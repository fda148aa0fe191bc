"""What a scanner with a turning mirror sees: points on scan lines, nearest surfaces only."""

import numpy as np

from sklearn_mcmd.datasets._surfaces import first_hits

#: A scanner is blind below this elevation.
LOWEST = -np.radians(60)

#: Rays on a side of the grid that measures the share of the view that holds something.
_PILOT = 250

#: More rays than needed by this share; as many at random are lost, as dark surfaces do.
_SURPLUS = 0.02


def scan_lines(scene, n, rng):
    """n points of the scene's surfaces on vertical scan lines at equal angles.

    From each bay's scanner rays leave in columns of equal azimuth, at equal steps of azimuth and
    elevation, and end at the first surface they meet. So the density falls with the square of
    the range and with the angle of incidence, and what lies behind another surface is in shadow.

    Returns
    -------
    local : ndarray of shape (n, 3)
        In bay coordinates.
    surface, bay : ndarray of int of shape (n,)
    """
    sizes = np.full(scene.n_bays, n // scene.n_bays)
    sizes[: n - sizes.sum()] += 1
    area = angular_area(scene)
    found = [_scan_bay(scene, size, area, rng) for size in sizes]
    local, surface = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
    return local, surface, np.repeat(np.arange(scene.n_bays), sizes)


def angular_area(scene):
    """Azimuth times elevation, in square radians, in which a bay's scanner meets a surface."""
    rng = np.random.default_rng(0)
    view = _view(scene)
    size = np.prod(view[1] - view[0])
    _, surface = _cast(scene, *_grid(view, np.sqrt(size) / _PILOT, rng), rng)
    return size * np.mean(surface >= 0)


def effective_area(scene):
    """Points of a bay = effective area / spacing^2, with the spacing at the nearest surface."""
    return angular_area(scene) * scene.nearest_range**2


def _scan_bay(scene, n, area, rng):
    if n == 0:
        return np.empty((0, 3)), np.empty(0, int)
    view, step = _view(scene), np.sqrt(area / ((1 + _SURPLUS) * n + 4))
    while True:
        points, surface = _cast(scene, *_grid(view, step, rng), rng)
        met = np.flatnonzero(surface >= 0)
        if len(met) >= n:
            chosen = np.sort(rng.permutation(met)[:n])
            return points[chosen], surface[chosen]
        step *= 0.99


def _grid(view, step, rng):
    """Azimuth and elevation of rays on scan lines, column by column."""
    azimuth, elevation = (np.arange(low + step * rng.random(), high, step) for low, high in view.T)
    return np.repeat(azimuth, len(elevation)), np.tile(elevation, len(azimuth))


def _cast(scene, azimuth, elevation, rng):
    """Where rays of a bay's scanner end, and the part that each meets, -1 where none."""
    flat = np.cos(elevation)
    ray = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])
    way = 1.01 * scene.farthest_range * ray
    nearest, surface = first_hits(scene.parts, scene.scanner, scene.scanner + way, rng)
    met = surface >= 0
    points = np.full(ray.shape, np.nan)
    points[met] = scene.scanner + nearest[met, None] * way[met]
    return points, surface


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
