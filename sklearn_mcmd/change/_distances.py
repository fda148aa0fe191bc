"""Distances between surfaces along normals, their errors, and noise that is alike nearby."""

import itertools
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtr, chdtri

from sklearn_mcmd.planes._form import cells_of
from sklearn_mcmd.planes._quadrics import tangents_of
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._rules import ReweightLimits

STEEP = np.sin(np.radians(10.0))  # of a normal, whose face is steeper than 80 degrees
STEPS = 20  # in which a mean without outliers has long settled


class AlikeLimits(NamedTuple):
    """Where noise that is alike nearby is looked for, among pairs of places."""

    near: float = 3.0  # radii between neighborhoods, which share no points from 2 on
    far: float = 8.0  # radii, for noise that is alike over more than one neighborhood
    quiet: float = 0.25  # share of the pairs that lie across no border of a movement, at least
    # Times as long as pairs are apart is the cloud, at least. If one half moves, a quarter of the
    # pairs, 1 / (5 - 1), lies across the border.
    long: float = 5.0
    pairs: int = 4_000  # at most, in each direction
    least: int = 50  # pairs that tell it


class Surfaces(NamedTuple):
    """The planes of a cloud's points."""

    xyz: np.ndarray  # float64 (n, d)
    normals: np.ndarray  # (n, d)
    planes: Planes
    n_neighbors: int

    def nearest(self, places, reach, n_jobs):
        """The nearest points of places, at most `reach` away: rows, and whether there is one."""
        gap, rows = cKDTree(self.xyz).query(places, distance_upper_bound=reach, workers=n_jobs)
        is_near = np.isfinite(gap)
        return np.where(is_near, rows, 0), is_near

    def heights(self, rows, places, normals):
        """Heights along normals at which planes of rows cross the axes through places, and their
        variances.

        A mean of n points has the variance of one over n. Beside its middle a plane rises and
        falls by its tilt, whose squares are those of both directions together.
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
            return height, (mean + tilt) / cosine**2


def alike_ratio(places, normals, radius, distance, variance):
    """How many times larger than by independent noise the variances of distances are, 1 at least;
    not a number where too few places tell it.

    Noise that is alike nearby, as in rows of a scanner, does not average out in a neighborhood, and
    no residual of its plane tells it. Distances of two places that share no points do: they differ
    by the noise of both. What moves as a body is in both, and form is in both clouds. A scanner's
    rows and columns follow the level line or the line of fall of what they pass, so places are
    paired along each, and the largest ratio counts. Pairs across the border of a movement differ by
    more: as outliers of a plane they are left out, by the deviation of the others.
    """
    limits, rows = AlikeLimits(), np.flatnonzero(np.isfinite(distance))
    if len(rows) < limits.least:
        return np.nan
    rows = rows[np.lexsort(places[rows].T)]  # whatever the order of rows
    first = rows[:: len(rows) // limits.pairs + 1]
    tree, ratios = cKDTree(places[rows]), []
    most = np.ptp(places[rows], axis=0).max() / limits.long / np.median(radius[first])
    steps = [apart for apart in (limits.near, limits.far) if apart <= most]
    for along, apart in itertools.product(_lines(normals[first]), steps):
        gap, at = tree.query(places[first] + apart * radius[first, None] * along)
        second = rows[at]
        cosine = _dots(normals[first], normals[second])
        # Of one surface: within a radius of where it should be, and turned by 25 degrees at most.
        paired = (gap < radius[first]) & (np.abs(cosine) > 0.9)
        if np.count_nonzero(paired) < limits.least:
            continue
        one, other = first[paired], second[paired]
        difference = distance[one] - np.sign(cosine[paired]) * distance[other]
        squares = difference**2 / (variance[one] + variance[other])
        # The border of a movement is in some parts of the cloud, noise is in all.
        halvings = max(0, int(np.log2(len(squares) / limits.least)))
        parts = cells_of(places[one], squares, halvings=halvings).of_point
        means = [_mean_square(squares[parts == i], limits.quiet) for i in np.unique(parts)]
        ratios.append(float(np.median(means)))
    return max([1.0, *ratios]) if ratios else np.nan


def _mean_square(squares, quiet):
    """Mean of squares without outliers, over that of a standard normal variable."""
    # Of such a variable x, the share of x^2 below the limit, and its part of the mean.
    limit = ReweightLimits().cutoff ** 2
    usual = chdtr(3, limit) / chdtr(1, limit)
    mean = np.quantile(squares, quiet) / chdtri(1, 1 - quiet)
    for _ in range(STEPS):
        inside = squares[squares <= limit * mean]
        if len(inside):
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
