"""Things that stand in simulated scenes: posts, boxes, cars, houses; and all of a scene."""

import numpy as np

from sklearn_mcmd.datasets._street import UP
from sklearn_mcmd.datasets._surfaces import Cylinder, Patch, Soft

from ._panels import Disc, Polygon


class World:
    """Parts of a scene by their class: lists of parts, or of lists of them.

    ``through`` says of each part whether a beam may go past it and meet something else.
    """

    def __init__(self, classes):
        self.class_names = list(classes)
        parts = [_flat(things) for things in classes.values()]
        self.parts = _flat(parts)
        self.class_of = np.repeat(np.arange(len(parts)), list(map(len, parts)))
        self.through = np.array([isinstance(part, Soft) for part in self.parts])

    def distance(self, points):
        """Distance of any points (n, 3) to the nearest part."""
        return np.min([part.distance(points) for part in self.parts], axis=0)


def capped(name, foot, radius, height):
    """An upright cylinder with a lid, for scanners that look down on it."""
    foot = np.asarray(foot, float)
    return [Cylinder(name, foot, height * UP, radius), Disc(name, foot + height * UP, UP, radius)]


def box(name, corner, size):
    """A box along the axes: front (toward -y), top, left, right and back as patches."""
    corner = np.asarray(corner, float)
    x, y, z = np.diag(np.asarray(size, float))
    return [
        Patch(name, corner, x, z),
        Patch(name, corner + z, x, y),
        Patch(name, corner, z, y),
        Patch(name, corner + x, y, z),
        Patch(name, corner + x + y, -x, z),
    ]


def car(name, foot, turn):
    """A car of 4.2 m by 1.8 m by 1.45 m whose windows let beams through to its seats.

    `foot` is its middle on the ground, `turn` are the radians from x to its nose.
    """
    at, panel, across = _frame(name, foot, turn, (2.1, 0.9))
    sides = ((0.05, 0.2), (1.75, 1.6))
    pillars = [
        ((x0, y, 0.9), (x1, yt, 1.45)) for x0, x1 in ((0.3, 0.7), (2.95, 2.35)) for y, yt in sides
    ]
    wheels = [((x, y, 0.3), side) for x in (0.75, 3.4) for y, side in ((-0.01, -1), (1.81, 1))]
    return [
        panel((0, 0, 0.25), (4.2, 0, 0.25), (4.2, 0, 0.65), (3.0, 0, 0.9), (0, 0, 0.9)),
        panel((0, 1.8, 0.25), (0, 1.8, 0.9), (3.0, 1.8, 0.9), (4.2, 1.8, 0.65), (4.2, 1.8, 0.25)),
        panel((4.2, 0, 0.25), (4.2, 1.8, 0.25), (4.2, 1.8, 0.65), (4.2, 0, 0.65)),
        panel((0, 0, 0.25), (0, 0, 0.9), (0, 1.8, 0.9), (0, 1.8, 0.25)),
        panel((3.0, 0, 0.9), (4.2, 0, 0.65), (4.2, 1.8, 0.65), (3.0, 1.8, 0.9)),
        panel((0.7, 0.2, 1.45), (2.35, 0.2, 1.45), (2.35, 1.6, 1.45), (0.7, 1.6, 1.45)),
        panel((0.0, 0, 0.3), (3.0, 0, 0.3), (3.0, 1.8, 0.3), (0.0, 1.8, 0.3)),
        panel((1.6, 0.2, 0.5), (1.6, 1.6, 0.5), (1.3, 1.6, 1.1), (1.3, 0.2, 1.1)),
        panel((0.7, 0.2, 0.5), (0.7, 1.6, 0.5), (0.5, 1.6, 1.1), (0.5, 0.2, 1.1)),
        *(Cylinder(name, at(*a), at(*b) - at(*a), 0.04) for a, b in pillars),
        *(Disc(name, at(*center), side * across, 0.3) for center, side in wheels),
    ]


def house(name, foot, turn, size, eaves, ridge):
    """A house with a gable roof that juts out by 0.4 m, four dormers and a chimney.

    `foot` is its middle on the ground, `turn` are the radians from x to the ridge, `size` is the
    length along the ridge and the width, `eaves` and `ridge` are heights.
    """
    _, panel, _ = _frame(name, foot, turn)
    a, b = size[0] / 2, size[1] / 2
    jut = 0.4
    drop = (ridge - eaves) / b * jut

    def block(x, y, half, top):
        """What stands on the roof: four sides that begin inside of it, and a top."""
        base = ridge - abs(y) / b * (ridge - eaves) - half[1] / b * (ridge - eaves) - 0.1
        square = [
            (x + i * half[0], y + j * half[1]) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        ends = zip(square, square[1:] + square[:1], strict=True)
        sides = [panel((*p, base), (*q, base), (*q, top), (*p, top)) for p, q in ends]
        return [*sides, panel(*((*p, top) for p in square))]

    low, dormer = eaves - drop, eaves + 0.75 * (ridge - eaves)
    roof = (-a - jut, -b - jut, low), (a + jut, -b - jut, low), (a + jut, 0, ridge)
    roof = (*roof, (-a - jut, 0, ridge))
    dormers = [(x, y) for x in (-0.5 * a, 0.1 * a) for y in (-0.5 * b, 0.5 * b)]
    return [
        panel((-a, -b, 0), (a, -b, 0), (a, -b, eaves), (-a, -b, eaves)),
        panel((a, b, 0), (-a, b, 0), (-a, b, eaves), (a, b, eaves)),
        panel((a, -b, 0), (a, b, 0), (a, b, eaves), (a, 0, ridge), (a, -b, eaves)),
        panel((-a, b, 0), (-a, -b, 0), (-a, -b, eaves), (-a, 0, ridge), (-a, b, eaves)),
        *(panel(*((s * x, s * y, z) for x, y, z in roof)) for s in (1, -1)),
        *block(0.5 * a, 0.3 * b, (0.35, 0.35), ridge + 0.8),
        *(part for x, y in dormers for part in block(x, y, (0.9, 0.25 * b), dormer)),
    ]


def _frame(name, foot, turn, middle=(0.0, 0.0)):
    """Functions that place points and polygons of a turned thing, and its second direction."""
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    across = np.array([-np.sin(turn), np.cos(turn), 0.0])

    def at(x, y, z):
        return np.asarray(foot, float) + (x - middle[0]) * along + (y - middle[1]) * across + z * UP

    def panel(*corners):
        return Polygon(name, [at(*corner) for corner in corners])

    return at, panel, across


def _flat(things):
    return [part for some in things for part in (some if isinstance(some, list) else [some])]
