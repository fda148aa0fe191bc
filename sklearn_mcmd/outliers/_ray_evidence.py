"""What rays say of planes, of single points and of groups, beside what coordinates say."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.outliers._surfaces import SurfaceLimits
from sklearn_mcmd.planes._around import are_flat, known_at, ratio
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
    """The `Rays` to the n points of a cloud, and the planes that contain them.

    Where `approximate`, as by `one_far_position`, no plane does.
    `scatter` (n,) is as by `Rays.scatter`. Points `on_sheet`, bool (n,), have planes that contain
    the rays to them and do not go on, which are part of no surface. `judge` finds the `rest`.
    """

    on_sheet: np.ndarray

    def __init__(self, rays, approximate, scatter, n_jobs):
        self.rays, self.approximate, self.scatter, self.n_jobs = rays, approximate, scatter, n_jobs

    @classmethod
    def of(cls, index, origins, planes, usable, n_jobs):
        """Of an index, whose points were measured from `origins` (n, d), and have `planes`, which
        are `usable`, bool (n,). Also which of them are free to be of surfaces, and which may be of
        sheets."""
        points, limits = index.points, SurfaceLimits()
        rays, n = Rays.of(points, origins, RayLimits(), n_jobs), len(points)
        self = cls(rays, one_far_position(points, origins), np.empty(n), n_jobs)
        left, alone = np.empty(n), np.empty(n)
        (grazed, faces), (free, ends) = np.empty((2, n), bool), np.empty((2, n), bool)
        going_on = np.zeros(n, np.int8)

        def look(rows):
            left[rows], alone[rows] = rays.look(rows, planes.take(rows))

        def face(rows):
            """Which flat planes contain the rays to their points, and which face the sensor."""
            self.scatter[rows] = scatter = rays.scatter(index, rows, left, alone)
            contain = (scatter > ExplainLimits().explained) & (not self.approximate)
            flat = are_flat(planes.take(rows), limits.flat)
            grazed[rows], faces[rows] = flat & contain, flat & ~contain

        def go_on(part):
            rows = part.start + np.flatnonzero(grazed[part])
            going_on[rows] = rays.going_on(rows, planes, faces, limits.angle)

        def end(part):
            """Which planes may be of sheets: grazed, they end beside surfaces that face elsewhere.
            Grazed ground contains the rays as well, but it goes on: beams beside it end on it."""
            of_sheet = grazed[part].copy()
            rows = np.flatnonzero(of_sheet)
            if len(rows):
                near = index.query_own(part.start + rows).indices
                of_sheet[rows] = going_on[near].sum(axis=1) <= 0
            free[part], ends[part] = usable[part] & ~of_sheet, usable[part] & of_sheet

        for work in (look, face, go_on, end):
            each_slice(n, index.chunk, work, n_jobs)
        return self, free, ends

    def doubt(self, on_surface, counts):
        """As `doubt_of`, by surfaces, bool (n,), and `counts` (n,) of measurements."""
        return doubt_of(counts.sum(where=self.on_sheet), counts.sum(where=on_surface))

    def judge(self, off_surface, spacing, explained, to_planes, index, doubt=1.0):
        """Isolation and separation of all m points that no surface explains.

        `spacing` (m,) is the mean distance of each to its nearest measurements, `explained` is bool
        (n,), and `to_planes` as `JudgedCloud.to_planes`. `doubt`, a number or (m,), is a factor on
        how isolated points are, which does not touch sheets of rays.
        """
        rest, isolation = off_surface.rest, off_surface.isolation
        rows, points, step = rest.rows, rest.points, self.rays.steps(rest.rows)
        empty = self.rays.next_to(rows, explained)
        apart, by_beams = in_steps(isolation, spacing, step), np.empty(len(rows))

        def ask(some, _, near):
            around = _around(empty.take(some), apart[some], empty, apart, near[:, 1:])
            by_beams[some] = self._isolation(isolation[some], step[some], *around)

        rest.others.visit(points, SurfaceLimits().n_links + 1, ask, self.n_jobs)
        rest.others.release()
        separation = self._separation(off_surface, explained, step)
        on_sheet = self.on_sheets(points, lambda some: index.query_own(rows[some]), to_planes)
        self.rays.release()
        isolation = doubt * by_beams
        self.rest = RestByRays(
            others=rest.others,
            empty=empty,
            apart=apart,
            of_sheets=on_sheet > 0,
            by_sheet=on_sheet > isolation,
        )
        return np.maximum(isolation, on_sheet), separation

    def _separation(self, off_surface, explained, step):
        """The separation of points off the surfaces, by the beams around their groups; `step` (m,)
        is theirs."""
        rest, separation = off_surface.rest, off_surface.separation.copy()
        stand_off = np.flatnonzero(separation > 0)
        rows, groups = rest.rows[stand_off], off_surface.groups[stand_off]
        group = np.zeros(len(explained), np.int32)  # from 1 on, 0 of points in none
        group[rows] = groups + 1
        around = self.rays.around(rows, group, explained)
        together = around.pooled(groups, rest.points[stand_off]).together()
        separation[stand_off] = separation_of(separation[stand_off], together, step[stand_off])
        return separation

    def judge_new(self, queries, around, apart, spacing, explained, to_planes, doubt=1.0):
        """The same of new points (m, d) and their neighborhoods, each for itself; `apart` is as
        `OffSurface.measure` returns. Rays have judged the groups of the cloud."""
        isolation, separation, joined = apart
        witnesses, strange = self.rays.new_witnesses(queries, around.indices[:, 0])
        empty, beside = Emptiness.of(witnesses, explained), Emptiness.of(strange, explained)
        apart = in_steps(isolation, spacing, witnesses.step)
        near = self.rest.others.query(queries, SurfaceLimits().n_links, self.n_jobs)[1]
        with_others = _around(empty, apart, self.rest.empty, self.rest.apart, near)
        isolation = doubt * self._isolation(isolation, witnesses.step, *with_others)
        alone = separation_of(separation, beside.together(), witnesses.step)
        on_sheet = self.on_sheets(queries, around.take, to_planes)
        return np.maximum(isolation, on_sheet), np.where(joined, separation, alone)

    def _isolation(self, isolation, step, share, apart):
        """Isolation of points by the share of beams that pass, and by how far apart they are.
        Points where the sensor is have no ray, and what coordinates say; an approximate position
        excuses points, and condemns none."""
        by_beams = share * apart
        if self.approximate:
            by_beams = np.minimum(by_beams, isolation)
        return np.where(step > 0, by_beams, isolation)

    def on_sheets(self, queries, neighbors_of, to_planes):
        """How much ranges scatter on the sheet of rays that explains a point; 0 if none does."""
        owners, off = to_planes(queries, neighbors_of, self.on_sheet)
        return np.where(off <= ExplainLimits().explained, self.scatter[owners], 0.0)


def doubt_of(n_on_sheets, n_on_surfaces):
    """What speaks against the position, in words: that sheets of rays would have a large share of
    all that is flat."""
    share = n_on_sheets / max(1, n_on_sheets + n_on_surfaces)
    if share <= RayLimits().mistaken:
        return ""
    return (
        f"as seen from the sensor, {100 * share:.0f} % of all that is flat would be sheets of "
        "rays. Mixed pixels are fewer: it seems to have stood elsewhere"
    )


def _around(empty, apart, all_empty, all_apart, near):
    """What beams say of each place and of the off-surface points around it, rows of `near`, and how
    far apart all of these are: errors in quantity are near each other, and each of them is in empty
    space. `all_empty` and `all_apart` are of all off-surface points."""
    around = empty.with_nearest(all_empty, near)
    logs = np.log(known_at(all_apart, near, 1.0)).sum(axis=1) + np.log(apart)
    around_apart = np.exp(logs / (1 + np.count_nonzero(near < len(all_apart), axis=1)))
    return np.minimum(empty.alone(), around.alone()), np.sqrt(apart * around_apart)


def in_steps(isolation, spacing, step):
    """The spacing of a point counts as much in steps as in usual spacings. Points where the sensor
    is have no ray, and what coordinates say."""
    with np.errstate(over="ignore"):
        both = np.sqrt(isolation * np.where(step > 0, ratio(spacing, step), isolation))
    return np.clip(both, TINY, 1 / TINY)


def separation_of(separation, together, step):
    """A group stands off by as much as the beams around it say that its place is empty."""
    return np.where(step > 0, together * separation, separation)
