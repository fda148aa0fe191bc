"""Soft parts of a simulated scene: crowns of trees and grass.

They have the interface that `_surfaces` describes, without what only uniform sampling needs.
"""

import numpy as np

from sklearn_mcmd.datasets._surfaces import Foliage, Patch, Soft

from ._things import capped

_LONGEST_BLADE = 3.0  # no blade of grass is higher, in the grass's height
_WAVES, _SWING = (1.3, 1.7), 0.5  # of the height of grass, in meters, and how far it swings


class Crown(Soft):
    """Crown of a tree: balls of leaves (`Foliage`), which may overlap."""

    def __init__(self, name, balls):
        self.name = name
        self.balls = balls
        bounds = np.array([ball.bounds for ball in balls])
        self.bounds = np.array([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])

    def distance(self, points):
        return np.min([ball.distance(points) for ball in self.balls], axis=0)

    def scatter(self, origin, ends, rng):
        return np.min([ball.scatter(origin, ends, rng) for ball in self.balls], axis=0)


class Grass(Soft):
    """Flat ground under grass: rays end on blades, whose heights follow a Rayleigh distribution.

    The ground is as in `Patch`. `height` is the root mean square of the blades' heights, from which
    waves deviate, in meters; no blade is higher than three times this.
    """

    def __init__(self, name, corner, u, v, height):
        self.name = name
        self.ground = Patch(name, corner, u, v)
        self.height = float(height)
        self.bounds = self.ground.bounds + np.array([[0.0], [_LONGEST_BLADE * height]])

    def distance(self, points):
        up = (points - self.ground.corner) @ self.ground.frame[:, 2]
        foot = points - np.clip(up, 0.0, _LONGEST_BLADE * self.height)[:, None] * self._up
        return self.ground.distance(foot)

    def scatter(self, origin, ends, rng):
        fraction = self.ground.hit(origin, ends)
        down = np.flatnonzero(np.isfinite(fraction))
        start = np.broadcast_to(origin, ends.shape)[down]
        way = ends[down] - start
        local = (start + fraction[down, None] * way - self.ground.corner) @ self.ground.frame
        swing = np.prod(np.sin(2 * np.pi * local[:, :2] / _WAVES), axis=1)
        blade = self.height * (1 + _SWING * swing) * np.sqrt(rng.exponential(size=len(down)))
        blade = np.minimum(blade, _LONGEST_BLADE * self.height)
        met = fraction[down] + blade / (way @ self._up)  # upward of the ground: way falls
        place = start + met[:, None] * way
        on_part = (met > 0) & (self.ground.distance(place - blade[:, None] * self._up) < 1e-6)
        fraction[down] = np.where(on_part, met, np.inf)
        return fraction

    @property
    def _up(self):
        return self.ground.frame[:, 2]


def leaves(name, middle, half, n_balls, radius, rng):
    """A crown of balls of leaves that stay in an ellipsoid, by its middle and half axes.

    `radius` is the mean of the balls' radii, which vary by 30 %.
    """
    direction = rng.standard_normal((n_balls, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    radii = radius * rng.uniform(0.7, 1.3, (n_balls, 1))
    room = np.maximum(np.asarray(half) - radii, 0.0)
    centers = np.asarray(middle) + np.cbrt(rng.random((n_balls, 1))) * direction * room
    return Crown(name, [Foliage(name, c, r) for c, r in zip(centers, radii[:, 0], strict=True)])


def tree(name, foot, height, width, rng):
    """A trunk and a crown that fills the upper 65 % of the height."""
    foot, low = np.asarray(foot, float), 0.35 * height
    middle = foot + np.array([0.0, 0.0, (low + height) / 2])
    half = np.array([width, width, height - low]) / 2
    trunk = capped(f"{name}_trunk", foot, 0.03 * width + 0.05, middle[2] - foot[2])
    return [*trunk, leaves(name, middle, half, 14, 0.22 * width, rng)]


def hedge(name, corner, size, rng):
    """A hedge in a box: balls of leaves in a row, as high as it."""
    size = np.asarray(size, float)
    n_balls = int(np.ceil(3 * size[0] / size[2]))
    places = np.asarray(corner) + size * [1.0, 0.5, 0.5] * np.column_stack(
        [(np.arange(n_balls) + 0.5) / n_balls, np.ones((n_balls, 2))]
    )
    radii = 0.5 * size[2] * rng.uniform(0.8, 1.0, n_balls)
    return Crown(name, [Foliage(name, c, r) for c, r in zip(places, radii, strict=True)])
