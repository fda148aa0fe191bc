"""What rays say of planes, of single points and of groups, beside what coordinates say."""

import numpy as np

from sklearn_mcmd.outliers._rays import DIFFERS, Emptiness, RayLimits, Rays, one_far_position
from sklearn_mcmd.outliers._surfaces import SurfaceLimits, find_surfaces
from sklearn_mcmd.planes._around import ratio

__all__ = ["RayEvidence"]

# Off-surface points around that a point shares what beams say with, as many as it is linked to.
AROUND = SurfaceLimits().n_links
TINY = 1e-100  # so that logarithms are finite


class RayEvidence:
    """The rays to the points of a cloud, and the planes that contain them.

    The index, a `NeighborIndex` or what answers as one, has n points. `origins`, float64 (n, d),
    tells where the sensor stood when it measured each of them, and `planes` has the plane of each.

    `scatter` (n,) is how much the ranges of beams differ from a plane, in steps; see
    `Rays.measure`. Points `on_sheet`, bool (n,), have planes that contain the rays to them, which
    are part of no surface. Off-surface points `of_sheets`, bool (m,), are explained by a sheet of
    rays, and those `by_sheet` isolated by it; `judge` finds them.
    """

    def __init__(self, index, origins, planes, limits, n_jobs):
        self.index, self.limits, self.n_jobs = index, limits, n_jobs
        self.rays = Rays(index.points, origins, RayLimits(), n_jobs, index.empty)
        self.scatter = self.rays.measure(index, planes, limits.explained)
        self.on_sheet = self.scatter > DIFFERS
        self.approximate = one_far_position(index.points, origins)
        if self.approximate:
            self.on_sheet[:] = False

    def settle_sheets(self, planes, distances, least):
        """Leave of `on_sheet` what is large enough, where a surface has `least` points."""
        least *= self.rays.limits.sheet
        self.on_sheet = find_surfaces(
            self.index, planes, distances, least, self.limits, ~self.on_sheet
        )

    def doubt(self, on_surface, counts):
        """What speaks against the position, in words: that sheets of rays would have a large share
        of all that is flat. Surfaces are bool (n,), `counts` (n,) measurements at the points."""
        sheets, surfaces = counts[self.on_sheet].sum(), counts[on_surface].sum()
        share = sheets / max(1, sheets + surfaces)
        if share <= self.rays.limits.mistaken:
            return ""
        return (
            f"as seen from the sensor, {100 * share:.0f} % of all that is flat would be sheets of "
            "rays. Mixed pixels are fewer: it seems to have stood elsewhere"
        )

    def judge(self, off_surface, spacing, explained, to_planes, doubt=1.0):
        """Isolation and separation of all m points that no surface explains.

        `spacing` (m,) is the mean distance of each to its nearest measurements, `explained` is bool
        (n,), and `to_planes` as `JudgedCloud.to_planes`. `doubt`, a number or (m,), is a factor on
        how isolated points are, which does not touch sheets of rays.
        """
        rest, rays, index = off_surface.rows, self.rays, self.index
        groups, step = off_surface.groups, rays.steps(rest)
        self.others, self.empty = off_surface.others, rays.next_to(rest, explained)
        self.apart = _in_steps(off_surface.isolation, spacing, step)
        isolation = np.empty(len(rest))

        def judge(rows, _, near):
            own = self.empty.take(rows)
            isolation[rows] = self._isolation(
                off_surface.isolation[rows], own, self.apart[rows], near[:, 1:], step[rows]
            )

        self.others.visit(off_surface.points, AROUND + 1, judge, self.n_jobs)
        self.others.release()
        isolation *= doubt
        on_sheet = self._on_sheets(
            index.points[rest], lambda r: index.query_own(rest[r]), to_planes
        )
        rows = np.flatnonzero(off_surface.separation > 0)
        around = rays.around(rest[rows], groups[rows], explained)
        together = np.ones(len(rest))
        together[rows] = around.pooled(groups[rows], index.points[rest[rows]]).together()
        rays.release()
        self.of_sheets, self.by_sheet = on_sheet > 0, on_sheet > isolation
        return np.maximum(isolation, on_sheet), _separation(off_surface.separation, together, step)

    def judge_new(self, queries, around, apart, spacing, explained, to_planes, doubt=1.0):
        """The same of new points (m, d) and their neighborhoods, each for itself.

        `apart` are its isolation, its separation, and whether it belongs to a group of the cloud,
        which rays have judged.
        """
        isolation, separation, joined = apart
        witnesses, strange = self.rays.new_witnesses(queries, around.indices[:, 0])
        empty, beside = Emptiness.of(witnesses, explained), Emptiness.of(strange, explained)
        in_steps = _in_steps(isolation, spacing, witnesses.step)
        near = self.others.query(queries, AROUND, self.n_jobs)[1]
        isolation = doubt * self._isolation(isolation, empty, in_steps, near, witnesses.step)
        alone = _separation(separation, beside.together(), witnesses.step)
        on_sheet = self._on_sheets(queries, around.take, to_planes)
        return np.maximum(isolation, on_sheet), np.where(joined, separation, alone)

    def _isolation(self, isolation, empty, apart, near, step):
        """Isolation of points by what beams say of each, of the off-surface points around it
        (rows of `near`), and by how far apart all of these are: errors in quantity are near each
        other, and each of them is in empty space. Points where the sensor is have no ray, and what
        coordinates say; an approximate position excuses points, and condemns none."""
        around = empty.with_nearest(self.empty, near)
        logs = np.log(np.append(self.apart, 1.0)[near]).sum(axis=1) + np.log(apart)
        around_apart = np.exp(logs / (1 + np.count_nonzero(near < len(self.apart), axis=1)))
        told = np.minimum(empty.alone(), around.alone()) * np.sqrt(apart * around_apart)
        if self.approximate:
            told = np.minimum(told, isolation)
        return np.where(step > 0, told, isolation)

    def _on_sheets(self, queries, neighbors_of, to_planes):
        """How much ranges scatter on the sheet of rays that explains a point; 0 if none does."""
        owners, off = to_planes(queries, neighbors_of, self.on_sheet)
        return np.where(off <= self.limits.explained, self.scatter[owners], 0.0)


def _in_steps(isolation, spacing, step):
    """The spacing of a point counts as much in steps as in usual spacings. Points where the sensor
    is have no ray, and what coordinates say."""
    with np.errstate(over="ignore"):
        both = np.sqrt(isolation * np.where(step > 0, ratio(spacing, step), isolation))
    return np.clip(both, TINY, 1 / TINY)


def _separation(separation, together, step):
    """A group stands off by as much as the beams around it say that its place is empty."""
    return np.where(step > 0, together * separation, separation)
