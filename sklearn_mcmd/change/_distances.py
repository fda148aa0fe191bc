"""Distances between surfaces along normals, their errors, and noise that is alike nearby."""

import itertools
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtr, chdtri

from sklearn_mcmd.normals._estimator import RobustNormalEstimator
from sklearn_mcmd.planes._form import cells_of
from sklearn_mcmd.planes._indexed_cloud import location_hashes
from sklearn_mcmd.planes._quadrics import tangents_of
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._resolution import axis_steps, rounding_in_common
from sklearn_mcmd.planes._rules import ReweightLimits

STEEP = np.sin(np.radians(10.0))  # of a normal, whose face is steeper than 80 degrees
PATCH = 20_000  # points that tell to what coordinates are rounded
STEPS = 20  # in which a mean without outliers has long settled


class AlikeLimits(NamedTuple):
    """Where noise that is alike nearby is looked for, among pairs of places."""

    near: float = 3.0  # radii between neighborhoods, which share no points from 2 on
    far: float = 8.0  # radii, for noise that is alike over more than one neighborhood
    quiet: float = 0.25  # share of the pairs that lie across no border of a movement, at least
    # Times as long as pairs are apart is the cloud, at least. If one half moves, a quarter of the
    # pairs, 1 / (5 - 1), lies across the border.
    long: float = 5.0
    pairs: int = 4_000  # about, in each direction, of a whole cloud
    least: int = 50  # pairs that tell it
    alone: float = 5.0  # neighborhoods of a part of the cloud, at least


class Surfaces(NamedTuple):
    """The planes of a cloud's points."""

    xyz: np.ndarray  # float64 (n, d)
    tree: Any  # cKDTree, None where it is kept
    normals: np.ndarray  # (n, d)
    planes: Planes
    n_neighbors: int
    steps: np.ndarray  # (d,), to which coordinates were rounded, 0 where they were not

    @classmethod
    def of(cls, xyz, tree, n_neighbors, random_state=None, n_jobs=None):
        """Planes are those of all members where a surface bends: they are known better than
        tangents, and bend alike in neighborhoods of one width."""
        estimator = _KeepingPlanes(
            n_neighbors, tangents=False, random_state=random_state, n_jobs=n_jobs
        ).fit(xyz)
        xyz = xyz.astype(np.float64, copy=False)
        return cls(
            xyz=xyz,
            tree=tree,
            normals=on_known_sides(estimator.normals_),
            planes=estimator.planes_,
            n_neighbors=min(n_neighbors, len(xyz)),
            steps=steps_of(xyz, tree),
        )

    def nearest(self, places, reach, n_jobs):
        """The nearest points of places, at most `reach` away: rows, and whether there is one."""
        gap, rows = self.tree.query(places, distance_upper_bound=reach, workers=n_jobs)
        is_near = np.isfinite(gap)
        return np.where(is_near, rows, 0), is_near

    def heights(self, rows, places, normals):
        """Heights along normals at which planes of rows cross the axes through places, and their
        variances.

        A mean of n points has the variance of one over n, and all of what rounding does to them
        alike. Beside its middle a plane rises and falls by its tilt, whose squares are those of
        both directions together.
        """
        planes = self.planes.take(rows)
        gap = planes.centroids - places
        cosine = _dots(planes.normals, normals)
        with np.errstate(divide="ignore", invalid="ignore"):
            height = _dots(planes.normals, gap) / cosine
            aside = gap - height[:, None] * normals
            tilt = np.radians(planes.normal_error) ** 2 * _dots(aside, aside)
            tilt /= max(places.shape[1] - 1, 1)
            mean = planes.scale**2 / np.maximum(self.n_neighbors * planes.kept, 1)
            return height, (mean + tilt + self._rounded(planes) ** 2) / cosine**2

    def _rounded(self, planes):
        """Standard deviations of what rounding does to all points of a plane alike."""
        if not self.steps.any():
            return 0.0
        across = planes.normals**2
        variances = planes.eigenvalues[:, :1] * across + planes.eigenvalues[:, 1:2] * (1 - across)
        deviations = np.sqrt(np.maximum(variances, 0.0))
        return rounding_in_common(deviations, planes.normals, self.steps)


class _KeepingPlanes(RobustNormalEstimator):
    """Normals, and the planes that they are of."""

    def _fill(self, planes, X):
        super()._fill(planes, X)
        self.planes_ = planes


def tree_of(xyz):
    """A tree that is built fast; of scans it is as good as a balanced one."""
    return cKDTree(xyz, compact_nodes=False, balanced_tree=False)


def steps_of(xyz, tree):
    """To what each coordinate (d,) is rounded, 0 where it is not, by points near each other."""
    some = xyz[np.argmin(location_hashes(xyz))]  # whatever the order of rows
    _, near = tree.query(some, min(PATCH, len(xyz)))
    return axis_steps(xyz[np.atleast_1d(near)])


def sampled(xyz, share):
    """A share of the points (n, d), bool (n,): the same in whatever order, and of any part."""
    return location_hashes(xyz) <= np.uint64(min(share, 1.0) * (2**64 - 2**11))


def alike_pairs(before, distance, variance, chosen):
    """How much the distances of places that share no points differ, over what independent noise
    explains: of parts of the first cloud, float (m, 3): in which of the `_lines`, how many radii
    apart, and the mean square.

    Noise that is alike nearby, as in rows of a scanner, does not average out in a neighborhood, and
    no residual of its plane tells it. Distances of two places that share no points do: they differ
    by the noise of both. What moves as a body is in both, and form is in both clouds. A scanner's
    rows and columns follow the level line or the line of fall of what they pass, so places are
    paired along each. Pairs across the border of a movement differ by more: as outliers of a plane
    they are left out, by the deviation of the others. Some points are asked, bool (n,).
    """
    limits, told = AlikeLimits(), np.isfinite(distance)
    radius, normals = before.planes.radius, before.normals
    first, found = np.flatnonzero(told & chosen), [np.empty((0, 3))]
    if len(first) < limits.least:
        return found[0]
    places = before.xyz[first]
    neighborhoods = np.count_nonzero(told) / len(first) / before.n_neighbors  # of each of these
    most = np.ptp(before.xyz[told], axis=0).max() / limits.long / np.median(radius[first])
    steps = [apart for apart in (limits.near, limits.far) if apart <= most]
    for (line, along), apart in itertools.product(enumerate(_lines(normals[first])), steps):
        gap, second = before.tree.query(places + apart * radius[first, None] * along)
        cosine = _dots(normals[first], normals[second])
        # Of one surface: within a radius of where it should be, and turned by 25 degrees at most.
        paired = told[second] & (gap < radius[first]) & (np.abs(cosine) > 0.9)
        if np.count_nonzero(paired) < limits.least:
            continue
        one, other = first[paired], second[paired]
        difference = distance[one] - np.sign(cosine[paired]) * distance[other]
        squares = difference**2 / (variance[one] + variance[other])
        # The border of a movement is in some parts of the cloud, noise is in all.
        n_alone = len(squares) * neighborhoods
        n_parts = min(len(squares) / limits.least, n_alone / limits.alone)
        halvings = max(0, int(np.log2(max(n_parts, 1.0))))
        parts = cells_of(places[paired], squares, halvings=halvings).of_point
        means = [_mean_square(squares[parts == i], limits.quiet) for i in np.unique(parts)]
        # The median of means of n squares is below their mean, (1 - 2 / 9n)^3 of it, and of points
        # in one neighborhood distances are one.
        means = np.array(means) / (1 - 2 / 9 * len(means) / max(n_alone, len(means))) ** 3
        found.append(np.column_stack(np.broadcast_arrays(line, apart, means)))
    return np.concatenate(found)


def alike_of(pairs):
    """How many times larger than by independent noise the variances of distances are, 1 at least,
    by what `alike_pairs` found; not a number where too few places tell it."""
    kinds = np.unique(pairs[:, :2], axis=0)
    ratios = [np.median(pairs[(pairs[:, :2] == kind).all(axis=1), 2]) for kind in kinds]
    return float(max([1.0, *ratios])) if ratios else np.nan


def _mean_square(squares, quiet):
    """Mean of squares without outliers, over that of a standard normal variable."""
    # Of such a variable x, the share of x^2 below the limit, and its part of the mean.
    limit = ReweightLimits().cutoff ** 2
    usual = chdtr(3, limit) / chdtr(1, limit)
    mean = np.quantile(squares, quiet) / chdtri(1, 1 - quiet)
    for _ in range(STEPS):
        inside = squares[squares <= limit * mean]
        if len(inside):  # not a number of exact points
            mean = inside.mean() / usual
    return float(mean)


def _lines(normals):
    """Directions in planes: in space the level line and the line of fall."""
    if normals.shape[1] != 3:
        return tangents_of(normals).swapaxes(0, 1)
    level = np.cross(normals, [0.0, 0.0, 1.0])
    lying = np.linalg.norm(level, axis=1) < 1e-6
    level[lying] = [1.0, 0.0, 0.0]
    level -= _dots(level, normals)[:, None] * normals
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    return level, np.cross(normals, level)


def on_known_sides(normals):
    """Unit normals on a side that noise does not decide: up; of what is steeper than 80 degrees to
    +y, or to +x if that goes within 10 degrees along y."""
    clear = np.abs(normals) > STEEP
    # The last coordinate that is clear decides: the largest is more than a half.
    axis = normals.shape[1] - 1 - clear[:, ::-1].argmax(axis=1)
    deciding = np.take_along_axis(normals, axis[:, None], axis=1)
    return np.where(deciding < 0, -normals, normals)


def _dots(a, b):
    return np.einsum("ij,ij->i", a, b)
