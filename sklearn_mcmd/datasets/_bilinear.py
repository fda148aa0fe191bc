"""Bilinear surfaces: a part of a simulated scene with the interface that `_surfaces` describes."""

import numpy as np

from sklearn_mcmd.datasets._surfaces import segments_distance

_AREA_CELLS = 64  # on a side of the grid for the area of a bilinear surface
_START_CELLS = 6  # on a side of the grid from which the nearest of its points is sought
_STEPS = 25  # of that search


class Bilinear:
    """Ruled surface through four corners, S(u, v) = p + u a + v b + u v c on the unit square.

    Both families of lines are straight, and so are the four sides. The corners are S(0, 0),
    S(1, 0), S(1, 1), S(0, 1), counterclockwise as seen from the seen side. `smooth` has the numbers
    of sides that are no sharp edges; side i leaves corner i.
    """

    def __init__(self, name, corners, *, smooth=()):
        self.name = name
        corners = np.asarray(corners, float)
        self.start, self.a, self.b = corners[0], corners[1] - corners[0], corners[3] - corners[0]
        self.c = corners[2] - corners[1] - corners[3] + corners[0]
        self.border = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        self.edges = self.border[[i not in smooth for i in range(4)]]
        middle = (np.arange(_AREA_CELLS) + 0.5) / _AREA_CELLS
        u, v = (grid.ravel() for grid in np.meshgrid(middle, middle))
        self.area = np.linalg.norm(self._cross_product(u, v), axis=1).mean()
        # Linear in u and v, so its length is greatest at a corner.
        u, v = np.array([0.0, 1, 0, 1]), np.array([0.0, 0, 1, 1])
        self._largest = np.linalg.norm(self._cross_product(u, v), axis=1).max()
        self.bounds = np.array([corners.min(axis=0), corners.max(axis=0)])

    def sample(self, n, rng):
        kept, missing = [np.empty((0, 3))], n
        while missing > 0:
            u, v, level = rng.random((3, 2 * missing + 16))
            even = level * self._largest < np.linalg.norm(self._cross_product(u, v), axis=1)
            kept.append(self._surface(u, v)[even][:missing])
            missing -= len(kept[-1])
        return np.concatenate(kept)

    def normals(self, points):
        u, v = self._foot(points)
        normals = self._cross_product(u, v)
        return normals / np.linalg.norm(normals, axis=1, keepdims=True)

    def distance(self, points):
        # Nearest is a foot within the surface or a point of its straight sides.
        nearest = segments_distance(points, self.border)
        u, v = self._foot(points)
        within = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
        gap = np.linalg.norm(self._surface(u, v) - points, axis=1)
        return np.where(within, np.minimum(gap, nearest), nearest)

    def edge_distance(self, points):
        return segments_distance(points, self.edges)

    def hit(self, origin, ends):
        return np.full(len(ends), np.inf)  # roofs are seen from above: no part hides another

    def _surface(self, u, v):
        u, v = u[:, None], v[:, None]
        return self.start + u * self.a + v * self.b + u * v * self.c

    def _cross_product(self, u, v):
        return np.cross(self.a + v[:, None] * self.c, self.b + u[:, None] * self.c)

    def _foot(self, points):
        """Parameters of the foot of each point on the unbounded surface: Gauss-Newton."""
        grid = (np.arange(_START_CELLS) + 0.5) / _START_CELLS
        starts = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
        gaps = points[:, None] - self._surface(starts[:, 0], starts[:, 1])
        u, v = starts[np.einsum("nsi,nsi->ns", gaps, gaps).argmin(axis=1)].T
        for _ in range(_STEPS):
            along_u, along_v = self.a + v[:, None] * self.c, self.b + u[:, None] * self.c
            gap = points - self._surface(u, v)
            uu = np.einsum("ij,ij->i", along_u, along_u)
            vv = np.einsum("ij,ij->i", along_v, along_v)
            # The full second derivative, so that far points converge as well.
            uv = np.einsum("ij,ij->i", along_u, along_v) - gap @ self.c
            gu = np.einsum("ij,ij->i", along_u, gap)
            gv = np.einsum("ij,ij->i", along_v, gap)
            determinant = uu * vv - uv * uv
            good = determinant > 1e-9 * uu * vv
            determinant = np.where(good, determinant, 1.0)
            step_u = np.where(good, (vv * gu - uv * gv) / determinant, gu / uu)
            step_v = np.where(good, (uu * gv - uv * gu) / determinant, gv / vv)
            u = np.clip(u + np.clip(step_u, -0.5, 0.5), -1.0, 2.0)
            v = np.clip(v + np.clip(step_v, -0.5, 0.5), -1.0, 2.0)
        return u, v
