"""Wires, and worlds whose beams may go past them."""

from itertools import pairwise

import numpy as np

from sklearn_mcmd.datasets._surfaces import Cylinder

from ._things import World

_PIECES = 6  # of a sagging wire


class Wire(Cylinder):
    """Straight piece of a wire, as thick as the beam that meets it: it has no normals."""

    def normals(self, points):
        return np.full((len(points), 3), np.nan)


class WiredWorld(World):
    """A world whose beams may go past wires as past leaves."""

    def __init__(self, classes):
        super().__init__(classes)
        self.through |= [isinstance(part, Wire) for part in self.parts]


def wire(name, start, end, sag, thickness):
    """A wire that hangs through by `sag` meters, in straight pieces."""
    t = np.linspace(0, 1, _PIECES + 1)[:, None]
    knots = np.asarray(start, float) * (1 - t) + np.asarray(end, float) * t
    knots[:, 2] -= 4 * sag * (t * (1 - t))[:, 0]
    return [Wire(name, a, b - a, thickness / 2) for a, b in pairwise(knots)]
