"""Whether a cloud was taken from the origin, or from another position: what directions tell.

A scanner or a camera sends its beams at even steps of angle, so its points are at uneven distances
from each other in space, and at even ones as seen from where it stood. From beside it, points that
it saw before a background slide over others, and the steps next to outlines are no longer even.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.sensors._rays import RayLimits, one_far_position

SAMPLE = 100_000  # points of larger clouds that are asked
N_WINDOWS = 64  # of directions in which they are asked; their number only takes time


class ViewLimits(NamedTuple):
    """What a view from where the sensor stood is.

    There gaps are uneven by .03 to .44 of what they are in space, with a fifth of outliers as
    well, but for streets of `make_street`: .53 and .68. See docs/sensor.rst.
    """

    even: float = 0.5  # gaps are less uneven than this share of what they are in space
    # Directions nearer than this share of the usual gap are one beam, with several echoes.
    # Positions beside the origin are this share of the usual range away. A sensor stood there, and
    # not at the origin, if gaps are more even from there by more than twice this share.
    aside: float = 0.05


def origin_if_seen(points):
    """ "origin" if points (n, d) were taken from there, else None."""
    points = points.astype(np.float64, copy=False)
    return "origin" if points.shape[1] == 3 and view_from_origin(lambda: [points]) else None


def view_from_origin(parts):
    """In words, what a cloud is that was taken from the origin; "" if nothing says so.

    ``parts()`` gives the points, as an iterable of arrays (m, 3) of float64. The answer does not
    depend on the order of points, or on how they are divided.
    """
    # Step 1: from the origin steps are even.
    (here,) = _views(parts, np.zeros((1, 3)))
    if here is None or not here.is_even():
        return ""
    # Step 2: from no place beside it they are more even.
    least = (1 - 2 * ViewLimits().aside) * here.uneven_beside_others()
    aside = ViewLimits().aside * here.usual_range * np.vstack([np.eye(3), -np.eye(3)])
    if any(view is None or view.uneven_beside_others() < least for view in _views(parts, aside)):
        return ""
    return "a turn about the origin" if _on_all_sides(here.directions) else "a view from the origin"


def surround_origin(points):
    """Whether points (n, 3) lie on all sides of the origin, as those of a turn or in a room do,
    also where they were thinned, which leaves no even steps."""
    near = len(points) > 0 and not one_far_position(points, np.zeros((1, 3)))
    return near and _on_all_sides(_polar(points)[1])


def views_from_setups(points, positions, setups=None):
    """Whether points look as if measured from where a file states: for each setup True or False,
    or why it cannot be asked, "far" or "few".

    Points (n, 3) have `positions` (1, 3) or (n, 3); `setups` (n,) number those that are several.
    The file's word stands where steps are even: no position aside is asked.
    """
    groups: list[slice | np.ndarray] = [slice(None)]
    if setups is not None:
        groups = [np.flatnonzero(setups == setup) for setup in np.unique(setups)]
    return [_looks_even(points[rows] - positions[rows][0]) for rows in groups]


def _looks_even(points):
    (view,) = _views(lambda: [points], np.zeros((1, 3)))
    if view is None:
        return "far" if len(points) and one_far_position(points, np.zeros((1, 3))) else "few"
    return bool(view.is_even())


class _View:
    """Distinct points (n, 3), as they are seen from the origin of their coordinates. The gap to the
    next direction counts of those that are `asked`, bool (n,); the others are their neighbors."""

    def __init__(self, points, asked):
        ranges, self.directions = _polar(points)
        self.points, self.asked, self.usual_range = points, asked, np.median(ranges)
        # The gap to the next direction that is no second echo of the same beam.
        tree = cKDTree(self.directions)
        distances, rows = tree.query(self.directions, k=_n_around() + 1)
        one_beam = ViewLimits().aside * np.median(distances[:, 1])
        beams = asked & (distances[:, 1] > one_beam)
        self.gaps = distances[beams, 1]
        self.usual = np.maximum(np.median(distances[:, 1][rows[beams]], axis=1), one_beam)

    def is_even(self):
        """Whether directions are at even steps, as a sensor makes them, unlike the points."""
        in_space = cKDTree(self.points).query(self.points, k=2)[0][self.asked, 1]
        return _uneven(self.gaps) < ViewLimits().even * _uneven(in_space)

    def uneven_beside_others(self):
        """As against the beams around each."""
        return _uneven(self.gaps, self.usual)


class _Sample:
    """Points in windows of directions from a position, the same whatever their order: all windows
    are narrowed alike until they have no more than `SAMPLE` points together."""

    def __init__(self, position, windows):
        self.position, self.windows, self.width = position, windows, 2.0
        self.points, self.apart = np.empty((0, 3)), np.empty(0)

    def add(self, xyz):
        self.points = np.concatenate([self.points, xyz])
        self.apart = np.concatenate([self.apart, self._apart(xyz)])
        self._keep()
        while len(self.points) > SAMPLE:
            self.width /= np.sqrt(2)
            self._keep()

    def view(self):
        """The `_View`, in which the inner half of each window is asked; None of too few points."""
        points = np.unique(self.points, axis=0)
        if len(points):
            ranges = _polar(points - self.position)[0]
            points = points[ranges >= RayLimits().own * np.median(ranges)]
        asked = self._apart(points) < self.width / np.sqrt(2)
        if len(points) <= _n_around() or not asked.any():
            return None
        return _View(points - self.position, asked)

    def _apart(self, xyz):
        """How far directions are from the middle of the nearest window."""
        ranges, directions = _polar(xyz - self.position)
        return np.where(ranges > 0, self.windows.query(directions)[0], np.inf)

    def _keep(self):
        near = self.apart < self.width
        self.points, self.apart = self.points[near], self.apart[near]


def _n_around():
    """Beams around one, in either direction from it."""
    return 2 * RayLimits().n_beams


def _views(parts, positions):
    """The same points as seen from each of some positions: `_View`, None if all are far away."""
    if _are_far(parts):
        return [None] * len(positions)
    # A spiral of golden angles at even heights spreads them evenly over the sphere.
    turns = np.arange(N_WINDOWS) * np.pi * (3 - np.sqrt(5))
    height = (2 * np.arange(N_WINDOWS) + 1) / N_WINDOWS - 1
    flat = np.sqrt(1 - height**2)
    windows = cKDTree(np.column_stack([flat * np.cos(turns), flat * np.sin(turns), height]))
    samples = [_Sample(position, windows) for position in positions]
    for xyz in parts():
        for sample in samples:
            sample.add(xyz)
    return [sample.view() for sample in samples]


def _are_far(parts):
    """Whether all points are as far from the origin as of `one_far_position`; some may tell that
    they are not."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for xyz in parts():
        if len(xyz):
            low, high = np.minimum(low, xyz.min(axis=0)), np.maximum(high, xyz.max(axis=0))
            if not one_far_position(np.stack([low, high]), np.zeros((1, 3))):
                return False
    return True


def _on_all_sides(directions):
    return bool(np.linalg.norm(directions.mean(axis=0)) <= 0.5)


def _polar(points):
    """Ranges and directions, element by element, so that no other point has a say."""
    ranges = np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2 + points[:, 2] ** 2)
    return ranges, points / np.where(ranges > 0, ranges, 1.0)[:, None]


def _uneven(gaps, usual=None):
    """The mean of (log2 of a gap over the usual one)^2, each at most 1."""
    if len(gaps) == 0:  # most points are in one direction
        return 1.0
    usual = np.median(gaps) if usual is None else usual
    with np.errstate(divide="ignore"):  # beams around are in one direction
        return np.minimum(np.log2(gaps / usual) ** 2, 1.0).mean()
