"""A scene: a row of equal bays. Each has the same parts and its own scanner."""

from functools import cached_property

import numpy as np

_N_QUADRATURE = 1 << 16  # points of sums over a bay's visible surface; the error is about 0.3 %


class Scene:
    """A row of bays along x, all copies of the first.

    The bays are equal, and each is scanned from within. So all arithmetic is done in one bay's
    coordinates, and the cost per point does not grow with the length of the scene. Parts and
    scanner are those of the first bay, within 0 <= x <= `bay_length`; `displacement` is the
    standard deviation of "gaussian" outliers on each axis.
    """

    def __init__(self, parts, bay_length, n_bays, scanner, *, displacement=0.2):
        self.parts = parts
        self.displacement = displacement
        self.bay_length = float(bay_length)
        self.n_bays = n_bays
        self.scanner = np.asarray(scanner, float)
        low = np.min([part.bounds[0] for part in parts], axis=0)
        high = np.max([part.bounds[1] for part in parts], axis=0)
        self.bay_bounds = np.array([low, high])
        self.areas = np.array([part.area for part in parts])
        self.nearest_range = min(part.distance(self.scanner[None])[0] for part in parts)
        self.farthest_range = max(
            np.linalg.norm(np.abs(part.bounds - self.scanner).max(axis=0)) for part in parts
        )

    @property
    def length(self):
        return self.n_bays * self.bay_length

    @property
    def bounds(self):
        bounds = self.bay_bounds.copy()
        bounds[1, 0] += self.length - self.bay_length
        return bounds

    @property
    def scanners(self):
        return self.to_scene(np.tile(self.scanner, (self.n_bays, 1)), np.arange(self.n_bays))

    def to_scene(self, local, bay):
        """Move points from the first bay to the given ones."""
        shift = np.zeros_like(local)
        shift[:, 0] = bay * self.bay_length
        return local + shift

    def to_bay(self, points):
        """Points in the coordinates of their bay, and the bay. The end bays have no outer limit."""
        bay = np.clip((points[:, 0] // self.bay_length).astype(int), 0, self.n_bays - 1)
        return self.to_scene(points, -bay), bay

    def distance(self, points):
        """Distance of any points (n, 3) to the nearest part of the scene."""

        def in_bay(local):
            return np.min([part.distance(local) for part in self.parts], axis=0)

        return self.over_bays(in_bay, *self.to_bay(points))

    def over_bays(self, distance, local, bay):
        """The least distance over all bays, from a function of one bay's coordinates.

        Besides the own bay, only the next one on each side can be the nearest, since all bays are
        copies. It is tried only if its border is nearer than the distance found so far.
        """
        nearest = distance(local)
        for step, gap in ((-1, local[:, 0]), (1, self.bay_length - local[:, 0])):
            other = bay + step
            closer = (other >= 0) & (other < self.n_bays) & (gap < nearest)
            if closer.any():
                moved = self.to_scene(local[closer], -step)
                nearest[closer] = np.minimum(nearest[closer], distance(moved))
        return nearest

    def ranges(self, local):
        """Of points of a bay, from its scanner."""
        return np.linalg.norm(local - self.scanner, axis=1)

    def growth(self, ranges, far_over_near):
        """Factor that grows linearly with range, from 1 at the nearest surface of a bay."""
        share = (ranges - self.nearest_range) / (self.farthest_range - self.nearest_range)
        return 1.0 + (far_over_near - 1.0) * np.clip(share, 0.0, 1.0)

    def first_hit(self, ends):
        """First meeting of the rays scanner -> ends (n, 3) with a bay, as a fraction, or inf."""
        nearest = np.full(len(ends), np.inf)
        for part in self.parts:
            np.minimum(nearest, part.hit(self.scanner, ends), out=nearest)
        return nearest

    def visible(self, local, tolerance=1e-6):
        """Whether the scanner sees the points (n, 3) of a bay's surfaces."""
        return (1.0 - self.first_hit(local)) * self.ranges(local) <= tolerance

    def sample(self, n, rng):
        """n points that the scanners see, in bay coordinates, with the number of their part."""
        kept, labels, missing = [], [], n
        acceptance = self.seen_area / self.areas.sum()
        while missing > 0:
            m = int(1.05 * missing / acceptance) + 64
            counts = rng.multinomial(m, self.areas / self.areas.sum())
            points = [p.sample(c, rng) for p, c in zip(self.parts, counts, strict=True)]
            points, label = np.concatenate(points), np.repeat(np.arange(len(counts)), counts)
            rng.random(m)  # as many numbers as ever, so that scenes stay what they were
            # The points come in the order of the parts, so a plain cut would leave out the last.
            chosen = rng.permutation(np.flatnonzero(self.visible(points)))[:missing]
            kept.append(points[chosen])
            labels.append(label[chosen])
            missing -= len(chosen)
        return np.concatenate(kept), np.concatenate(labels)

    @cached_property
    def seen_area(self):
        """Area of a bay's seen surface in m^2, summed over points of a fixed seed."""
        rng = np.random.default_rng(0)
        counts = np.maximum(_N_QUADRATURE * self.areas / self.areas.sum(), 256).astype(int)
        points = np.concatenate([p.sample(c, rng) for p, c in zip(self.parts, counts, strict=True)])
        weights = np.repeat(self.areas / counts, counts)
        return float(weights[self.visible(points)].sum())
