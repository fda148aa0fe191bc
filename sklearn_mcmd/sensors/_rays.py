"""Rays from a sensor to its points: how near company is to be expected, and which space is empty.

A sensor sends its beams in directions that lie close together. What follows is measured in steps:
the distance between a point's ray and those next to it, at the range of the point.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import ratio
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
    alone: float = 1.25  # most points of a surface have a beam's point within this many steps
    sheet: float = 0.5  # least size of a sheet of rays, of the least size of a surface
    mistaken: float = 0.1  # where sheets hold more of all that is flat, the sensor was elsewhere


class Witnesses(NamedTuple):
    """The k beams next to the rays of m points.

    A beam is `farther`, 1, where it passes the point and goes on, -1 where it ends before, and
    between the two where it ends nearby. Around groups 1 of beams without an echo, too.
    """

    rows: np.ndarray  # int32 (m, k), of the points that the beams met
    asked: np.ndarray  # bool (m, k), which of them are asked
    farther: np.ndarray  # (m, k)
    step: np.ndarray  # (m,), 0 of points where the sensor is


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
        rows, asked, farther, _ = witnesses
        passing, ending = asked * np.maximum(farther, 0.0), asked * np.maximum(-farther, 0.0)
        met = on_surface[rows]
        hidden = np.where(met, ending, 0.0)
        near = np.where(met, 0.0, asked * (1 - np.abs(farther)))
        sums = passing, ending, hidden, near, asked
        return cls(*(part.sum(axis=1) for part in sums))

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
        return Emptiness(
            *(
                own + np.append(part, 0.0)[near].sum(axis=1)
                for own, part in zip(self, others, strict=True)
            )
        )

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


class Rays:
    """The rays from where the sensor stood, `origins` (n, d), to the points of a cloud.

    Of points in one direction, the farthest tells where the beam ends. `empty` makes arrays for
    what is found of all points. `ranges` (n,) are distances from the sensor, `step` (n,) is 0 where
    it is, and `usual_angle` is the median angle between rays that are next to each other.
    """

    def __init__(self, points, origins, limits, n_jobs, empty=np.empty):
        self.points, self.origins, self.limits, self.n_jobs = points, origins, limits, n_jobs
        n = len(points)
        self.ranges, self.directions = empty(n, float), empty(points.shape, float)

        def look(rows):
            self.ranges[rows], self.directions[rows] = _polar(points[rows], origins[rows])

        each_slice(n, CHUNK, look, n_jobs)
        seen = self.ranges > 0
        self.unit = None if (origins == origins[0]).all() else np.median(self.ranges[seen])
        # In an order that does not depend on that of the points.
        places = self._places(self.directions, origins)
        order = np.lexsort((-self.ranges, *places.T[::-1])).astype(np.int32)
        self.cloud = IndexedCloud(places[order])
        self.rows = order[self.cloud.rows]  # of the points that tell where the beams end
        self._place_of = np.empty(n, np.int32)
        self._place_of[order] = self.cloud.places
        self.n_beams = k = min(limits.n_beams, len(self.cloud.points) - 1)
        self._beams, means = empty((n, k), np.int32), empty(n, float)
        self._search(k, empty, means)
        self.usual_angle = float(np.median(means[seen]))
        self.step = self._steps(means, self.ranges)

    def _search(self, k, empty, means):
        """Find the k beams next to each ray; the means of their angles are filled, too."""
        cloud, n_places = self.cloud, len(self.cloud.points)
        beams, of_places = empty((n_places, k), np.int32), empty(n_places, float)

        def search(rows):
            found = cloud.neighbors(rows, k + 1, 0)[:, 1:]
            beams[rows] = self.rows[found]
            angles = distances_between(cloud.points[found], cloud.points[rows])
            of_places[rows] = angles.mean(axis=1)

        def spread(rows):
            places = self._place_of[rows]
            self._beams[rows], means[rows] = beams[places], of_places[places]

        each_slice(n_places, CHUNK, search, self.n_jobs)
        each_slice(len(means), CHUNK, spread, self.n_jobs)

    def _places(self, directions, origins):
        """Rays are next to each other if their directions are, and the sensor's positions too."""
        if self.unit is None:
            return directions
        return np.hstack([directions, origins / self.unit])

    def release(self):
        """Forget what only the points themselves ask for."""
        self._beams = self.step = self._place_of = None

    def next_to(self, rows, on_surface):
        """The `Emptiness` of the places of some of the points."""

        def witnesses(part):
            own = rows[part]
            return self._witnesses(self._beams[own], self.ranges[own], self.step[own])

        return self._sums(len(rows), witnesses, on_surface)

    def around(self, rows, groups, on_surface):
        """The `Emptiness` around whole groups, of points `rows` (m,): the beams next to them that
        are of others."""
        group = np.full(len(self.points), -1, np.int32)
        group[rows] = groups
        cloud, k, ranges = self.cloud, self.n_beams, self.ranges[rows]
        n_searched = min(int(self.limits.searched * k), len(cloud.points) - 1)

        def witnesses(part):
            own = rows[part]
            angles, found = cloud.nearest(cloud.points[self._place_of[own]], n_searched + 1)
            angles, beams = angles[:, 1:], self.rows[found[:, 1:]]
            strange = group[beams] != group[own][:, None]
            strange &= np.cumsum(strange, axis=1) <= k
            found = self._witnesses(beams, ranges[part], self.step[own], angles)
            return found._replace(asked=strange)

        return self._sums(len(rows), witnesses, on_surface)

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
        ranges, directions = _polar(queries, origins)
        ranks = np.arange(1, self.n_beams + 1)
        angles, near = self.cloud.tree.query(self._places(directions, origins), k=ranks)
        step = self._steps(angles.mean(axis=1), ranges)
        beams = self.rows[near]
        given = beams, ranges, step
        return self._witnesses(*given), self._witnesses(*given, angles)

    def _steps(self, mean_angles, ranges):
        return np.minimum(mean_angles, self.limits.usual * self.usual_angle) * ranges

    def _witnesses(self, beams, ranges, step, angles=0.0):
        """What these beams tell, all of which are asked. Where the angles to the next ones are
        unusual, nearer beams had no echo."""
        farther = self.ranges[beams] - ranges[:, None]
        farther = ratio(farther, ExplainLimits().explained * step[:, None])
        farther = np.clip(farther, -1.0, 1.0)
        farther = np.where(angles > self.limits.usual * self.usual_angle, 1.0, farther)
        return Witnesses(beams, np.ones(beams.shape, bool), farther, step)

    def measure(self, index, planes):
        """What the tilt of each point's plane leaves of the ranges of the beams that meet it.

        The range to a plane changes from beam to beam with its tilt. An outline that cuts beams
        makes mixed pixels, which lie between it and what is behind: a plane too, but it contains
        the rays, and its ranges follow no tilt. What is left is in steps: the median of the points
        nearby, less where most have a beam's point at hand.
        """
        n, limits, explained = len(self.points), self.limits, ExplainLimits().explained
        scatter, alone, agreed = (index.empty(n) for _ in range(3))

        def look(rows):
            scatter[rows], alone[rows] = self._look(rows, planes.take(rows), explained)

        each_slice(n, CHUNK, look, self.n_jobs)

        def agree(rows):
            near = index.query_own(rows, min(limits.n_beams + 1, index.n_neighbors)).indices
            beams_apart = np.median(alone[near], axis=1) * (explained / limits.alone)
            agreed[rows] = np.minimum(np.median(scatter[near], axis=1), beams_apart)

        each_slice(n, index.chunk, agree, self.n_jobs)
        return agreed

    def going_on(self, rows, planes, on_surface, max_angle):
        """Of the planes of surfaces where beams next to some of the points end, how many more go on
        through the point, and explain it, than face elsewhere."""
        beams = self._beams[rows]
        normals = planes.normals[beams]
        away = self.points[rows][:, None] - planes.centroids[beams]
        heights = np.abs(np.einsum("mkd,mkd->mk", away, normals))
        explains = heights <= ExplainLimits().explained * planes.scale[beams]
        cosines = np.abs(np.einsum("mkd,md->mk", normals, planes.normals[rows]))
        told = np.where(cosines < np.cos(np.radians(max_angle)), -1, explains)
        return np.where(on_surface[beams], told, 0).sum(axis=1)

    def _look(self, rows, planes, explained):
        beams, step = self._beams[rows], self.step[rows]
        away = distances_between(self.points[beams], self.points[rows])
        heights = self.points[beams] - planes.centroids[:, None]
        heights = np.einsum("mkd,md->mk", heights, planes.normals)
        met = np.abs(heights) <= explained * planes.scale[:, None]
        tilt = self.directions[beams] - self.directions[rows][:, None]
        tilt = np.einsum("mkd,md->mk", tilt, planes.normals)
        farther = self.ranges[beams] - self.ranges[rows][:, None]
        left = np.where(step > 0, _left_by_line(tilt, farther, met), 0.0)
        return ratio(left, step), ratio(away.min(axis=1), step)


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


def _polar(points, origins):
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
    n = 1 + np.count_nonzero(taken, axis=1)
    x, y = np.where(taken, x, 0.0), np.where(taken, y, 0.0)
    mean_x, mean_y = x.sum(axis=1) / n, y.sum(axis=1) / n
    xx = np.einsum("mk,mk->m", x, x) / n - mean_x**2
    xy = np.einsum("mk,mk->m", x, y) / n - mean_x * mean_y
    yy = np.einsum("mk,mk->m", y, y) / n - mean_y**2
    return np.sqrt(np.maximum(yy - ratio(xy**2, xx), 0.0))
