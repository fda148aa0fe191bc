"""Distances to creases, literally and slowly: the oracle of the tests of edges.

One point at a time, one pair of faces at a time, from the description in docs/edges.rst.
"""

from itertools import product
from math import gamma

import numpy as np

from reference_creases import off_quadric

CLIP, HUBER, FITS = 3.0, 1.5, 3


class LiteralCreases:
    """`scores` of all points, and the `evidence` for edges, nan where no second face is seen."""

    def __init__(self, points, planes, k, min_angle, on_surface):
        n, self.d = points.shape
        self.points, self.k, self.angle = points, k, min_angle
        gaps = [np.linalg.norm(points - x, axis=1) for x in points]
        self.near = [np.argsort(g, kind="stable")[:k] for g in gaps]
        self.reach = [g[near[-1]] for g, near in zip(gaps, self.near, strict=True)]
        # A cell that each point has: a ball of 8 neighbors in d - 1 dimensions, over 8.
        m = self.d - 1
        ball = np.pi ** (m / 2) / gamma(m / 2 + 1)
        eighth = [np.sort(g)[min(8, k - 1)] for g in gaps]
        spacing = [(ball * r**m / min(8, k - 1)) ** (1 / m) for r in eighth]
        noise = [max(s, 0.05 * c) for s, c in zip(planes.scale, spacing, strict=True)]
        for _ in range(3):  # twice for all, and once more where a plane is given
            spacing = [np.mean([spacing[j] for j in near]) for near in self.near]
        self.spacing = spacing
        ratios = [s / r for s, r in zip(noise, self.reach, strict=True)]
        flat = [ratio <= max(0.2, np.median(ratios)) for ratio in ratios]
        self.normal, self.level, self.scale = [], [], []
        self.asked, self.on_face, self.height, self.turned = [], [], [], []
        for i, x in enumerate(points):
            least = 0.05 * spacing[i]
            half = np.cos(np.radians(min_angle / 2))
            turns = [abs(planes.normals[i] @ planes.normals[j]) < half for j in self.near[i]]
            self.turned.append(np.mean(turns))
            j = i
            if any(turns):
                cost, j = min(
                    (self._unlikeliness(x, planes, noise[j], j, least), -where, j)
                    for where, j in enumerate(self.near[i])
                )[::2]
                assert np.isfinite(cost)
            near_surfaces = np.mean(on_surface[self.near[i]]) >= 0.25
            self.asked.append(any(turns) and flat[j] and near_surfaces)
            normal, level = planes.normals[j], planes.normals[j] @ planes.centroids[j]
            self.normal.append(normal)
            self.level.append(level)
            self.height.append(normal @ x - level)
            self.scale.append(noise[j])
            self.on_face.append(flat[j] and abs(self.height[-1]) <= CLIP * self.scale[-1])
        found = [self._crease(i) for i in range(n)]
        self.evidence = np.array([evidence for _, evidence in found])
        self.scores = np.array([self._told(i, found[i][0]) for i in range(n)])

    def _unlikeliness(self, x, planes, noise, j, least):
        """Of a point under a plane, by Bayes' rule; infinite beyond the plane's reach."""
        gap = x - planes.centroids[j]
        if np.linalg.norm(gap) > self.reach[j]:
            return np.inf
        variance = noise**2 + least**2
        return 0.5 * (np.log(variance) + (gap @ planes.normals[j]) ** 2 / variance)

    def _differ(self, a, b):
        return abs(self.normal[a] @ self.normal[b]) < np.cos(np.radians(self.angle))

    def _crease(self, i):
        """Distance to the nearest crease in spacings, and the evidence."""
        near = self.near[i]
        others = [j for j in near if self.on_face[j] and self._differ(i, j)]
        if len(others) < self.d or not self.asked[i]:
            return np.inf, np.nan
        limit = CLIP * self.scale[i]

        def squares(residuals):
            return np.mean([min(abs(r), limit) ** 2 for r in residuals])

        def half_bic(residuals, n_numbers):
            value = squares(residuals) + np.finfo(float).tiny
            return 0.5 * (self.k * np.log(value) + n_numbers * np.log(self.k))

        own = self._heights(i, near)
        two, second, side, joins = self._joined(own, others, near, squares)
        distance, cost = self._to_line(i, second), half_bic(two, self.d)
        arcs = [(i, 1, second, side, joins)]
        others = [j for j in others if self._differ(second, j)]
        if others:
            three, third, side_of_third, joins = self._joined(two, others, near, squares)
            arcs += [(a, of, third, side_of_third, joins) for a, of in ((i, 1), (second, side))]
            # BIC counts the d numbers of a third plane.
            if half_bic(three, 2 * self.d) < cost:
                distance = min(distance, self._to_line(i, third))
                cost = half_bic(three, 2 * self.d)
        if self.k <= self.d + self.d * (self.d - 1) // 2 + 1:
            return distance, -1.0
        X = self.points[near]
        smooth = [half_bic(self._quadric(X, self.scale[i]), self.d + self.d * (self.d - 1) // 2)]
        smooth.append(half_bic(self._cylinder(X, near, self.scale[i]), 3))
        for *faces, joins in arcs:
            for radius in (1.0, 1.5, 2.0, 3.0, 4.0):
                up = 1 if joins is np.maximum else -1
                arc = self._arc(*faces, near, up, radius * self.spacing[i])
                smooth.append(half_bic(arc, self.d + 1))
        return distance, cost - min(smooth)

    def _heights(self, j, near):
        return np.array([self.normal[j] @ self.points[a] - self.level[j] for a in near])

    def _joined(self, surface, others, near, squares):
        """The half planes of one more face that leave least, whose plane it is, its sign, and which
        of both heights counts."""
        best = None
        for j in others:
            heights = self._heights(j, near)
            for sign, limit in product((1, -1), (np.maximum, np.minimum)):
                joined = limit(surface, sign * heights)
                if best is None or squares(joined) < best[0] * (1 - 1e-12):
                    best = squares(joined), joined, j, sign, limit
        return best[1:]

    def _to_line(self, i, j):
        """From the point, moved to its own plane, to the line of both planes, along its plane."""
        cosine = self.normal[i] @ self.normal[j]
        height = self.normal[j] @ self.points[i] - self.level[j]
        return abs(height) / np.sqrt(1 - cosine**2) / self.spacing[i]

    def _quadric(self, X, scale):
        """Residuals to a polynomial of second order over the plane of most variance."""
        local = X - X.mean(axis=0)
        local = local @ np.linalg.eigh(local.T @ local)[1]
        weights = np.ones(len(local))
        for _ in range(FITS):
            residuals = np.abs(off_quadric(local[:, 1:], local[:, 0], weights))
            weights = np.array([min(1.0, HUBER * scale / r) for r in residuals])
        return residuals

    def _cylinder(self, X, near, scale):
        """Residuals to a circle in the two directions in which the normals vary most."""
        normals = np.array([self.normal[j] for j in near])
        flat = (X - X.mean(axis=0)) @ np.linalg.eigh(normals.T @ normals)[1][:, -2:]
        terms = np.column_stack([2 * flat, np.ones(len(flat))])
        x, y, rest = np.linalg.lstsq(terms, (flat**2).sum(axis=1), rcond=None)[0]
        model = np.array([x, y, np.sqrt(max(rest + x * x + y * y, 0))])
        for step in range(FITS + 1):
            gaps = flat - model[:2]
            away = np.linalg.norm(gaps, axis=1)
            residuals = away - model[2]
            if step < FITS:
                root = np.sqrt([min(1.0, HUBER * scale / abs(r)) for r in residuals])
                slopes = np.column_stack([gaps / away[:, None], np.ones(len(gaps))])
                model += np.linalg.lstsq(slopes * root[:, None], residuals * root, rcond=None)[0]
        return residuals

    def _arc(self, a, of_a, b, of_b, near, up, radius):
        """Residuals to two half planes with an arc in place of the crease, by plane geometry."""
        one, two = up * of_a * self.normal[a], up * of_b * self.normal[b]
        across = np.linalg.svd(np.stack([one, two]))[2][:2]  # a base of what both normals span
        flat_one, flat_two = across @ one, across @ two
        levels = np.array([up * of_a * self.level[a], up * of_b * self.level[b]])
        center = np.linalg.solve(np.stack([flat_one, flat_two]), levels - radius)
        residuals = []
        for x in self.points[near]:
            gap = across @ x - center
            # Between the two normals it is the arc that is nearest.
            shares = np.linalg.solve(np.column_stack([flat_one, flat_two]), gap)
            away = (
                np.linalg.norm(gap) if (shares > 0).all() else max(gap @ flat_one, gap @ flat_two)
            )
            residuals.append(away - radius)
        return residuals

    def _told(self, i, distance):
        """The distance, larger where neighbors vote for no edge, and off the plane."""
        most = 10 * (2 - self.turned[i])
        votes = [self.evidence[j] for j in self.near[i] if np.isfinite(self.evidence[j])]
        if not votes or not np.isfinite(distance):
            return most
        off = max(abs(self.height[i]) / (CLIP * self.scale[i]), 1.0)
        return min(distance * np.exp(min(max(np.median(votes), 0), 36.04365)) * off, most)
