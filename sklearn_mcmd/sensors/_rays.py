"""Rays from a sensor to its points: how near company is to be expected, and which space is empty.

A sensor sends its beams in directions that lie close together. What follows is measured in steps:
the distance between a point's ray and those next to it, at the range of the point.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import ratio, values_at
from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.runtime._chunks import each_slice

CHUNK = 4096  # points at once; it limits the memory


class RayLimits(NamedTuple):
    """What rays tell.

    Ranges differ by as many steps as standard deviations that a surface does not explain,
    `ExplainLimits.explained`: those to a surface scatter by less about its tilt.
    """

    n_beams: int = 8  # beams next to a ray, by their direction
    searched: float = 8.0  # beams among which those of other groups are sought, in `n_beams`
    # Beams are around a group within this many of the cloud's usual steps, and a step counts as
    # that many at most.
    usual: float = 2.0
    # Most points of a surface have a beam's point within this many steps. A surface tells what goes
    # on if as many of its points as the least one has scatter by no more,
    alone: float = 1.25
    bend: float = 0.5  # and if their normals agree within this share of the usual angle
    sheet: float = 0.5  # least size of a sheet of rays, of the least size of a surface
    mistaken: float = 0.1  # where sheets hold more of all that is flat, the sensor was elsewhere
    # What is nearer than this share of the usual range may be the sensor itself or what carries it,
    # and is elsewhere as seen from beside the one position: it is judged as if it had no ray.
    own: float = 0.1


class Witnesses(NamedTuple):
    """The k beams next to the rays of m points.

    A beam is `farther`, 1, where it passes the point and goes on, -1 where it ends before, and
    between the two where it ends nearby. Around groups 1 of beams without an echo, too.
    """

    rows: np.ndarray  # int32 (m, k), of the points that the beams met
    asked: np.ndarray  # bool (m, k), which of them are asked
    farther: np.ndarray  # (m, k)
    step: np.ndarray  # (m,), 0 of points at the sensor


class Emptiness(NamedTuple):
    """What the beams next to points say about their places: sums over the beams, of shape (m,)."""

    passing: np.ndarray  # go on behind the point, or have no echo around a group: it is empty there
    ending: np.ndarray  # end before the point
    hidden: np.ndarray  # of these, end on a surface
    near: np.ndarray  # end near the point, on no surface
    asked: np.ndarray  # all

    @classmethod
    def of(cls, witnesses, on_surface):
        """From `Witnesses`, and which points of the cloud a surface explains."""
        farther, asked, met = witnesses.farther, witnesses.asked, on_surface[witnesses.rows]
        ending = asked * np.maximum(-farther, 0.0)
        near = asked * (1 - np.abs(farther))
        return cls(
            passing=(asked * np.maximum(farther, 0.0)).sum(axis=1),
            ending=ending.sum(axis=1),
            hidden=np.where(met, ending, 0.0).sum(axis=1),
            near=np.where(met, 0.0, near).sum(axis=1),
            asked=asked.sum(axis=1),
        )

    def alone(self):
        """Evidence from 0 to 1 that a place is empty: the share of beams that pass.

        Of those that could tell: a beam that ends before the place has not seen it, and one that
        ends near it on a surface tells of the surface, not of what is beside it. If no other is
        left, nothing speaks against what coordinates say.
        """
        heard = self.passing + self.near
        return np.where(heard > 0, ratio(self.passing, heard), 1.0)

    def take(self, rows):
        return Emptiness(*(part[rows] for part in self))

    def with_nearest(self, others, near):
        """The beams of each place (m,) and of the nearest places to it, rows (m, k) of others."""
        both = zip(self, others, strict=True)
        sums = (alone + values_at(part, near, 0.0).sum(axis=1) for alone, part in both)
        return Emptiness(*sums)

    def pooled(self, groups, points):
        """The beams of all points of a group, for each of these; `groups` counts from 0 on.

        Sums are taken in the order of coordinates, so they do not depend on that of the points.
        """
        order = np.lexsort(points.T[::-1])
        return Emptiness(*(np.bincount(groups[order], part[order])[groups] for part in self))

    def together(self):
        """Evidence from 0 to 1 that a group is nothing real, from the beams around all of it.

        Here beams that end before it speak for the group: behind what they met, it may go on.
        Only if nearly all of them end on surfaces, nothing there can be seen, and it is an error.
        """
        empty = ratio(self.passing - self.ending, self.asked)
        evidence = np.maximum(empty, 2 * ratio(self.hidden, self.asked) - 1)
        return np.clip(evidence, 0.0, 1.0)


@dataclass
class Rays:
    """The rays from where the sensor stood to the n points of a cloud; see `of`."""

    points: np.ndarray  # (n, d)
    ranges: np.ndarray  # (n,), from the sensor
    cloud: IndexedCloud  # of directions, and positions where there are several: each once, a beam
    met: np.ndarray  # int32 (n_beams,), of the points in one direction the farthest
    near: np.ndarray  # int32 (n_beams, k + 1), the beams next to each, itself first
    angles: np.ndarray  # (n_beams,), the mean angle to these
    usual_angle: float  # its median, over the points
    usual_range: float  # the same of ranges
    limits: RayLimits
    n_jobs: int | None
    beam_of: np.ndarray  # int32 (n,)
    origins: np.ndarray  # (n, d)
    unit: float | None  # of positions, where there are several

    @classmethod
    def of(cls, points, origins, limits, n_jobs):
        """Those from `origins` (n, d). Of points in one direction, the farthest tells where the
        beam ends."""
        n = len(points)
        ranges, directions = np.empty(n), np.empty(points.shape)

        def look(rows):
            ranges[rows], directions[rows] = polar(points[rows], origins[rows])

        each_slice(n, CHUNK, look, n_jobs)
        # Of several echoes of a beam the farthest comes first, and so stands for it.
        seen = ranges > 0
        usual_range = float(np.median(ranges[seen]))
        unit = None if (origins == origins[0]).all() else usual_range
        order = np.argsort(-ranges, kind="stable").astype(np.int32)
        cloud = IndexedCloud(beams_of(directions, origins, unit)[order])
        beam_of, n_beams = np.empty(n, np.int32), len(cloud.points)
        beam_of[order] = cloud.places
        k = min(limits.n_beams, n_beams - 1)
        near, angles = np.empty((n_beams, k + 1), np.int32), np.empty(n_beams)

        def search(rows):
            near[rows] = cloud.neighbors(rows, k + 1, 0)
            beside = cloud.points[near[rows, 1:]]
            angles[rows] = distances_between(beside, cloud.points[rows]).mean(axis=1)

        each_slice(n_beams, CHUNK, search, n_jobs)
        return cls(
            points=points,
            ranges=ranges,
            cloud=cloud,
            met=order[cloud.rows],
            near=near,
            angles=angles,
            usual_angle=float(np.median(angles[beam_of[seen]])),
            usual_range=usual_range,
            limits=limits,
            n_jobs=n_jobs,
            beam_of=beam_of,
            origins=origins,
            unit=unit,
        )

    def release(self):
        """Forget what only the points themselves ask for."""
        self.near = self.angles = self.beam_of = np.empty(0)

    def _n_next(self):
        return min(self.limits.n_beams, len(self.cloud.points) - 1)

    def steps(self, rows):
        """The steps at some of the points, 0 of those at the sensor."""
        return self._steps(self.angles[self.beam_of[rows]], self.ranges[rows])

    def _beams(self, rows):
        """Of some of the points the beams next to them."""
        return self.near[self.beam_of[rows]][:, 1:]

    def next_to(self, rows, on_surface):
        """The `Emptiness` of the places of some of the points."""

        def witnesses(part):
            points = rows[part]
            return self._witnesses(self._beams(points), self.ranges[points], self.steps(points))

        return self._sums(len(rows), witnesses, on_surface)

    def around(self, rows, group, on_surface):
        """The `Emptiness` around whole groups, of points `rows` (m,): the beams next to them that
        are of others. `group` (n,) are numbers from 1 on, 0 of points in none."""
        k, order = self._n_next(), np.argsort(self.beam_of[rows])  # like ones are asked together
        rows, ranges = rows[order], self.ranges[rows[order]]
        n_searched = min(int(self.limits.searched * k), len(self.cloud.points) - 1)

        def witnesses(part):
            points = rows[part]
            queries = self.cloud.points[self.beam_of[points]]
            angles, beams = self.cloud.nearest(queries, n_searched + 1)
            angles, beams = angles[:, 1:], beams[:, 1:]  # the first is the point's own
            strange = group[self.met[beams]] != group[points][:, None]
            strange &= np.cumsum(strange, axis=1) <= k
            told = self._witnesses(beams, ranges[part], self.steps(points), angles)
            return told._replace(asked=strange)

        return self._sums(len(rows), witnesses, on_surface).take(np.argsort(order))

    def _sums(self, m, witnesses, on_surface):
        """The `Emptiness` of m points, from the `Witnesses` that a function gives of a slice."""
        sums = Emptiness(*np.empty((len(Emptiness._fields), m)))

        def add(part):
            for field, values in zip(sums, Emptiness.of(witnesses(part), on_surface), strict=True):
                field[part] = values

        each_slice(m, CHUNK, add, self.n_jobs)
        return sums

    def new_witnesses(self, queries, nearest):
        """`Witnesses` of new points, each measured from where its nearest point was: as `next_to`
        asks them, and as `around` does, each point being a group."""
        origins = self.origins[nearest]
        ranges, directions = polar(queries, origins)
        ranks = np.arange(1, self._n_next() + 1)
        angles, near = self.cloud.tree.query(beams_of(directions, origins, self.unit), k=ranks)
        steps = self._steps(angles.mean(axis=1), ranges)
        alone = self._witnesses(near, ranges, steps)
        return alone, self._witnesses(near, ranges, steps, angles)

    def _steps(self, mean_angles, ranges):
        steps = np.minimum(mean_angles, self.limits.usual * self.usual_angle) * ranges
        return np.where(ranges < self.limits.own * self.usual_range, 0.0, steps)

    def _witnesses(self, beams, ranges, step, angles=0.0):
        """What these beams tell, all of which are asked. Where the angles to the next ones are
        unusual, nearer beams had no echo."""
        rows = self.met[beams]
        farther = self.ranges[rows] - ranges[:, None]
        farther = ratio(farther, ExplainLimits().explained * step[:, None])
        farther = np.clip(farther, -1.0, 1.0)
        farther = np.where(angles > self.limits.usual * self.usual_angle, 1.0, farther)
        return Witnesses(rows, np.ones(rows.shape, bool), farther, step)

    def look(self, rows, planes):
        """What the tilt of the planes of some of the points leaves of the ranges of the beams that
        meet them, in steps; and how far the nearest beam's point is.

        The range to a plane changes from beam to beam with its tilt. An outline that cuts beams
        makes mixed pixels, which lie between it and what is behind: a plane too, but it contains
        the rays, and its ranges follow no tilt.
        """
        beams, step, explained = self._beams(rows), self.steps(rows), ExplainLimits().explained
        ends, d = self.met[beams], self.points.shape[1]
        away = distances_between(self.points[ends], self.points[rows])
        heights = self.points[ends] - planes.centroids[:, None]
        heights = np.einsum("mkd,md->mk", heights, planes.normals)
        # Only beams that end on the plane tell how ranges change with its tilt.
        met = np.abs(heights) <= explained * planes.scale[:, None]
        directions = self.cloud.points
        tilt = directions[beams] - directions[self.beam_of[rows]][:, None]
        tilt = np.einsum("mkd,md->mk", tilt[..., :d], planes.normals)
        farther = self.ranges[ends] - self.ranges[rows][:, None]
        left = np.where(step > 0, _left_by_line(tilt, farther, met), 0.0)
        return ratio(left, step), ratio(away.min(axis=1), step)

    def scatter(self, index, rows, left, alone):
        """How much ranges scatter around a slice of the points: the median of what `look` found of
        those nearby, less where most have a beam's point at hand."""
        near = index.query_own(rows, min(self.limits.n_beams + 1, index.n_neighbors)).indices
        # Scaled so that a surface's points, at `alone` steps at most, scatter by no more than what
        # a plane explains.
        apart = np.median(alone[near], axis=1) * (ExplainLimits().explained / self.limits.alone)
        return np.minimum(np.median(left[near], axis=1), apart)

    def going_on(self, rows, planes, telling, max_angle):
        """Of the planes where beams next to some of the points end, how many more go on through the
        point, and explain it, than face elsewhere; of those that are `telling`, bool (..., n)."""
        ends = self.met[self._beams(rows)]
        normals = planes.normals[ends]
        away = self.points[rows][:, None] - planes.centroids[ends]
        heights = np.abs(np.einsum("mkd,mkd->mk", away, normals))
        explains = heights <= ExplainLimits().explained * planes.scale[ends]
        cosines = np.abs(np.einsum("mkd,md->mk", normals, planes.normals[rows]))
        told = np.where(cosines < np.cos(np.radians(max_angle)), -1, explains)
        return np.where(telling[..., ends], told, 0).sum(axis=-1)


def one_far_position(points, origins):
    """Whether one position, farther from the points than they are apart, stands for all of them.

    Rays are then nearly parallel, and nothing in the cloud tells whether the position is exact. An
    aircraft, for which one position is given, moves while it measures: facades that it saw from
    the side would contain the rays.
    """
    if not (origins == origins[0]).all():
        return False
    low, high = points.min(axis=0), points.max(axis=0)
    outside = np.maximum(np.maximum(low - origins[0], origins[0] - high), 0.0)
    return bool(np.linalg.norm(outside) > np.linalg.norm(high - low))


def beams_of(directions, origins, unit):
    """Rays are next to each other if their directions are, and the sensor's positions too."""
    return directions if unit is None else np.hstack([directions, origins / unit])


def polar(points, origins):
    """Ranges and directions; points where the sensor is have none."""
    rays = points - origins
    ranges = np.sqrt(np.einsum("nd,nd->n", rays, rays))
    # Squares of the least coordinates vanish, and such points are where the sensor is, too.
    return ranges, ratio(rays, np.where(ranges > 0, ranges, np.inf)[:, None])


def distances_between(points, queries):
    """Distances (m, k) of points (m, k, d) from queries (m, d)."""
    gaps = points - queries[:, None]
    return np.sqrt(np.einsum("mkd,mkd->mk", gaps, gaps))


def _left_by_line(x, y, taken):
    """Standard deviation of y (m, k) about a line through x, with a further point at (0, 0)."""
    n = 1 + np.count_nonzero(taken, axis=1)  # zeros add nothing to sums, as the further point does
    x, y = np.where(taken, x, 0.0), np.where(taken, y, 0.0)
    mean_x, mean_y = x.sum(axis=1) / n, y.sum(axis=1) / n
    xx = np.einsum("mk,mk->m", x, x) / n - mean_x**2
    xy = np.einsum("mk,mk->m", x, y) / n - mean_x * mean_y
    yy = np.einsum("mk,mk->m", y, y) / n - mean_y**2
    return np.sqrt(np.maximum(yy - ratio(xy**2, xx), 0.0))
