"""Surfaces: large connected parts of flat planes that explain each other, of any density."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import are_flat
from sklearn_mcmd.planes._explaining import ExplainLimits, LinkLimits, connected_planes


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


def find_surfaces(index, planes, usable, least):
    """Which points form surfaces: bool (n,).

    Two points, which are `usable`, bool (n,), are linked if they are near each other, their planes
    explain each other's point and their normals agree. A surface is a connected part of at least
    `least` points.
    """
    links = LinkLimits(
        min_cosine=float(np.cos(np.radians(SurfaceLimits().angle))),
        explained=ExplainLimits().explained,
        max_gap=np.inf,
        mutual=True,
        both_near=True,
    )
    k = min(SurfaceLimits().n_links, index.n_neighbors)
    labels, sizes = connected_planes(index, k, planes, links, usable)
    return usable & (sizes >= least)[labels]


def least_surface(n_neighbors, n):
    """Points that a surface has at least, of neighborhoods among n points."""
    return min(n_neighbors, SurfaceLimits().least_share * n)


def are_usable(planes, distances):
    """Which points may be part of a surface, bool (n,): their planes are flat and explain the point
    itself. `distances` (n,) are those from their own planes, in standard deviations."""
    return are_flat(planes, SurfaceLimits().flat) & (distances <= ExplainLimits().explained)


def own_distances(queries, planes, floor):
    """Distances of queries (m, d) from the plane of the same row, in standard deviations."""
    heights = np.einsum("md,md->m", queries - planes.centroids, planes.normals)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.nan_to_num(np.abs(heights) / np.hypot(planes.scale, floor), nan=0.0)
