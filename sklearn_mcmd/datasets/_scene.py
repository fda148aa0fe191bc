"""A scene: parts, and the scanner that sees them."""

from functools import cached_property

import numpy as np

_N_QUADRATURE = 1 << 16  # points of sums over the visible surface; the error is about 0.3 %


class Scene:
    """Parts that are scanned from one place.

    `displacement` is the standard deviation of "gaussian" outliers on each axis.
    """

    def __init__(self, parts, scanner, *, displacement=0.2):
        self.parts = parts
        self.displacement = displacement
        self.scanner = np.asarray(scanner, float)
        low = np.min([part.bounds[0] for part in parts], axis=0)
        high = np.max([part.bounds[1] for part in parts], axis=0)
        self.bounds = np.array([low, high])
        self.areas = np.array([part.area for part in parts])
        self.farthest_range = max(
            np.linalg.norm(np.abs(part.bounds - self.scanner).max(axis=0)) for part in parts
        )

    def distance(self, points):
        """Distance of any points (n, 3) to the nearest part of the scene."""
        return np.min([part.distance(points) for part in self.parts], axis=0)

    def ranges(self, points):
        """Of points, from the scanner."""
        return np.linalg.norm(points - self.scanner, axis=1)

    def first_hit(self, ends):
        """First meeting of the rays scanner -> ends (n, 3) with a part, as a fraction, or inf."""
        return np.min([part.hit(self.scanner, ends) for part in self.parts], axis=0)

    def visible(self, points, tolerance=1e-6):
        """Whether the scanner sees the points (n, 3) of surfaces."""
        return (1.0 - self.first_hit(points)) * self.ranges(points) <= tolerance

    def sample(self, n, rng):
        """n points that the scanner sees, with the number of their part."""
        kept, labels, missing = [], [], n
        acceptance = self.seen_area / self.areas.sum()
        while missing > 0:
            m = int(1.05 * missing / acceptance) + 64
            counts = rng.multinomial(m, self.areas / self.areas.sum())
            of_parts = [p.sample(c, rng) for p, c in zip(self.parts, counts, strict=True)]
            points, label = np.concatenate(of_parts), np.repeat(np.arange(len(counts)), counts)
            rng.random(m)  # as many numbers as ever, so that scenes stay what they were
            # The points come in the order of the parts, so a plain cut would leave out the last.
            chosen = rng.permutation(np.flatnonzero(self.visible(points)))[:missing]
            kept.append(points[chosen])
            labels.append(label[chosen])
            missing -= len(chosen)
        return np.concatenate(kept), np.concatenate(labels)

    @cached_property
    def seen_area(self):
        """Area of the seen surface in m^2, summed over points of a fixed seed."""
        rng = np.random.default_rng(0)
        counts = np.maximum(_N_QUADRATURE * self.areas / self.areas.sum(), 256).astype(int)
        points = np.concatenate([p.sample(c, rng) for p, c in zip(self.parts, counts, strict=True)])
        weights = np.repeat(self.areas / counts, counts)
        return float(weights[self.visible(points)].sum())
