"""The face that each point lies on: the plane under which it is most likely, and its noise."""

from typing import NamedTuple

import numpy as np
from scipy.special import gamma

from sklearn_mcmd.planes._around import are_flat
from sklearn_mcmd.planes._explaining import ExplainLimits, explain


class FaceLimits(NamedTuple):
    """What a face is."""

    n_spacing: int = 8  # neighbors that tell the spacing, or all if fewer
    least_noise: float = 0.05  # share of the spacing: a point is not known better
    # Most noise, as a share of its radius. It is more than that of surfaces in the search for
    # outliers, 0.15: a face that passes for foliage costs edges, but little foliage is left in a
    # cleaned cloud.
    flat: float = 0.2


class Faces(NamedTuple):
    """The plane given to each of m points."""

    normals: np.ndarray  # (m, d)
    levels: np.ndarray  # (m,), as all below: n . x of the plane's points
    height: np.ndarray  # of the point above its plane
    scale: np.ndarray  # standard deviation of the noise
    spacing: np.ndarray  # of the points around
    flat: np.ndarray  # bool: whether the plane is that of a face, not of foliage or a cluster
    on_face: np.ndarray  # bool: whether the point lies on such a plane

    @classmethod
    def empty(cls, m, d, make=np.empty):
        """A record to be filled, of arrays that `make` makes."""
        numbers, answers = (make(m) for _ in range(4)), (make(m, bool) for _ in range(2))
        return cls(make((m, d)), *numbers, *answers)

    def take(self, rows):
        """The planes of some of the points."""
        return Faces(*(values[rows] for values in self))

    def put(self, rows, part):
        """Overwrite the planes of some of the points."""
        for values, some in zip(self, part, strict=True):
            values[rows] = some


def measure_spacing(points, queries, around, scale):
    """Spacing of the points around each query, how far they reach, and its plane's noise: no plane
    is known better. The spacing is the side of the cell that one point of a surface takes."""
    gaps, flat = points[around.indices] - queries[:, None], points.shape[1] - 1
    distances = np.sqrt(np.einsum("mkd,mkd->mk", gaps, gaps))
    n = min(FaceLimits().n_spacing, distances.shape[1] - 1)
    ball = np.pi ** (0.5 * flat) / gamma(0.5 * flat + 1.0)
    spacing = np.partition(distances, n, axis=1)[:, n] * (ball / n) ** (1.0 / flat)
    return spacing, distances.max(axis=1), np.maximum(scale, FaceLimits().least_noise * spacing)


def are_faces(planes):
    """Whether planes are those of faces: flat, or the flatter half of all."""
    flatness = planes.scale / np.maximum(planes.radius, np.finfo(float).tiny)
    return are_flat(planes, max(FaceLimits().flat, np.median(flatness)))


def give_faces(queries, around, planes, flat, usable):
    """Of the planes of its neighbors, the one that explains each query best: `Faces`. `usable` is
    True for all planes; an array, so that it is made once."""
    spacing = planes.spacing[around.indices].mean(axis=1)
    least = np.maximum(FaceLimits().least_noise * spacing, np.finfo(float).tiny)
    owners = explain(queries, around, planes, usable, least, likely=True)[0]
    far = np.flatnonzero(owners < 0)
    if len(far):
        # What no plane reaches is given the likeliest as if all were boundless.
        near = around.take(far)
        members = np.unique(near.indices)
        boundless = planes.take(members)
        boundless = boundless._replace(radius=np.full_like(boundless.radius, np.inf))
        near = near._replace(indices=np.searchsorted(members, near.indices).astype(np.int32))
        all_usable = usable[: len(members)]
        found = explain(queries[far], near, boundless, all_usable, least[far], likely=True)[0]
        # Points in one place have no planes.
        owners[far] = members[np.where(found < 0, near.indices[:, 0], found)]
    normals = planes.normals[owners]
    levels = np.einsum("md,md->m", planes.centroids[owners], normals)
    height = np.einsum("md,md->m", queries, normals) - levels
    scale = np.maximum(planes.scale[owners], least)
    flat = flat[owners]
    on_face = flat & (np.abs(height) <= ExplainLimits().explained * scale)
    return Faces(
        normals=normals,
        levels=levels,
        height=height,
        scale=scale,
        spacing=spacing,
        flat=flat,
        on_face=on_face,
    )
