"""Reflections: groups behind a plane whose mirror images lie on what stands before it.

A pane, a polished floor or water sends a part of each beam on by the law of reflection. The scanner
knows only the range, and writes the point along the straight ray: behind the plane, at the mirror
image of what the beam met.
"""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.outliers._surfaces import link_limits
from sklearn_mcmd.planes._around import ratio
from sklearn_mcmd.planes._linking import connected_planes
from sklearn_mcmd.planes._record import Planes

__all__ = ["MirrorLimits", "Mirrors", "Seen", "find_mirrors"]


HERE = np.zeros(1)


class MirrorLimits(NamedTuple):
    """What a mirror is.

    explained : float
        A plane explains points within this many of its standard deviations.
    angle : float
        Planes are parallel if the angle between their normals is less, in degrees.
    n_sample : int
        Points with which large planes are sought.
    n_tried : int
        Points of a group with which the place of the pane is sought. Smaller groups do not count
        there.
    n_groups : int
        Groups that are asked at most, the largest.
    n_planes : int
        Planes that are tried at most, the largest.
    n_steps : int
        Places of a pane, on either side of the plane, at most.
    reach : float
        Images are next to points of a surface within this many of their spacings.
    n_near : int
        Points of the rest near each other, itself the first, that must agree.
    recess : float
        A pane is within this many radii of neighborhoods of the plane that is found around it.
    agree : float
        Share of the mirror images of a group that lie on real points.
    clear : float
        The same of a group that is evidence.
    evidence : float
        Points that a mirror explains beyond those of its other places, over the root of the latter.
    least : float
        Points of the groups that a mirror explains at least, of the least size of a surface.
    """

    explained: float = 3.0
    angle: float = 15.0
    n_sample: int = 1000
    n_tried: int = 8
    n_groups: int = 16
    n_planes: int = 16
    n_steps: int = 32
    reach: float = 2.5
    n_near: int = 9
    recess: float = 2.0
    agree: float = 0.5
    clear: float = 0.8
    evidence: float = 7.0
    least: float = 0.5


class Seen(NamedTuple):
    """What is known of the n points of a cloud.

    points, origins : ndarray of float64 of shape (n, d)
        And where the sensor stood.
    planes : Planes
    on_plane : ndarray of bool of shape (n,)
        Points of surfaces, whose planes count.
    rest : ndarray of bool of shape (n,)
        Points that no surface explains.
    spacing : ndarray of shape (n,)
        Mean distance to neighbors.
    radius : float
        Of neighborhoods on surfaces, the median.
    groups : callable
        Returns the group of each point, ndarray of int of shape (n,): parts of surfaces with what
        these explain, and groups of the rest.
    nearest : callable
        Returns distances and rows of the nearest of the points, (m, 1), for queries (m, d).
    """

    points: np.ndarray
    origins: np.ndarray
    planes: Planes
    on_plane: np.ndarray
    rest: np.ndarray
    spacing: np.ndarray
    radius: float
    groups: Callable
    nearest: Callable

    @classmethod
    def of(cls, judged, places, owners):
        """From a `JudgedCloud` whose surfaces and company are found."""
        index, planes = judged.model.index, judged.planes
        on_plane, explained = judged.explaining & ~judged.on_sheet, places.explained
        spacing = np.empty(len(index.points))
        spacing[~explained] = np.minimum(places.spacing, judged.company.usual)
        spacing[explained] = places.usual_spacing if explained.any() else 0.0
        radius = float(np.median(planes.radius[on_plane])) if on_plane.any() else 0.0

        @cache
        def groups():
            limits = judged.surface_limits
            links, width = link_limits(limits), min(limits.n_links, index.n_neighbors)
            parts, sizes = connected_planes(index, width, planes, links, on_plane)
            group = np.where(explained, parts[owners], -1).astype(np.int64)
            group[judged.company.rest] = len(sizes) + judged.company.groups
            return group

        return cls(
            index.points, judged.origins, planes, on_plane, ~explained, spacing, radius, groups,
            lambda queries: index.cloud.nearest(queries, 1),
        )  # fmt: skip


class Mirrors(NamedTuple):
    """Planes that mirror.

    normals : ndarray of shape (n_mirrors, n_features)
        Unit normals, toward the sensor.
    offsets : ndarray of shape (n_mirrors,)
        The points x of a plane have ``x @ normal == offset``.
    n_points : ndarray of int of shape (n_mirrors,)
        Reflections behind each.
    evidence : ndarray of shape (n_mirrors,)
        How clear each is: the points of groups that this place of the mirror alone explains, over
        what other places do, in standard deviations of chance.
    """

    normals: np.ndarray
    offsets: np.ndarray
    n_points: np.ndarray
    evidence: np.ndarray

    @classmethod
    def none(cls, d):
        """No mirrors in d dimensions."""
        return cls(np.empty((0, d)), np.empty(0), np.empty(0, int), np.empty(0))

    def scores(self, number):
        """The evidence of each point's mirror, by its number; 0 of points with -1."""
        return np.append(self.evidence, 0.0)[number]


class Images(NamedTuple):
    """Mirror images of m points for some places of a pane: arrays of shape (n_shifts, m).

    fits : ndarray of bool
        Whether they lie on real points before the pane.
    possible : ndarray of bool
        Whether they do, or lie next to these where the sensor cannot see.
    near : ndarray of int
        Rows of the points next to them.
    off : ndarray
        Distances from the planes of these.
    """

    fits: np.ndarray
    possible: np.ndarray
    near: np.ndarray
    off: np.ndarray


class Pane(NamedTuple):
    """A plane ``(x - center) @ normal == 0``, and where on it the points are that it is known by.

    scale : float
        Their noise.
    axes : ndarray of shape (3, 2)
    low, high : ndarray of shape (2,)
        Their extent along the axes.
    """

    center: np.ndarray
    normal: np.ndarray
    scale: float
    axes: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def margin(self):
        """Nearer points may be of the plane itself, and their images are next to them."""
        return 6 * self.scale

    def heights(self, points):
        return (points - self.center) @ self.normal

    def moved(self, shift):
        """The pane at another place along its normal."""
        return self._replace(center=self.center + shift * self.normal)

    def behind(self, seen, free):
        """Rows of the points that the sensor sees through the extent of the pane."""
        height, sensor = self.heights(seen.points), self.heights(seen.origins)
        rows = free & (height * sensor < 0)
        rows &= (np.abs(height) > self.margin) & (np.abs(sensor) > self.margin)
        rows = np.flatnonzero(rows)
        share = ratio(sensor[rows], sensor[rows] - height[rows])[:, None]
        places = seen.origins[rows] + share * (seen.points[rows] - seen.origins[rows])
        flat = (places - self.center) @ self.axes
        return rows[((flat >= self.low) & (flat <= self.high)).all(axis=1)]


def find_mirrors(seen, least, limits):
    """The mirrors of a cloud, and the points that are reflections in them.

    A plane of the cloud, or a place near it, is a mirror if there is evidence by groups of points
    that are seen through it, also through holes in it. Most mirror images of a group must lie on
    real points before the plane. That may be so by chance: what lies flat before a wall fits its
    mirror image wherever the mirror is. So other places of the mirror are tried, and only what
    a place explains beyond all others is evidence.

    Parameters
    ----------
    seen : Seen
    least : float
        Least size of a surface.
    limits : MirrorLimits

    Returns
    -------
    mirrors : Mirrors
    number : ndarray of int of shape (n,)
        Mirror of each point, -1 of those that are no reflections.
    """
    n, d = seen.points.shape
    number = np.full(n, -1)
    if d != 3:
        return Mirrors.none(d), number
    free, found, tried = number < 0, [], []
    for plane in large_planes(seen, least, limits):
        rows = plane.behind(seen, free)
        if len(rows) >= limits.least * least:
            evidence, pane, slack = place_pane(plane, rows, seen, limits, limits.least * least)
            if evidence > limits.evidence:
                tried.append((evidence, pane, slack))
    tried.sort(key=lambda trial: -trial[0])
    for _, plane, slack in tried:  # the clearest first, as others may share its points
        pane = adjust(plane, plane.behind(seen, free), seen, slack, limits)
        rows = pane.behind(seen, free)
        evidence, _ = best_place(
            pane, rows, seen, limits.n_steps // 2, 0.0, limits, limits.least * least
        )
        rows = rows[mirrored(pane, rows, seen, limits)]
        if evidence <= limits.evidence or len(rows) < limits.least * least:
            continue
        number[rows], free[rows] = len(found), False
        side = np.sign(np.median(np.sign(pane.heights(seen.origins[rows])))) or 1.0
        normal = side * pane.normal
        found.append((normal, normal @ pane.center, len(rows), evidence))
    if not found:
        return Mirrors.none(d), number
    return Mirrors(*(np.array(values) for values in zip(*found, strict=True))), number


def large_planes(seen, least, limits):
    """Planes of many points on surfaces, wherever on the plane these are: list of `Pane`.

    Each grows from the flattest point that is left, to twice the distance at a time.
    """
    planes, rows = seen.planes, np.flatnonzero(seen.on_plane)
    if not len(rows):
        return []
    # The order of flatness is that of no row, and stays when the cloud is turned.
    rows = rows[np.argsort(planes.scale[rows] / planes.radius[rows], kind="stable")]
    each = max(1.0, len(rows) / limits.n_sample)
    rows = rows[(np.arange(int(len(rows) / each)) * each).astype(int)]
    fewest = max(least / each, limits.n_tried)
    cosine, found = np.cos(np.radians(limits.angle)), []
    while len(rows) >= fewest:
        points, normals, scales = seen.points[rows], planes.normals[rows], planes.scale[rows]
        center, normal = planes.centroids[rows[0]], normals[0]
        away = np.linalg.norm(points - points[0], axis=1)
        radius, extent = 2 * planes.radius[rows[0]], away.max()
        while True:
            height = np.abs((points - center) @ normal)
            near = (away <= radius) & (height <= limits.explained * scales)
            near &= np.abs(normals @ normal) >= cosine
            if np.count_nonzero(near) >= limits.n_tried:
                center = points[near].mean(axis=0)
                normal = np.linalg.eigh(np.cov(points[near].T))[1][:, 0]
            if radius > extent:
                break
            radius *= 2
        near[0] = True
        if np.count_nonzero(near) >= fewest:
            found.append((points[near], np.median(scales[near])))
        rows = rows[~near]
    found.sort(key=lambda part: -len(part[0]))
    return [_pane(*part) for part in found[: limits.n_planes]]


def _pane(points, scale):
    center = points.mean(axis=0)
    vectors = np.linalg.eigh(np.cov(points.T))[1]
    flat = (points - center) @ vectors[:, 1:]
    return Pane(
        center, vectors[:, 0], float(scale), vectors[:, 1:], flat.min(axis=0), flat.max(axis=0)
    )


def place_pane(plane, rows, seen, limits, least):
    """Where near a plane its pane is.

    Returns
    -------
    evidence : float
    pane : Pane
    slack : float
        How far from there it may be.
    """
    noise = limits.explained * plane.scale
    n_steps = int(np.clip(np.ceil(limits.recess * seen.radius / noise), 1, limits.n_steps))
    slack = max(limits.recess * seen.radius / n_steps - noise, 0.0)
    evidence, shift = best_place(plane, rows, seen, n_steps, slack, limits, least)
    return evidence, plane.moved(shift), slack


def best_place(pane, rows, seen, n_steps, slack, limits, least):
    """The evidence for the best of 2 n_steps + 1 places of a pane, and which place this is.

    Returns
    -------
    evidence : float
        Points in groups that this place alone explains, over those of the next best, in standard
        deviations of chance.
    shift : float
    """
    rows, sizes = some_of_groups(pane, rows, seen, limits)
    if sizes.sum() < least:
        return 0.0, 0.0
    recess = limits.recess * seen.radius
    shifts = recess * np.arange(-n_steps, n_steps + 1) / n_steps
    found, normals = images_of(pane, shifts, rows, seen, slack, limits), seen.planes.normals
    turned = np.abs(normals[found.near] @ pane.normal) < np.cos(np.radians(limits.angle))
    counts = found.fits & (turned | ~seen.on_plane[found.near])
    # Halves of one thing agree about its middle.
    counts &= seen.groups()[found.near] != seen.groups()[rows]
    share = counts.reshape(len(shifts), len(sizes), -1).mean(axis=2)
    # A group is evidence if there is one place where it is explained, with others around.
    near = np.median(seen.spacing[rows])
    apart = np.abs(shifts[:, None] - shifts) > near
    alone = (share > limits.clear) & ~(apart.astype(float) @ (share > limits.agree) > 0)
    alone[np.abs(shifts) > recess - near] = False
    n_points = alone @ sizes
    best = np.lexsort((-np.abs(shifts), found.fits.sum(axis=1), n_points))[-1]
    chance = n_points[apart[best]].max(initial=0)
    return (n_points[best] - chance) / np.sqrt(max(chance, least)), shifts[best]


def some_of_groups(plane, rows, seen, limits):
    """As many points of each group that can tell the place of a pane, evenly by their depth.

    Two walls that are parallel to a pane agree at some place of it, and ground on both sides at
    all places. What is near the pane may be next to itself. These do not tell.

    Returns
    -------
    rows : ndarray of int of shape (n_groups * n_tried,)
    sizes : ndarray of int of shape (n_groups,)
    """
    depth = np.abs(plane.heights(seen.points[rows]))
    slope = np.abs(seen.planes.normals[rows] @ plane.normal)
    angle = np.radians(limits.angle)
    oblique = ~seen.on_plane[rows] | ((slope > np.sin(angle)) & (slope < np.cos(angle)))
    telling = oblique & (depth > limits.recess * seen.radius)
    rows, depth = rows[telling], depth[telling]
    _, group, sizes = np.unique(seen.groups()[rows], return_inverse=True, return_counts=True)
    order = np.lexsort((depth, group))  # no order of rows
    first = np.cumsum(sizes) - sizes
    large = np.flatnonzero(sizes >= limits.n_tried)
    large = large[np.argsort(-sizes[large], kind="stable")[: limits.n_groups]]
    ranks = np.arange(limits.n_tried) + 0.5
    some = first[large][:, None] + (ranks * sizes[large][:, None] / limits.n_tried).astype(int)
    return rows[order[some.ravel()]], sizes[large]


def images_of(pane, shifts, rows, seen, slack, limits):
    """The mirror `Images` of m rows.

    Parameters
    ----------
    shifts : ndarray of shape (n_shifts,)
        Places of the pane along its normal.
    slack : float
        How far the pane may be from there.
    """
    height = pane.heights(seen.points[rows]) - shifts[:, None]
    images = seen.points[rows] - 2 * height[..., None] * pane.normal
    away, near = seen.nearest(images.reshape(-1, 3))
    away, near = away.reshape(height.shape), near.reshape(height.shape)
    planes, spacing = seen.planes, seen.spacing[near]
    off = np.einsum("omd,omd->om", images - planes.centroids[near], planes.normals[near])
    reach = limits.explained * np.hypot(planes.scale[near], pane.scale) + 2 * slack
    beside = away <= limits.reach * spacing
    own = planes.normals[rows] - 2 * np.outer(planes.normals[rows] @ pane.normal, pane.normal)
    agreed = np.abs(np.einsum("omd,md->om", planes.normals[near], own))
    agreed = (agreed >= np.cos(np.radians(limits.angle))) | ~seen.on_plane[rows]
    fits = np.where(seen.on_plane[near], beside & agreed & (np.abs(off) <= reach), away <= spacing)
    side = np.sign(pane.heights(seen.origins[rows]))
    before = (pane.heights(seen.points[near]) - shifts[:, None]) * side
    # A mirror shows the far side of things, which the sensor does not see.
    rays = seen.points[near] - seen.origins[near]
    beside &= np.einsum("omd,omd->om", images - seen.points[near], rays) > 0
    before = before > pane.margin
    return Images(fits & before, (fits | beside) & before, near, off)


def adjust(pane, rows, seen, slack, limits):
    """The parallel pane whose images lie best on the planes of real points: least squares."""
    for widened in (slack, slack / 4, 0.0):
        found = images_of(pane, HERE, rows, seen, widened, limits)
        fits, near, off = found.fits[0], found.near[0], found.off[0]
        fits = fits & seen.on_plane[near] & mostly(fits, rows, seen, limits)
        near, off = near[fits], off[fits]
        slope = 2 * (seen.planes.normals[near] @ pane.normal)  # of the distances, by the shift
        weights = slope / (seen.planes.scale[near] ** 2 + pane.scale**2)
        pane = pane.moved(-float(ratio(weights @ off, weights @ slope)))
    return pane


def mirrored(pane, rows, seen, limits):
    """Which of the rows are of groups most of whose mirror images lie on real points."""
    found = images_of(pane, HERE, rows, seen, 0.0, limits)
    # The plane around a pane is uneven itself.
    along = np.abs(seen.planes.normals[found.near[0]] @ pane.normal)
    uneven = seen.on_plane[found.near[0]] & (along > np.cos(np.radians(limits.angle)))
    uneven &= np.abs(pane.heights(seen.points[rows])) < limits.recess * seen.radius
    return mostly(found.possible[0] & ~uneven, rows, seen, limits)


def mostly(fits, rows, seen, limits):
    """Which of the rows are of groups most of which fit.

    Groups of the rest grow together where a reflection and a thing behind the pane meet: of these
    the nearest are asked.
    """
    _, group = np.unique(seen.groups()[rows], return_inverse=True)
    most = (ratio(np.bincount(group, fits), np.bincount(group)) > limits.agree)[group]
    rest = np.flatnonzero(seen.rest[rows])
    if len(rest):
        points = seen.points[rows[rest]]
        near = cKDTree(points).query(points, k=np.arange(1, min(limits.n_near, len(rest)) + 1))[1]
        most[rest] = fits[rest] & (fits[rest][near].mean(axis=1) > limits.agree)
    return most
