"""What rays say of planes, of single points and of groups, beside what coordinates say."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.outliers._surfaces import find_surfaces
from sklearn_mcmd.planes._around import are_flat, ratio
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.runtime._chunks import each_slice
from sklearn_mcmd.sensors._rays import Emptiness, RayLimits, Rays, one_far_position

TINY = 1e-100  # so that logarithms are finite


class RestByRays(NamedTuple):
    """What rays say of the m points that no surface explains."""

    others: NearestPoints  # search of these points
    empty: Emptiness  # by the beams next to each
    apart: np.ndarray  # (m,), how far each is from others, as much in steps as in usual spacings
    of_sheets: np.ndarray  # bool (m,), explained by a sheet of rays
    by_sheet: np.ndarray  # bool (m,), isolated by a sheet of rays


class RayEvidence:
    """The rays to the points of a cloud, and the planes that contain them.

    `origins`, float64 (n, d), tells where the sensor stood when it measured each point of the
    index, and `planes` has the plane of each. `scatter` (n,) is as by `Rays.measure`. Points
    `on_sheet`, bool (n,), have planes that contain the rays to them and do not go on, which are
    part of no surface. `judge` finds the `rest`.
    """

    def __init__(self, index, origins, planes, limits, n_jobs):
        self.index, self.limits, self.n_jobs, self.rest = index, limits, n_jobs, None
        self.rays = Rays(index.points, origins, RayLimits(), n_jobs, index.empty)
        self.scatter = self.rays.measure(index, planes)
        self.on_sheet = self.scatter > ExplainLimits().explained
        self.approximate = one_far_position(index.points, origins)
        if self.approximate:
            self.on_sheet[:] = False
        self._leave_grazed(planes)

    def _leave_grazed(self, planes):
        """Keep of `on_sheet` the flat planes that end beside surfaces which face elsewhere. Grazed
        ground contains the rays as well, but it goes on: beams beside it end on it, too."""
        index, rays, flat = self.index, self.rays, are_flat(planes, self.limits.flat)
        surface, rows = flat & ~self.on_sheet, np.flatnonzero(flat & self.on_sheet)
        going_on = np.zeros(len(flat), np.int8)
        self.on_sheet[:] = False

        def look(part):
            own = rows[part]
            going_on[own] = rays.going_on(own, planes, surface, self.limits.angle)

        def settle(part):
            near = index.query_own(rows[part]).indices
            self.on_sheet[rows[part]] = going_on[near].sum(axis=1) <= 0

        each_slice(len(rows), index.chunk, look, self.n_jobs)
        each_slice(len(rows), index.chunk, settle, self.n_jobs)

    def find_sheets(self, planes, distances, least):
        """Keep of `on_sheet` what is large enough, where a surface has `least` points."""
        least, barred = least * self.rays.limits.sheet, ~self.on_sheet
        self.on_sheet = find_surfaces(self.index, planes, distances, least, self.limits, barred)

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
        rest, rays, index = off_surface.rest.rows, self.rays, self.index
        groups, step = off_surface.groups, rays.step[rest]
        others, empty = off_surface.rest.others, rays.next_to(rest, explained)
        apart = _in_steps(off_surface.isolation, spacing, step)
        isolation = np.empty(len(rest))

        def judge(rows, _, near):
            around = _around(empty.take(rows), apart[rows], empty, apart, near[:, 1:])
            isolation[rows] = self._isolation(off_surface.isolation[rows], *around, step[rows])

        others.visit(off_surface.rest.points, self.limits.n_links + 1, judge, self.n_jobs)
        others.release()
        isolation *= doubt
        on_sheet = self._on_sheets(
            index.points[rest], lambda r: index.query_own(rest[r]), to_planes
        )
        rows = np.flatnonzero(off_surface.separation > 0)
        around = rays.around(rest[rows], groups[rows], explained)
        together = np.ones(len(rest))
        together[rows] = around.pooled(groups[rows], index.points[rest[rows]]).together()
        rays.release()
        self.rest = RestByRays(
            others=others,
            empty=empty,
            apart=apart,
            of_sheets=on_sheet > 0,
            by_sheet=on_sheet > isolation,
        )
        return np.maximum(isolation, on_sheet), _separation(off_surface.separation, together, step)

    def judge_new(self, queries, around, apart, spacing, explained, to_planes, doubt=1.0):
        """The same of new points (m, d) and their neighborhoods, each for itself; `apart` is as
        `OffSurface.measure` returns. Rays have judged the groups of the cloud."""
        isolation, separation, joined = apart
        witnesses, strange = self.rays.new_witnesses(queries, around.indices[:, 0])
        empty, beside = Emptiness.of(witnesses, explained), Emptiness.of(strange, explained)
        in_steps = _in_steps(isolation, spacing, witnesses.step)
        near = self.rest.others.query(queries, self.limits.n_links, self.n_jobs)[1]
        with_others = _around(empty, in_steps, self.rest.empty, self.rest.apart, near)
        isolation = doubt * self._isolation(isolation, *with_others, witnesses.step)
        alone = _separation(separation, beside.together(), witnesses.step)
        on_sheet = self._on_sheets(queries, around.take, to_planes)
        return np.maximum(isolation, on_sheet), np.where(joined, separation, alone)

    def _isolation(self, isolation, share, apart, step):
        """Isolation of points by the share of beams that pass, and by how far apart they are.
        Points where the sensor is have no ray, and what coordinates say; an approximate position
        excuses points, and condemns none."""
        by_beams = share * apart
        if self.approximate:
            by_beams = np.minimum(by_beams, isolation)
        return np.where(step > 0, by_beams, isolation)

    def _on_sheets(self, queries, neighbors_of, to_planes):
        """How much ranges scatter on the sheet of rays that explains a point; 0 if none does."""
        owners, off = to_planes(queries, neighbors_of, self.on_sheet)
        return np.where(off <= ExplainLimits().explained, self.scatter[owners], 0.0)


def _around(empty, apart, all_empty, all_apart, near):
    """What beams say of each place and of the off-surface points around it, rows of `near`, and how
    far apart all of these are: errors in quantity are near each other, and each of them is in empty
    space. `all_empty` and `all_apart` are of all off-surface points."""
    around = empty.with_nearest(all_empty, near)
    logs = np.log(np.append(all_apart, 1.0)[near]).sum(axis=1) + np.log(apart)
    around_apart = np.exp(logs / (1 + np.count_nonzero(near < len(all_apart), axis=1)))
    return np.minimum(empty.alone(), around.alone()), np.sqrt(apart * around_apart)


def _in_steps(isolation, spacing, step):
    """The spacing of a point counts as much in steps as in usual spacings. Points where the sensor
    is have no ray, and what coordinates say."""
    with np.errstate(over="ignore"):
        both = np.sqrt(isolation * np.where(step > 0, ratio(spacing, step), isolation))
    return np.clip(both, TINY, 1 / TINY)


def _separation(separation, together, step):
    """A group stands off by as much as the beams around it say that its place is empty."""
    return np.where(step > 0, together * separation, separation)
