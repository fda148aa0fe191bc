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

    def __init__(self, rays, approximate, n_jobs, scatter=None, on_sheet=None):
        self.rays, self.approximate, self.n_jobs = rays, approximate, n_jobs
        self.scatter, self.on_sheet, self.rest = scatter, on_sheet, None

    @classmethod
    def of(cls, index, origins, planes, usable, n_jobs):
        """Of an index, whose points were measured from `origins` (n, d), and have `planes`, which
        are `usable`, bool (n,); and which of them `end` finds free, and ending."""
        rays, n = Rays.of(index.points, origins, RayLimits(), n_jobs), len(index.points)
        self = cls(rays, one_far_position(index.points, origins), n_jobs)
        known = {name: np.empty(n, dtype) for name, dtype in FOUND.items()} | {"usable": usable}
        for ask in ASKS:

            def task(rows, ask=ask):
                for name, values in ask(self, rows, index, planes, known).items():
                    known[name][rows] = values

            each_slice(n, index.chunk, task, n_jobs)
        self.scatter = known["scatter"]
        return self, known["free"], known["ends"]

    def look(self, rows, index, planes, known):
        """As of `Rays`, of a slice of the points."""
        return dict(zip(("left", "alone"), self.rays.look(rows, planes.take(rows)), strict=True))

    def face(self, rows, index, planes, known):
        """Which flat planes contain the rays to their points, and which others face the sensor."""
        scatter = self.rays.scatter(index, rows, known["left"], known["alone"])
        contain = (scatter > ExplainLimits().explained) & (not self.approximate)
        flat = are_flat(planes.take(rows), SurfaceLimits().flat)
        return {"scatter": scatter, "grazed": flat & contain, "faces": flat & ~contain}

    def go_on(self, rows, index, planes, known):
        """As `Rays.going_on`, of the grazed planes."""
        own, going_on = np.flatnonzero(known["grazed"][rows]), np.zeros(rows.stop - rows.start)
        given = planes, known["faces"], SurfaceLimits().angle
        going_on[own] = self.rays.going_on(rows.start + own, *given)
        return {"going_on": going_on}

    def end(self, rows, index, planes, known):
        """Which planes may be of sheets: grazed, they end beside surfaces that face elsewhere; and
        which are free to be of surfaces. Grazed ground contains the rays as well, but it goes on:
        beams beside it end on it, too."""
        ends = np.array(known["grazed"][rows])
        if len(own := np.flatnonzero(ends)):
            near = index.query_own(rows.start + own).indices
            ends[own] = known["going_on"][near].sum(axis=1) <= 0
        return {"free": known["usable"][rows] & ~ends, "ends": known["usable"][rows] & ends}

    def doubt(self, on_surface, counts):
        """As `doubt_of`, by surfaces, bool (n,), and `counts` (n,) of measurements."""
        return doubt_of(counts.sum(where=self.on_sheet), counts.sum(where=on_surface))

    def judge(self, off_surface, spacing, explained, to_planes, index, doubt=1.0):
        """Isolation and separation of all m points that no surface explains.

        `spacing` (m,) is the mean distance of each to its nearest measurements, `explained` is bool
        (n,), and `to_planes` as `JudgedCloud.to_planes`. `doubt`, a number or (m,), is a factor on
        how isolated points are, which does not touch sheets of rays.
        """
        rest, company = off_surface.rest, (off_surface.isolation, off_surface.separation)
        rows, points, stand_off = rest.rows, rest.points, off_surface.separation > 0
        group, groups = np.zeros(len(explained), np.int32), off_surface.groups[stand_off]
        group[rows[stand_off]] = groups + 1
        empty, apart, around = self.hear(rows, company[0], spacing, group, explained)
        together = around.pooled(groups, points[stand_off]).together()
        heard = empty, apart, together
        isolation, separation = self.verdict(rows, points, rest.others, company, heard)
        rest.others.release()
        isolation = doubt * isolation
        on_sheet = self.on_sheets(points, lambda some: index.query_own(rows[some]), to_planes)
        self.rays.release()
        self.rest = RestByRays(
            others=rest.others,
            empty=empty,
            apart=apart,
            of_sheets=on_sheet > 0,
            by_sheet=on_sheet > isolation,
        )
        return np.maximum(isolation, on_sheet), separation

    def hear(self, rows, isolation, spacing, group, explained):
        """What beams say of places `rows` off the surfaces: the `Emptiness` by those next to each,
        how far apart each is from others, and the `Emptiness` around those whose groups stand off,
        which have numbers from 1 on, `group` (n,)."""
        empty = self.rays.next_to(rows, explained)
        apart = in_steps(isolation, spacing, self.rays.steps(rows))
        return empty, apart, self.rays.around(rows[group[rows] > 0], group, explained)

    def verdict(self, rows, points, others, company, heard, own=slice(None)):
        """Isolation and separation of a slice of the m places off the surfaces, which `others`
        search. `company` is both of the slice without rays, and `heard` of all m the first two that
        `hear` returns, and `Emptiness.together` of those in the slice that stand off."""
        isolation, separation, (empty, apart, together) = company[0], company[1].copy(), heard
        found, step, stand_off = np.empty(len(rows)), self.rays.steps(rows), separation > 0
        own_empty, own_apart = empty.take(own), apart[own]

        def judge(some, _, near):
            around = _around(own_empty.take(some), own_apart[some], empty, apart, near[:, 1:])
            found[some] = self._isolation(isolation[some], *around, step[some])

        others.visit(points, SurfaceLimits().n_links + 1, judge, self.n_jobs)
        separation[stand_off] = separation_of(separation[stand_off], together, step[stand_off])
        return found, separation

    def judge_new(self, queries, around, apart, spacing, explained, to_planes, doubt=1.0):
        """The same of new points (m, d) and their neighborhoods, each for itself; `apart` is as
        `OffSurface.measure` returns. Rays have judged the groups of the cloud."""
        isolation, separation, joined = apart
        witnesses, strange = self.rays.new_witnesses(queries, around.indices[:, 0])
        empty, beside = Emptiness.of(witnesses, explained), Emptiness.of(strange, explained)
        apart = in_steps(isolation, spacing, witnesses.step)
        near = self.rest.others.query(queries, SurfaceLimits().n_links, self.n_jobs)[1]
        with_others = _around(empty, apart, self.rest.empty, self.rest.apart, near)
        isolation = doubt * self._isolation(isolation, *with_others, witnesses.step)
        alone = separation_of(separation, beside.together(), witnesses.step)
        on_sheet = self.on_sheets(queries, around.take, to_planes)
        return np.maximum(isolation, on_sheet), np.where(joined, separation, alone)

    def _isolation(self, isolation, share, apart, step):
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


# The steps that find these of all points, each of which asks for what those before have found.
ASKS = RayEvidence.look, RayEvidence.face, RayEvidence.go_on, RayEvidence.end
FOUND = {
    **dict.fromkeys(("left", "alone", "scatter"), np.float64),
    **dict.fromkeys(("grazed", "faces", "free", "ends"), bool),
    "going_on": np.int8,
}


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
