"""Surfaces: large connected parts of flat planes that explain each other, of any density."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import are_flat
from sklearn_mcmd.planes._explaining import ExplainLimits, LinkLimits, connected_planes, explain
from sklearn_mcmd.planes._local_planes import LocalPlaneModel
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._rules import small_sample_inflation
from sklearn_mcmd.runtime._chunks import each_slice, run, slices


class SurfaceLimits(NamedTuple):
    """What a surface is."""

    # Largest ratio of a plane's standard deviation to the radius of its neighborhood. A filled
    # ball has 0.45: a third of that.
    flat: float = 0.15
    angle: float = 25.0  # largest angle between the normals of linked points, in degrees
    n_links: int = 16  # linked points are among each other's nearest, this many
    # A surface has as many points as a neighborhood: fewer cannot fill that of a plane of their
    # own. In a small cloud surfaces and things have this share of it.
    least_share: float = 1 / 5


class MeasuringPlanes(NamedTuple):
    """The planes of the n points of a model's index, from which distances are measured."""

    model: LocalPlaneModel
    planes: Planes  # their scale is the noise by which distances are measured
    n_jobs: int | None

    @classmethod
    def of(cls, model, planes, noise_scale, n_jobs):
        """By a stated noise, in units of the points, or with None by that of each plane."""
        (n, d), k = model.index.points.shape, model.index.n_neighbors
        if noise_scale is not None:
            planes = planes._replace(scale=np.full(n, noise_scale))
        elif n <= k:
            # All points share one plane. In larger clouds each has several, and the nearest
            # counts, which makes up for a scale of few points being too small.
            inflation = small_sample_inflation(d, np.rint(planes.kept * n), n)
            planes = planes._replace(scale=planes.scale * inflation)
        return cls(model, planes.without("kept"), n_jobs)

    def rounding(self, queries, precision=0.0):
        """What rounding of the coordinates adds to the noise at each query: (m,)."""
        return max(self.model.rounding, 8 * precision) * np.abs(queries).max(axis=1)

    def from_own(self):
        """Distances (n,) of the points from their own planes, in standard deviations."""
        points = self.model.index.points
        distances = np.empty(len(points))

        def measure(rows):
            planes, queries = self.planes.take(rows), points[rows]
            heights = np.einsum("md,md->m", queries - planes.centroids, planes.normals)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                noise = np.hypot(planes.scale, self.rounding(queries))
                distances[rows] = np.nan_to_num(np.abs(heights) / noise, nan=0.0)

        run([(rows,) for rows in slices(len(points), self.model.chunk())], measure, self.n_jobs)
        return distances

    def nearest(self, queries, neighbors_of, usable, precision=0.0):
        """The nearest of the usable planes among each query's neighbors: its row, and the distance.

        The row is -1 where none reaches the query, and the distance inf; it is in standard
        deviations. ``neighbors_of(rows)`` gives the `Neighborhoods` of a slice of queries.
        """
        m, floor = len(queries), self.rounding(queries, precision)
        owners, distances = np.full(m, -1, np.int32), np.full(m, np.inf)

        def measure(rows):
            owners[rows], distances[rows] = explain(
                queries[rows], neighbors_of(rows), self.planes, usable, floor[rows]
            )

        each_slice(m, self.model.chunk(), measure, self.n_jobs)
        return owners, distances


def find_surfaces(index, planes, usable, least, counting=None, bend=1.0):
    """Which points form surfaces: bool (n,).

    Two points, which are `usable`, bool (n,), are linked if they are near each other, their planes
    explain each other's point and their normals agree, within `bend` of the usual angle. A surface
    is a connected part of at least `least` points, or of so many that are `counting`, bool (n,).
    """
    links = LinkLimits(
        min_cosine=float(np.cos(np.radians(bend * SurfaceLimits().angle))),
        explained=ExplainLimits().explained,
        max_gap=np.inf,
        mutual=True,
        both_near=True,
    )
    k = min(SurfaceLimits().n_links, index.n_neighbors)
    labels, sizes = connected_planes(index, k, planes, links, usable)
    if counting is not None:
        sizes = np.bincount(labels, counting)
    return usable & (sizes >= least)[labels]


def least_surface(n_neighbors, n):
    """Points that a surface has at least, of neighborhoods among n points."""
    return min(n_neighbors, SurfaceLimits().least_share * n)


def are_usable(planes, distances):
    """Which points may be part of a surface, bool (n,): their planes are flat and explain the point
    itself. `distances` (n,) are those from their own planes, in standard deviations."""
    return are_flat(planes, SurfaceLimits().flat) & (distances <= ExplainLimits().explained)
