"""Polygons and discs: more parts of a simulated scene, as `sklearn_mcmd.datasets._surfaces` has."""

import numpy as np

from sklearn_mcmd.datasets._surfaces import Circle, Flat


class Polygon(Flat):
    """Flat convex polygon, by corners (m, 3) counterclockwise as seen from the seen side."""

    def __init__(self, name, corners):
        self.name = name
        corners = np.asarray(corners, float)
        self.corner = corners[0]
        u = corners[1] - corners[0]
        normal = np.cross(u, corners[2] - corners[0])
        u, normal = u / np.linalg.norm(u), normal / np.linalg.norm(normal)
        self.frame = np.column_stack([u, np.cross(normal, u), normal])
        self.flat = ((corners - self.corner) @ self.frame)[:, :2]
        self.border = self.edges = np.stack([self.flat, np.roll(self.flat, -1, axis=0)], axis=1)
        self.fan = np.stack(
            [np.broadcast_to(self.flat[0], self.flat[2:].shape), self.flat[1:-1], self.flat[2:]],
            axis=1,
        )
        self.areas = 0.5 * _cross(self.fan[:, 1] - self.fan[:, 0], self.fan[:, 2] - self.fan[:, 0])
        self.area = self.areas.sum()
        self.bounds = np.array([corners.min(axis=0), corners.max(axis=0)])

    def sample(self, n, rng):
        origin, b, c = self.fan[
            rng.choice(len(self.fan), size=n, p=self.areas / self.area)
        ].swapaxes(0, 1)
        u, v = rng.random((2, n, 1))
        beyond = u + v > 1
        u, v = np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)
        return self._to_scene(origin + u * (b - origin) + v * (c - origin))

    def _contains(self, flat):
        inside = np.ones(len(flat), dtype=bool)
        for a, b in self.border:
            inside &= _cross(b - a, flat - a) >= 0
        return inside


class Disc(Flat):
    """Flat disc: the lid of a cylinder, a round sign."""

    def __init__(self, name, center, normal, radius):
        self.name = name
        self.corner = np.asarray(center, float)
        normal = np.asarray(normal, float) / np.linalg.norm(normal)
        u = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        u /= np.linalg.norm(u)
        self.frame = np.column_stack([u, np.cross(normal, u), normal])
        self.radius = float(radius)
        self.rim = Circle(self.corner, normal, radius)
        self.area = np.pi * self.radius**2
        reach = self.radius * np.sqrt(1 - normal**2)
        self.bounds = np.array([self.corner - reach, self.corner + reach])

    @property
    def outline_length(self):
        return 2 * np.pi * self.radius

    def edge_distance(self, points):
        return self.rim.distance(points)

    def sample(self, n, rng):
        squared = rng.uniform(0, self.radius**2, n)
        return self._round(np.sqrt(squared), rng.uniform(0, 2 * np.pi, n))

    def sample_outline(self, n, rng, viewpoint):
        rng.random(n)  # as many numbers as ever, so that scenes stay what they were
        return self._round(np.full(n, self.radius), rng.uniform(0, 2 * np.pi, n))

    def _contains(self, flat):
        return np.hypot(flat[:, 0], flat[:, 1]) <= self.radius

    def _aside(self, flat):
        return np.hypot(flat[:, 0], flat[:, 1]) - self.radius

    def _round(self, radius, angle):
        return self._to_scene(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def _cross(a, b):
    """Cross product of vectors (..., 2) in the plane."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
