"""A hall of nine walls that is scanned twice, of which some have moved."""

import numpy as np
from scipy.spatial import cKDTree

# Origin and two sides of nine walls of a hall: three face each axis.
WALLS = [
    *[((0, 0, z), (9, 0, 0), (0, 6, 0)) for z in (0, 4)],
    ((3, 2, 1.2), (2, 0, 0), (0, 2, 0)),
    *[((0, y, 0), (9, 0, 0), (0, 0, 4)) for y in (0, 6)],
    ((2, 1, 2), (3, 0, 0), (0, 0, 1.5)),
    *[((x, 0, 0), (0, 6, 0), (0, 0, 4)) for x in (0, 9)],
    ((7, 1, 0.5), (0, 3, 0), (0, 0, 2)),
]


def hall(rng, moved=(), by=0.005, n=700):
    """Points of the walls, of which some are off along their normals; and the wall of each."""
    parts = []
    for k, corners in enumerate(WALLS):
        origin, *sides = map(np.array, corners)
        normal = np.cross(*sides) / np.linalg.norm(np.cross(*sides))
        places = rng.uniform(0.02, 0.98, (n, 2)) @ sides + origin
        parts.append(places + normal * (rng.normal(0, 0.003, (n, 1)) + by * (k in moved)))
    return np.vstack(parts), np.repeat(np.arange(len(WALLS)), n)


def registered(xyz, rng, error=0.002):
    """A cloud whose registration is off: by shifts, and by turns of 30 seconds of arc."""
    shift, turn = rng.normal(0, error, 3), rng.normal(0, np.radians(30 / 3600), 3)
    return xyz + shift + np.cross(turn, xyz - xyz.mean(axis=0)), np.append(shift, turn)


def walls_of(bodies, xyz, walls):
    return np.array(
        [np.bincount(walls[cKDTree(xyz).query(at, 9)[1]]).argmax() for at in bodies.place]
    )
