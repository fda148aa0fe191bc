"""Parts of a simulated scene: flat patches, cylinders and foliage.

A part knows how to sample itself and what is true about it. All have the same interface, so a
scene is a list of parts (`benchmarks/simulators` has more of them):

- ``name``, ``area`` and ``bounds`` (2, 3);
- ``sample(n, rng)``: n points, uniform over the part, (n, 3);
- ``normals(points)``: unit normals on the seen side, NaN where there is none;
- ``distance(points)``: distance of any points to the part;
- ``edge_distance(points)``: distance to the part's sharp edges, inf if it has none;
- ``hit(origin, ends)``: where segments from one origin, or from one each (n, 3), first meet the
  part, as the fraction of the segment, inf where they miss;
- ``scatter(origin, ends, rng)``, of `Foliage` alone: where the segments end by chance;
- ``outline_length`` and ``sample_outline(n, rng, viewpoint)``: lines of the part behind which
  the background may start, as seen from a viewpoint.
"""

from abc import ABC, abstractmethod

import numpy as np


class Flat(ABC):
    """What flat parts have in common; ``_aside(flat)`` is the distance of points (n, 2) of the
    plane that are not on the part to it. Those with straight edges have `edges` and `border`."""

    corner: np.ndarray
    frame: np.ndarray  # its columns are two directions in the plane and the normal
    edges: np.ndarray  # sharp ones, as segments (m, 2, 2) in the plane
    border: np.ndarray  # all, as these

    @abstractmethod
    def _contains(self, flat):
        """Which of points (n, 2) of the plane are on the part."""

    @property
    def outline_length(self):
        return segment_lengths(self.edges).sum()

    def normals(self, points):
        return np.tile(self.frame[:, 2], (len(points), 1))

    def distance(self, points):
        local = (points - self.corner) @ self.frame
        aside = np.zeros(len(local))
        outside = ~self._contains(local[:, :2])
        aside[outside] = self._aside(local[outside, :2])
        return np.hypot(aside, local[:, 2])

    def edge_distance(self, points):
        local = (points - self.corner) @ self.frame
        return np.hypot(segments_distance(local[:, :2], self.edges), local[:, 2])

    def hit(self, origin, ends):
        start = np.broadcast_to((origin - self.corner) @ self.frame, ends.shape)
        way = (ends - self.corner) @ self.frame - start
        fraction = np.full(len(ends), np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -start[:, 2] / way[:, 2]
        crosses = np.flatnonzero((t > 0) & (t <= 1))
        t = t[crosses]
        inside = self._contains(start[crosses, :2] + t[:, None] * way[crosses, :2])
        fraction[crosses[inside]] = t[inside]
        return fraction

    def sample_outline(self, n, rng, viewpoint):
        return self._to_scene(sample_segments(self.edges, n, rng))

    def _aside(self, flat):
        return segments_distance(flat, self.border)

    def _to_scene(self, flat):
        return self.corner + flat @ self.frame[:, :2].T


class Patch(Flat):
    """Flat rectangle, with rectangular holes if wished.

    ``u x v`` of its two sides, at right angles, points to the seen side. Holes are (u0, u1, v0, v1)
    in meters from the corner. `smooth` names sides, of "u0", "u1", "v0", "v1", that are no sharp
    edges: the surface goes on, or only the scene ends. `circles` and `lines` (m, 2, 3) are more
    sharp edges: the feet of what stands on the patch.
    """

    def __init__(self, name, corner, u, v, *, holes=(), smooth=(), circles=(), lines=()):
        self.name = name
        self.corner = np.asarray(corner, float)
        u, v = np.asarray(u, float), np.asarray(v, float)
        self.size = np.array([np.linalg.norm(u), np.linalg.norm(v)])
        u, v = u / self.size[0], v / self.size[1]
        self.frame = np.column_stack([u, v, np.cross(u, v)])
        self.circles = tuple(circles)
        self.lines = np.asarray(lines, float).reshape(-1, 2, 3)

        # Holes cut the rectangle along grid lines; what is left is a set of whole cells.
        holes = np.asarray(holes, float).reshape(-1, 2, 2)
        self.cuts = [np.unique([0.0, self.size[i], *holes[:, i].ravel()]) for i in (0, 1)]
        low = np.stack(np.meshgrid(*(c[:-1] for c in self.cuts), indexing="ij"), axis=-1)
        high = np.stack(np.meshgrid(*(c[1:] for c in self.cuts), indexing="ij"), axis=-1)
        middle = 0.5 * (low + high)[..., None, :]
        cut_out = ((middle > holes[:, :, 0]) & (middle < holes[:, :, 1])).all(axis=-1)
        self.solid = ~cut_out.any(axis=-1)
        self.low, self.high = low[self.solid], high[self.solid]
        self.cell_areas = np.prod(self.high - self.low, axis=1)
        self.area = self.cell_areas.sum()

        self.border, sides = _cell_border(self.solid, cuts_u=self.cuts[0], cuts_v=self.cuts[1])
        self.edges = self.border[[side not in smooth for side in sides]]
        corners = self._to_scene(self.border.reshape(-1, 2))
        self.bounds = np.array([corners.min(axis=0), corners.max(axis=0)])

    def sample(self, n, rng):
        cell = rng.choice(len(self.low), size=n, p=self.cell_areas / self.area)
        low = self.low[cell]
        return self._to_scene(low + rng.random((n, 2)) * (self.high[cell] - low))

    def edge_distance(self, points):
        distance = super().edge_distance(points)
        for circle in self.circles:
            np.minimum(distance, circle.distance(points), out=distance)
        return np.minimum(distance, segments_distance(points, self.lines), out=distance)

    def _contains(self, flat):
        u, v = flat.T
        inside = (u >= 0) & (u <= self.size[0]) & (v >= 0) & (v <= self.size[1])
        cells = []
        for coordinate, cuts in zip((u, v), self.cuts, strict=True):
            cell = np.searchsorted(cuts, coordinate, side="right") - 1
            cells.append(np.clip(cell, 0, len(cuts) - 2))
        return inside & self.solid[tuple(cells)]


class Cylinder:
    """Round surface, whole (a pole) or an arc of it (a cambered road), seen from outside.

    `axis` leads from the base to the other end. The arc, in radians and right-handed around the
    axis, begins at the direction `start`, at right angles to the axis. `sharp` names its sharp
    edges: the circles at both ends, "base" and "top", and the straight sides of an arc, "start" and
    "stop". There is no lid: a scanner higher than a pole would look into it, so poles must be
    higher or get a lid.
    """

    def __init__(
        self, name, base, axis, radius, *, start=None, arc=2 * np.pi, sharp=("base", "top")
    ):
        self.name = name
        self.base = np.asarray(base, float)
        axis = np.asarray(axis, float)
        self.length = np.linalg.norm(axis)
        axis = axis / self.length
        if start is None:
            start = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        first = np.asarray(start, float) / np.linalg.norm(start)
        self.frame = np.column_stack([first, np.cross(axis, first), axis])
        self.radius, self.arc = float(radius), float(arc)
        self.whole = arc >= 2 * np.pi
        self.area = self.arc * self.radius * self.length
        self.circles = [
            Circle(self.base + end * axis, axis, radius)
            for name, end in (("base", 0.0), ("top", self.length))
            if name in sharp
        ]
        # Straight sides of the arc, as seen along the axis.
        self.sides = self.radius * np.array(
            [(np.cos(a), np.sin(a)) for n, a in (("start", 0.0), ("stop", arc)) if n in sharp]
        ).reshape(-1, 2)
        angle = np.linspace(0, self.arc, 721)
        ring = self.radius * (
            np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * self.frame[:, 1]
        )
        rings = self.base + np.concatenate([ring, ring + self.length * axis])
        self.bounds = np.array([rings.min(axis=0), rings.max(axis=0)])
        self.outline_length = 2 * self.length if self.whole else 0.0

    def sample(self, n, rng):
        angle = self.arc * rng.random(n)
        return self._to_scene(angle, self.length * rng.random(n))

    def normals(self, points):
        local = (points - self.base) @ self.frame
        radial = local[:, :2] / np.linalg.norm(local[:, :2], axis=1, keepdims=True)
        return radial @ self.frame[:, :2].T

    def distance(self, points):
        local = (points - self.base) @ self.frame
        aside = np.abs(np.hypot(local[:, 0], local[:, 1]) - self.radius)
        if not self.whole:
            outside = ~self._contains(local[:, 0], local[:, 1])
            ends = self.radius * np.array([[1.0, 0.0], [np.cos(self.arc), np.sin(self.arc)]])
            gaps = np.linalg.norm(local[outside, None, :2] - ends, axis=2)
            aside[outside] = gaps.min(axis=1)
        beyond = np.maximum(np.maximum(-local[:, 2], local[:, 2] - self.length), 0.0)
        return np.hypot(aside, beyond)

    def edge_distance(self, points):
        distance = np.full(len(points), np.inf)
        for circle in self.circles:
            np.minimum(distance, circle.distance(points), out=distance)
        local = (points - self.base) @ self.frame
        beyond = np.maximum(np.maximum(-local[:, 2], local[:, 2] - self.length), 0.0)
        for side in self.sides:
            aside = np.linalg.norm(local[:, :2] - side, axis=1)
            np.minimum(distance, np.hypot(aside, beyond), out=distance)
        return distance

    def hit(self, origin, ends):
        start = np.broadcast_to((origin - self.base) @ self.frame, ends.shape)
        way = (ends - self.base) @ self.frame - start
        fraction = np.full(len(ends), np.inf)
        a = np.einsum("ij,ij->i", way[:, :2], way[:, :2])
        b = np.einsum("ij,ij->i", way[:, :2], start[:, :2])
        c = np.einsum("ij,ij->i", start[:, :2], start[:, :2]) - self.radius**2
        root = b * b - a * c
        meets = np.flatnonzero((root >= 0) & (a > 0))
        a, b, root = a[meets], b[meets], np.sqrt(root[meets])
        start, way = start[meets], way[meets]
        for t in ((-b + root) / a, (-b - root) / a):  # the nearer one last: it overwrites
            place = start + t[:, None] * way
            on_part = (t > 0) & (t <= 1) & (place[:, 2] >= 0) & (place[:, 2] <= self.length)
            if not self.whole:
                on_part &= self._contains(place[:, 0], place[:, 1])
            fraction[meets[on_part]] = t[on_part]
        return fraction

    def sample_outline(self, n, rng, viewpoint):
        # The two lines where the rays from the viewpoint graze the cylinder.
        seen = (viewpoint - self.base) @ self.frame
        middle = np.arctan2(seen[1], seen[0])
        half = np.arccos(self.radius / np.hypot(seen[0], seen[1]))
        angle = middle + half * rng.choice([-1.0, 1.0], size=n)
        return self._to_scene(angle, self.length * rng.random(n))

    def _to_scene(self, angle, height):
        ring = self.radius * np.cos(angle), self.radius * np.sin(angle)
        return self.base + np.column_stack([*ring, height]) @ self.frame.T

    def _contains(self, first, second):
        return np.mod(np.arctan2(second, first), 2 * np.pi) <= self.arc


class Foliage:
    """Ball filled with leaves: points without surface, normal or edge, where rays end by chance.

    Its `area`, which sets its share of the points, is that of the half ball that a scanner sees.
    """

    clearing = 0.7  # how far a ray gets among the leaves, on average, in radii
    outline_length = 0.0

    def __init__(self, name, center, radius):
        self.name = name
        self.center = np.asarray(center, float)
        self.radius = float(radius)
        self.area = 2 * np.pi * radius**2
        self.bounds = np.array([self.center - radius, self.center + radius])

    def sample(self, n, rng):
        direction = rng.standard_normal((n, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        return self.center + self.radius * np.cbrt(rng.random((n, 1))) * direction

    def distance(self, points):
        return np.maximum(np.linalg.norm(points - self.center, axis=1) - self.radius, 0.0)

    def normals(self, points):
        return np.full((len(points), 3), np.nan)

    def edge_distance(self, points):
        return np.full(len(points), np.nan)

    def hit(self, origin, ends):
        return np.full(len(ends), np.inf)

    def scatter(self, origin, ends, rng):
        """Where segments end: as `hit`, but by chance."""
        way = ends - origin
        length = np.linalg.norm(way, axis=1)
        toward = np.broadcast_to(self.center - origin, way.shape)
        closest = np.einsum("ij,ij->i", way, toward) / length
        aside = np.einsum("ij,ij->i", toward, toward) - closest**2
        half = np.sqrt(np.maximum(self.radius**2 - aside, 0.0))
        depth = rng.exponential(self.clearing * self.radius, len(ends))
        met = np.maximum(closest - half, 0.0) + depth
        return np.where(met < closest + half, met / length, np.inf)


class Circle:
    """A round edge."""

    def __init__(self, center, axis, radius):
        self.center = np.asarray(center, float)
        self.axis = np.asarray(axis, float) / np.linalg.norm(axis)
        self.radius = float(radius)

    def distance(self, points):
        local = points - self.center
        height = local @ self.axis
        reach = np.linalg.norm(local - height[:, None] * self.axis, axis=1)
        return np.hypot(reach - self.radius, height)


def _cell_border(solid, cuts_u, cuts_v):
    """Border of a union of grid cells: segments (m, 2, 2) and the outer side each lies on."""
    filled = np.pad(solid, 1)
    segments, sides = [], []
    for i, j in np.argwhere(filled[1:, 1:-1] != filled[:-1, 1:-1]):  # across u
        segments.append([(cuts_u[i], cuts_v[j]), (cuts_u[i], cuts_v[j + 1])])
        sides.append("u0" if i == 0 else "u1" if i == len(cuts_u) - 1 else "")
    for i, j in np.argwhere(filled[1:-1, 1:] != filled[1:-1, :-1]):  # across v
        segments.append([(cuts_u[i], cuts_v[j]), (cuts_u[i + 1], cuts_v[j])])
        sides.append("v0" if j == 0 else "v1" if j == len(cuts_v) - 1 else "")
    return np.array(segments), sides


def segment_lengths(segments):
    return np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)


def sample_segments(segments, n, rng):
    """n points, uniform over segments (m, 2, d)."""
    lengths = segment_lengths(segments)
    start, end = segments[rng.choice(len(lengths), size=n, p=lengths / lengths.sum())].swapaxes(
        0, 1
    )
    return start + rng.random((n, 1)) * (end - start)


def segments_distance(points, segments):
    """Distance of points (n, d) to the nearest of segments (m, 2, d); inf without segments."""
    nearest = np.full(len(points), np.inf)
    for a, b in segments:
        way = b - a
        along = np.clip((points - a) @ way / (way @ way), 0.0, 1.0)
        gaps = points - a - along[:, None] * way
        np.minimum(nearest, np.einsum("ij,ij->i", gaps, gaps), out=nearest)
    return np.sqrt(nearest)


def _near(axes, squared, bounds):
    """Numbers of the segments, of some squared lengths, that pass through the ball around a box.

    `axes` are their starts and steps along x, y and z: no product of matrices, for which threads
    would start a thousand times. Most parts are met by few: this is ten times faster than hits.
    """
    center = (bounds[0] + bounds[1]) / 2
    radius = np.linalg.norm(bounds[1] - center)
    along, miss = np.zeros((2, len(squared)))
    for (start, step), middle in zip(axes, center, strict=True):
        along += (middle - start) * step
    along = np.clip(along / squared, 0.0, 1.0)
    for (start, step), middle in zip(axes, center, strict=True):
        miss += (start + along * step - middle) ** 2
    return np.flatnonzero(miss <= radius * radius * (1 + 1e-9))


def first_hits(parts, origin, ends, rng):
    """Where n segments from one origin, or from one each, end first.

    Of each segment the fraction, inf where it meets nothing, and the number of the part, or -1.
    """
    nearest, met = np.full(len(ends), np.inf), np.full(len(ends), -1)
    origin = np.broadcast_to(origin, ends.shape)
    way = ends - origin
    squared = np.einsum("ij,ij->i", way, way)
    axes = [(start.copy(), step.copy()) for start, step in zip(origin.T, way.T, strict=True)]
    for number, part in enumerate(parts):
        if isinstance(part, Foliage):  # draws for all segments, so that scans stay what they were
            rows, fraction = np.arange(len(ends)), part.scatter(origin, ends, rng)
        else:
            rows = _near(axes, squared, part.bounds)
            fraction = part.hit(origin[rows], ends[rows])
        nearer = fraction < nearest[rows]
        nearest[rows[nearer]], met[rows[nearer]] = fraction[nearer], number
    return nearest, met
