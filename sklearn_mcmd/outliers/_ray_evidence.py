"""What rays say of planes, of single points and of groups, beside what coordinates say."""

import numpy as np

from sklearn_mcmd.outliers._rays import DIFFERS, Emptiness, RayLimits, Rays, one_far_position
from sklearn_mcmd.outliers._surfaces import find_surfaces
from sklearn_mcmd.planes._around import ratio

__all__ = ["RayEvidence"]


class RayEvidence:
    """The rays to the points of a cloud, and the planes that contain them.

    Parameters
    ----------
    index : NeighborIndex, or what answers as one
        Of n points.
    origins : ndarray of float64 of shape (n, d)
        Where the sensor stood when it measured each of them.
    planes : Planes
        Of each point.
    limits : SurfaceLimits
    n_jobs : int or None

    Attributes
    ----------
    rays : Rays
    scatter : ndarray of shape (n,)
        How much the ranges of beams differ from a plane, in steps; see `Rays.measure`.
    on_sheet : ndarray of bool of shape (n,)
        Points whose planes contain the rays to them, which are part of no surface.
    beam_spacing : ndarray of shape (n,)
        Mean distance of each point to those of the beams next to it, on its plane.
    """

    def __init__(self, index, origins, planes, limits, n_jobs):
        self.index, self.limits = index, limits
        self.rays = Rays(index.points, origins, RayLimits(), n_jobs, index.empty)
        self.scatter, self.beam_spacing = self.rays.measure(index, planes, limits.explained)
        self.on_sheet = self.scatter > DIFFERS
        if one_far_position(index.points, origins):
            self.on_sheet[:] = False

    def settle_sheets(self, planes, distances, least):
        """Leave of `on_sheet` what is large enough, where a surface has `least` points."""
        least *= self.rays.limits.sheet
        self.on_sheet = find_surfaces(
            self.index, planes, distances, least, self.limits, ~self.on_sheet
        )
        self.beam_spacing = None

    def judge(self, off_surface, spacing, explained, to_planes):
        """Isolation and separation of all points that no surface explains.

        Parameters
        ----------
        off_surface : OffSurface
        spacing : ndarray of shape (m,)
            Mean distance of each off-surface point to its nearest measurements.
        explained : ndarray of bool of shape (n,)
        to_planes : callable
            As `JudgedCloud.to_planes`.
        """
        rest, rays, index = off_surface.rows, self.rays, self.index
        groups, step = off_surface.groups, rays.steps(rest)
        isolation = _isolation(
            off_surface.isolation, spacing, rays.next_to(rest, explained).alone(), step
        )
        on_sheet = self._on_sheets(
            index.points[rest], lambda r: index.query_own(rest[r]), to_planes
        )
        rows = np.flatnonzero(off_surface.separation > 0)
        around = rays.around(rest[rows], groups[rows], explained)
        together = np.ones(len(rest))
        together[rows] = around.pooled(groups[rows], index.points[rest[rows]]).together()
        rays.release()
        return np.maximum(isolation, on_sheet), _separation(off_surface.separation, together, step)

    def judge_new(self, queries, around, apart, spacing, explained, to_planes):
        """The same of new points (m, d) and their neighborhoods, each for itself.

        `apart` are its isolation, its separation, and whether it belongs to a group of the cloud,
        which rays have judged.
        """
        isolation, separation, joined = apart
        witnesses = self.rays.new_witnesses(queries, around.indices[:, 0])
        empty = Emptiness.of(witnesses, explained)
        isolation = _isolation(isolation, spacing, empty.alone(), witnesses.step)
        alone = _separation(separation, empty.together(), witnesses.step)
        on_sheet = self._on_sheets(queries, around.take, to_planes)
        return np.maximum(isolation, on_sheet), np.where(joined, separation, alone)

    def _on_sheets(self, queries, neighbors_of, to_planes):
        """How much ranges scatter on the sheet of rays that explains a point; 0 if none does."""
        owners, off = to_planes(queries, neighbors_of, self.on_sheet)
        return np.where(off <= self.limits.explained, self.scatter[owners], 0.0)


def _isolation(isolation, spacing, alone, step):
    """The spacing of a single point counts as much in steps as in usual spacings, by how empty
    its place is. Points where the sensor is have no ray, and keep what coordinates say."""
    with np.errstate(over="ignore"):
        both = np.sqrt(isolation * ratio(spacing, step))
    return np.where(step > 0, alone * both, isolation)


def _separation(separation, together, step):
    """A group stands off by as much as the beams around it say that its place is empty."""
    return np.where(step > 0, together * separation, separation)
