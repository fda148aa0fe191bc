"""Parts of all simulated roadsides: the road, its kerb, poles, turned plates, openings in walls.

Lengths are in meters; x runs along the road, y across it, z up.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.datasets._surfaces import Circle, Cylinder, Patch

__all__ = [
    "CROWN_RADIUS",
    "CROWN_Z",
    "KERB_Y",
    "PATH_Z",
    "UP",
    "Opening",
    "facing",
    "feet",
    "pole",
    "recess",
    "road_and_kerb",
]

KERB_Y, PATH_Z = 3.0, 0.10
UP = np.array([0, 0, 1.0])
CROWN_RADIUS, CROWN_Z = 75.0, 0.03


class Opening(NamedTuple):
    """Window or door in a wall along x."""

    x0: float
    x1: float
    z0: float
    z1: float


def road_and_kerb(length):
    """Half of a cambered road and a kerb of 13 cm."""
    gutter_angle = np.arcsin(KERB_Y / CROWN_RADIUS)
    gutter_z = CROWN_Z - CROWN_RADIUS * (1 - np.cos(gutter_angle))
    along = np.array([length, 0, 0])
    return [
        Cylinder(
            "road",
            (length, 0, CROWN_Z - CROWN_RADIUS),
            -along,  # right-handed around -x: from the crown towards the kerb
            CROWN_RADIUS,
            start=UP,
            arc=gutter_angle,
            sharp=("stop",),
        ),
        Patch("kerb", (0, KERB_Y, gutter_z), along, (PATH_Z - gutter_z) * UP, smooth=("u0", "u1")),
    ]


def pole(name, foot, radius, top):
    """A pole that stands on the footpath at (x, y)."""
    return Cylinder(name, (*foot, PATH_Z), (0, 0, top - PATH_Z), radius)


def feet(things):
    """The edges of poles on the footpath."""
    return [
        Circle(part.base, UP, part.radius)
        for part in things
        if isinstance(part, Cylinder) and part.base[2] == PATH_Z
    ]


def facing(turn):
    """Two directions of a plate: along it, to the right as seen from the road, and to the road."""
    return np.array([np.cos(turn), np.sin(turn), 0]), np.array([np.sin(turn), -np.cos(turn), 0])


def recess(name, wall_y, opening, depth, *, sill):
    """The back of an opening in the wall at that y, and its reveals."""
    x0, x1, z0, z1 = opening
    x, y, z = (x1 - x0, 0, 0), (0, depth, 0), (0, 0, z1 - z0)
    parts = [
        Patch(f"{name}_back", (x0, wall_y + depth, z0), x, z),
        Patch(f"{name}_left", (x0, wall_y, z0), y, z),
        Patch(f"{name}_right", (x1, wall_y, z0), z, y),
        Patch(f"{name}_head", (x0, wall_y, z1), y, x),
    ]
    return [*parts, Patch(f"{name}_sill", (x0, wall_y, z0), x, y)] if sill else parts
