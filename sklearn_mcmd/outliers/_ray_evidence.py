"""What rays say of planes, of single points and of groups, beside what coordinates say."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.outliers._surfaces import SurfaceLimits, find_surfaces
from sklearn_mcmd.planes._around import are_flat, ratio, values_at
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.runtime._chunks import each_slice
from sklearn_mcmd.sensors._rays import Emptiness, RayLimits, Rays, one_far_position

TINY = 1e-100  # so that logarithms are finite


class BesideRays(NamedTuple):
    """What is beside the rays to m points that no surface explains."""

    search: NearestPoints  # of these points
    empty: Emptiness  # by the beams next to each
    apart: np.ndarray  # (m,), how far each is from others, as much in steps as in usual spacings
    of_sheets: np.ndarray  # bool (m,), explained by a sheet of rays
    by_sheet: np.ndarray  # bool (m,), isolated by a sheet of rays


class RayEvidence(NamedTuple):
    """The `Rays` to the n points of a cloud, and the planes that contain them."""

    rays: Rays
    approximate: bool  # as by `one_far_position`: then no plane contains rays
    scatter: np.ndarray  # (n,), as by `Rays.scatter`
    # bool (n,), whose planes contain the rays to them and do not go on: of no surface, but of
    # sheets of rays.
    on_sheet: np.ndarray
    n_jobs: int | None

    @classmethod
    def of(cls, origins, measuring, planes, usable, least):
        """Of points that were measured from `origins` (n, d), and have `MeasuringPlanes`; also
        which of these are free to be of surfaces, bool (n,).

        `planes` have their own noise, `usable`, bool (n,), are those that may be of a surface or a
        sheet, and `least` points a surface has at least.
        """
        index, n_jobs, limits = measuring.model.index, measuring.n_jobs, SurfaceLimits()
        points, n = index.points, len(index.points)
        rays = Rays.of(points, origins, RayLimits(), n_jobs)
        approximate = one_far_position(points, origins)
        left, alone, scatter = np.empty((3, n))
        grazed, faces = np.empty((2, n), bool)
        # By all that face, and by those of them that tell.
        telling, ends, going_on = *np.empty((2, 2, n), bool), np.zeros((2, n), np.int8)

        def look(rows):
            left[rows], alone[rows] = rays.look(rows, measuring.planes.take(rows))

        def face(rows):
            """Which flat planes contain the rays to their points, and which face the sensor."""
            scatter[rows] = rays.scatter(index, rows, left, alone)
            contain = (scatter[rows] > ExplainLimits().explained) & (not approximate)
            flat = are_flat(measuring.planes.take(rows), limits.flat)
            grazed[rows], faces[rows] = flat & contain, flat & ~contain

        def go_on(part):
            rows = part.start + np.flatnonzero(grazed[part])
            going_on[:, rows] = rays.going_on(rows, measuring.planes, telling, limits.angle)

        def end(part):
            """Which planes may be of sheets: grazed, they end beside surfaces that face elsewhere.
            Grazed ground contains the rays as well, but it goes on: beams beside it end on it."""
            ends[:, part] = usable[part] & grazed[part]
            rows = part.start + np.flatnonzero(ends[0, part])
            if len(rows):
                ends[:, rows] = going_on[:, index.query_own(rows).indices].sum(axis=2) <= 0

        for work in (look, face):
            each_slice(n, index.chunk, work, n_jobs)
        telling[:] = faces
        if grazed.any():
            # Planes of a short sheet seem to face, and would speak for each other. But nowhere does
            # it hang together with what follows its tilt, unless over planes blended of both.
            follow = faces & (scatter <= RayLimits().alone)
            hanging = find_surfaces(index, planes, usable, least, follow, RayLimits().bend)
            telling[1] &= hanging | ~hanging.any()
        for work in (go_on, end):
            each_slice(n, index.chunk, work, n_jobs)
        # What ends only by those that tell may be leaves or a sign, unless it forms a sheet.
        on_sheet = find_surfaces(index, planes, ends[1], least * RayLimits().sheet)
        return cls(rays, approximate, scatter, on_sheet, n_jobs), usable & ~(on_sheet | ends[0])

    def doubt(self, on_surface, counts):
        """As `doubt_of`, by surfaces, bool (n,), and `counts` (n,) of measurements."""
        return doubt_of(counts.sum(where=self.on_sheet), counts.sum(where=on_surface))

    def judge(self, off_surface, explained, measuring, darkness):
        """Isolation and separation of all m points that no surface explains, and the `BesideRays`.

        `explained` is bool (n,), `measuring` are the `MeasuringPlanes`. `darkness`, a number or
        (m,), is a factor on how isolated points are, which does not touch sheets of rays.
        """
        unexplained, isolation = off_surface.unexplained, off_surface.isolation
        rows, points, index = unexplained.rows, unexplained.points, measuring.model.index
        step, empty = self.rays.steps(rows), self.rays.next_to(rows, explained)
        apart = in_steps(isolation, unexplained.among_all, step)
        by_beams, search = np.empty(len(rows)), unexplained.search

        def ask(part, _, near):
            share, around_apart = _with_neighbors(
                empty.take(part), apart[part], empty, apart, near[:, 1:]
            )
            by_beams[part] = self._by_beams(isolation[part], step[part], share, around_apart)

        search.visit(points, SurfaceLimits().n_links + 1, ask, self.n_jobs)
        search.release()
        separation = self._separation(off_surface, explained, step)
        sheet = self.scatter_of_sheets(points, lambda part: index.query_own(rows[part]), measuring)
        self.rays.release()
        isolation = darkness * by_beams
        beside = BesideRays(search, empty, apart, of_sheets=sheet > 0, by_sheet=sheet > isolation)
        return np.maximum(isolation, sheet), separation, beside

    def _separation(self, off_surface, explained, step):
        """The separation of points off the surfaces, by the beams around their groups; `step` (m,)
        is theirs."""
        separation = off_surface.separation.copy()
        stand_off = np.flatnonzero(separation > 0)
        rows, groups = off_surface.rows[stand_off], off_surface.groups[stand_off]
        group = np.zeros(len(explained), np.int32)  # from 1 on, 0 of points in none
        group[rows] = groups + 1
        around = self.rays.around(rows, group, explained)
        together = around.pooled(groups, off_surface.unexplained.points[stand_off]).together()
        separation[stand_off] = separation_of(separation[stand_off], together, step[stand_off])
        return separation

    def judge_new(self, queries, around, company, beside, darkness, explained, measuring):
        """The same of new points (m, d) and their neighborhoods, each for itself.

        `company` is the `NewCompany` by coordinates, and `beside` what `judge` returned: rays have
        judged the groups of the cloud.
        """
        witnesses, strange = self.rays.new_witnesses(queries, around.indices[:, 0])
        empty, of_group = Emptiness.of(witnesses, explained), Emptiness.of(strange, explained)
        apart = in_steps(company.isolation, company.spacing, witnesses.step)
        near = beside.search.query(queries, SurfaceLimits().n_links, self.n_jobs)[1]
        share, around_apart = _with_neighbors(empty, apart, beside.empty, beside.apart, near)
        by_beams = self._by_beams(company.isolation, witnesses.step, share, around_apart)
        alone = separation_of(company.separation, of_group.together(), witnesses.step)
        sheet = self.scatter_of_sheets(queries, around.take, measuring)
        isolation = np.maximum(darkness * by_beams, sheet)
        return isolation, np.where(company.joined, company.separation, alone)

    def _by_beams(self, isolation, step, share, apart):
        """Isolation of points by the share of beams that pass, and by how far apart they are.
        Points where the sensor is have no ray, and what coordinates say; an approximate position
        excuses points, and condemns none."""
        by_beams = share * apart
        if self.approximate:
            by_beams = np.minimum(by_beams, isolation)
        return np.where(step > 0, by_beams, isolation)

    def scatter_of_sheets(self, queries, neighbors_of, measuring):
        """How much ranges scatter on the sheet of rays that explains a point; 0 if none does."""
        owners, off = measuring.nearest(queries, neighbors_of, self.on_sheet)
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


def _with_neighbors(empty, apart, all_empty, all_apart, near):
    """What beams say of each place and of the off-surface points around it, rows of `near`, and how
    far apart all of these are: errors in quantity are near each other, and each of them is in empty
    space. `all_empty` and `all_apart` are of all off-surface points."""
    around = empty.with_nearest(all_empty, near)
    # The geometric mean of the point itself and of those that are near, whose number varies.
    logs = np.log(values_at(all_apart, near, 1.0)).sum(axis=1) + np.log(apart)
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
