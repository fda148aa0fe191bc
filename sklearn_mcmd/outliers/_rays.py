"""Rays from a sensor to its points: how near company is to be expected, and which space is empty.

A sensor sends its beams in directions that lie close together. What follows is measured in steps:
the distance between a point's ray and those next to it, at the range of the point.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._chunks import each_slice
from sklearn_mcmd.planes._indexed_cloud import IndexedCloud

__all__ = ["RayLimits", "Rays", "Witnesses", "emptiness", "joint_evidence", "one_far_position"]

CHUNK = 4096


class RayLimits(NamedTuple):
    """What rays tell.

    n_beams : int
        Beams next to a ray, by their direction.
    differs : float
        Ranges differ if they do so by this many steps. Those to a surface scatter by less about
        its tilt.
    usual : float
        Beams are next to a ray within this many of the cloud's usual steps, and a step counts as
        that many at most.
    alone : float
        Most points of a surface have a beam's point within this many steps.
    n_near : int
        Points near each other, itself the first, whose median tells what a plane is.
    sheet : float
        Least size of a sheet of rays, of the least size of a surface.
    """

    n_beams: int = 8
    differs: float = 3.0
    usual: float = 2.0
    alone: float = 1.25
    n_near: int = 9
    sheet: float = 0.5


class Witnesses(NamedTuple):
    """The beams next to the rays of m points.

    rows : ndarray of int32 of shape (m, k)
        Of the points that the beams met.
    near : ndarray of bool of shape (m, k)
        Whether they really are next to the ray. Where the sensor got no echo, none is.
    farther : ndarray of shape (m, k)
        1 where the beam passes the point and goes on, -1 where it ends before, and between the
        two where it ends nearby.
    step : ndarray of shape (m,)
        0 of points where the sensor is.
    """

    rows: np.ndarray
    near: np.ndarray
    farther: np.ndarray
    step: np.ndarray


class Rays:
    """The rays from where the sensor stood to the points of a cloud.

    Parameters
    ----------
    points : ndarray of float64 of shape (n, d)
    origins : ndarray of float64 of shape (n, d)
        Where the sensor stood when it measured each of the points.
    limits : RayLimits
    n_jobs : int or None

    Attributes
    ----------
    ranges : ndarray of shape (n,)
        Distances from the sensor.
    usual_angle : float
        Between rays that are next to each other, the median of all.
    """

    def __init__(self, points, origins, limits, n_jobs):
        self.points, self.origins, self.limits, self.n_jobs = points, origins, limits, n_jobs
        self.ranges, self.directions = _polar(points, origins)
        self.unit = None if (origins == origins[0]).all() else np.median(self.ranges)
        self.cloud = cloud = IndexedCloud(self._places(self.directions, origins))
        self.n_beams = k = min(limits.n_beams, len(cloud.points) - 1)
        beams = np.empty((len(cloud.points), k), np.int32)
        angles = np.empty((len(cloud.points), k))

        def search(rows):
            found = cloud.neighbors(rows, k + 1, 0)[:, 1:]
            beams[rows] = cloud.rows[found]
            angles[rows] = _distances(cloud.points[found], cloud.points[rows])

        each_slice(len(beams), CHUNK, search, n_jobs)
        places = cloud.places
        self._beams, self._angles = beams[places], angles[places]
        means = self._angles.mean(axis=1)
        self.usual_angle = float(np.median(means[self.ranges > 0]))
        self._step = self._steps(means, self.ranges)

    def _places(self, directions, origins):
        """Rays are next to each other if their directions are, and the sensor's positions too."""
        if self.unit is None:
            return directions
        return np.hstack([directions, origins / self.unit])

    def release(self):
        """Forget what only the points themselves ask for."""
        self._beams = self._angles = self._step = None

    def witnesses(self, rows):
        """The `Witnesses` of some of the points."""
        return self._asked(self._beams[rows], self._angles[rows], self.ranges[rows])

    def new_witnesses(self, queries, nearest):
        """The `Witnesses` of new points, each measured from where the `nearest` of the points was.

        Parameters
        ----------
        queries : ndarray of shape (m, d)
        nearest : ndarray of int of shape (m,)
            Rows of the points.
        """
        origins = self.origins[nearest]
        ranges, directions = _polar(queries, origins)
        ranks = np.arange(1, self.n_beams + 1)
        angles, near = self.cloud.tree.query(self._places(directions, origins), k=ranks)
        return self._asked(self.cloud.rows[near], angles, ranges)

    def _steps(self, mean_angles, ranges):
        return np.minimum(mean_angles, self.limits.usual * self.usual_angle) * ranges

    def _asked(self, beams, angles, ranges):
        reach = self.limits.usual * self.usual_angle
        step = self._steps(angles.mean(axis=1), ranges)
        farther = self.ranges[beams] - ranges[:, None]
        farther = np.clip(ratio(farther, self.limits.differs * step[:, None]), -1.0, 1.0)
        return Witnesses(beams, angles <= reach, farther, step)

    def measure(self, index, planes, explained):
        """How planes look from the sensor.

        The range to a plane changes from beam to beam with its tilt. An outline that cuts beams
        makes mixed pixels, which lie between it and what is behind: a plane too, but it contains
        the rays, and its ranges follow no tilt.

        Parameters
        ----------
        index : NeighborIndex
            Of the points.
        planes : Planes
            Of each of them.
        explained : float
            A plane explains points within this many of its standard deviations.

        Returns
        -------
        scatter : ndarray of shape (n,)
            What the tilt of the plane leaves of the ranges of the beams that meet it, in steps:
            the median of the points nearby. Less where most have a beam's point at hand.
        spacing : ndarray of shape (n,)
            Mean distance to the beams' points on the plane, 0 where there is none.
        """
        n, limits = len(self.points), self.limits
        scatter, alone, spacing = np.empty((3, n))

        def look(rows):
            scatter[rows], alone[rows], spacing[rows] = self._look(
                rows, planes.take(rows), explained
            )

        each_slice(n, CHUNK, look, self.n_jobs)
        agreed = np.empty(n)

        def agree(rows):
            near = index.query_own(rows, min(limits.n_near, index.n_neighbors)).indices
            beams_apart = np.median(alone[near], axis=1) * (limits.differs / limits.alone)
            agreed[rows] = np.minimum(np.median(scatter[near], axis=1), beams_apart)

        each_slice(n, index.chunk, agree, self.n_jobs)
        return agreed, spacing

    def _look(self, rows, planes, explained):
        beams, step = self._beams[rows], self._step[rows]
        away = _distances(self.points[beams], self.points[rows])
        heights = self.points[beams] - planes.centroids[:, None]
        heights = np.einsum("mkd,md->mk", heights, planes.normals)
        met = np.abs(heights) <= explained * planes.scale[:, None]
        tilt = self.directions[beams] - self.directions[rows][:, None]
        tilt = np.einsum("mkd,md->mk", tilt, planes.normals)
        farther = self.ranges[beams] - self.ranges[rows][:, None]
        spacing = ratio(np.where(met, away, 0.0).sum(axis=1), np.count_nonzero(met, axis=1))
        return (
            ratio(_left_by_line(tilt, farther, met), step),
            ratio(away.min(axis=1), step),
            spacing,
        )


def emptiness(witnesses, on_surface, counted):
    """How much the beams next to points say that nothing real is there: sums of m points.

    Two things say so. All beams pass and go on: there is free space. Or all beams end before, on
    surfaces: nothing there can be seen. Where the sensor got no echo, nothing is said against it.

    Parameters
    ----------
    witnesses : Witnesses
    on_surface : ndarray of bool
        Points of the cloud that a surface explains.
    counted : ndarray of bool of shape (m, k)
        Beams that count.

    Returns
    -------
    free, hidden, n_counted : ndarray of shape (m,)
    """
    silent = counted & ~witnesses.near
    heard = counted & witnesses.near
    free = np.where(heard, witnesses.farther, silent).sum(axis=1)
    before = np.maximum(-witnesses.farther, 0.0) * on_surface[witnesses.rows]
    hidden = np.where(heard, before, silent).sum(axis=1)
    return free, hidden, np.count_nonzero(counted, axis=1)


def joint_evidence(free, hidden, n_counted):
    """Evidence from 0 to 1 that nothing real is there, from the sums of `emptiness`."""
    evidence = np.maximum(ratio(free, n_counted), 2 * ratio(hidden, n_counted) - 1)
    return np.clip(evidence, 0.0, 1.0)


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
    return ranges, ratio(rays, ranges[:, None])


def _distances(points, queries):
    """From queries (m, d) to points (m, k, d)."""
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
