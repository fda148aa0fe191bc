"""Faces a few points wide beside larger ones: what growth left over, grown by itself."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._principal_planes import fit_planes
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import run, slices
from sklearn_mcmd.segmentation._graph import (
    GrowthRules,
    by_place,
    grow_regions,
    link_neighbors,
    n_within_median,
)
from sklearn_mcmd.segmentation._merge_coplanar import JoinLimits, join_coplanar
from sklearn_mcmd.segmentation._parts import Parts
from sklearn_mcmd.segmentation._region_sums import median_by_region, n_regions_of, region_sizes

ROWS = 2**16  # points at once, of which those off all regions are asked for
TINY = np.finfo(np.float64).tiny  # least noise: no division by zero of points at the origin
FITTED = "centroids", "normals", "scale"  # what becomes known of the planes of faces
CHUNK = 30_000  # neighbors looked at at once: what they need stays in the processor's cache


class NarrowFaceLimits(NamedTuple):
    """What a narrow face is."""

    # Points that have a plane together are no farther from each other than this many times the
    # radius that growth looks at: a strip has fewer points within it than a face on all sides.
    reach: float = 2.0


@dataclass(frozen=True)
class NarrowFaces:
    """Grows regions of the points that lie off all larger regions around them.

    A region's surface is told by its planes that are no noisier than is usual in it, the median of
    those around a point: single planes that run across the edge, or were lent to a point of
    the wrong face, count for nothing. Its deviation is the region's usual noise, so nothing
    depends on the unit. Planes of a face are, by the same measure, no noisier than those of the
    flattest region beside it.
    """

    index: NeighborIndex
    planes: Planes  # of all points; those of faces' points are changed in place
    floor: np.ndarray  # (n,), the least standard deviation of a plane: what rounding amounts to
    rules: GrowthRules
    parts: Parts
    n_jobs: int | None

    def grow(self, labels):
        """Find faces, which come last, and let them take in points around that lie on them best:
        labels, changed.

        Faces are larger than a neighborhood, as are the regions that count as surfaces; the smaller
        ones are part of what growth left over. The points of faces get planes of their own.
        """
        cutoff = ExplainLimits().explained
        sizes = region_sizes(labels, n_regions_of(labels))
        surface = np.append(sizes > self.k, False)  # the last is -1
        if len(labels) - sizes[surface[:-1]].sum() <= self.k or not surface.any():
            return labels
        planes = self.planes.without("eigenvalues", "kept", "radius", "spacing", "normal_error")
        usual = median_by_region(planes.scale, labels, len(sizes), self.parts)
        outer = np.where(surface, np.append(np.maximum(usual, TINY), np.inf), np.inf)
        known = labels, ~surface, self.index, planes, outer
        found = self.parts.each(_off_surfaces, *known, size=ROWS)
        off, flattest = map(np.concatenate, zip(*found, strict=True))
        order = np.lexsort(self.index.points[off].T)  # as `by_place`
        rows, face = self._faces(off[order], flattest[order])
        if len(rows) == 0:
            return labels
        first, planes = len(sizes), _Revised(planes)
        labels[rows] = first + face
        self._refit(labels, planes, rows)  # points of other faces were among those asked
        own = median_by_region(planes.take(rows).scale, face, int(face.max()) + 1)
        own = np.maximum(own, TINY)
        usual = np.concatenate([outer[:-1], own, [np.inf]])
        fresh, members = rows, by_place(self.index.points, rows)
        while len(fresh):
            around = np.unique(self.index.query_own(fresh, self.k).indices)
            around = around[labels[around] < first]
            owner, share = np.empty(len(around), np.intp), np.empty(len(around))

            def ask(part, some=around, owner=owner, share=share):
                near = self.index.query_own(some[part], self.k).indices
                known = labels[near], self.index.points[some[part]], planes.take(near.ravel())
                owner[part], share[part], _ = _nearest(*known, usual)

            self._each_part(len(around), ask)
            won = (owner >= first) & (share <= cutoff)
            fresh = around[won]
            labels[fresh] = owner[won]
            # Handed on as it is, a plane leads off no face; one fitted to an edge's points would.
            self._lend(labels, planes, members, fresh)
            members = by_place(self.index.points, np.union1d(members, fresh))
        for name in FITTED:
            getattr(self.planes, name)[planes.rows] = getattr(planes.own, name)
        return labels

    def _faces(self, rows, flattest):
        """Regions of rows by planes among themselves: rows, and the face of each, from 0 on."""
        if len(rows) <= self.k:
            return rows[:0], rows[:0]
        reach, planes = NarrowFaceLimits().reach, self.planes
        found = self._planes(rows, np.zeros(len(rows), dtype=np.intp))
        flat = found.scale <= JoinLimits().most_noise * flattest
        rows, found = rows[flat], found.take(flat)
        if len(rows) <= self.k:
            return rows[:0], rows[:0]
        index = NeighborIndex(self.index.points[rows], self.k)
        rows, found = rows[index.rows], found.take(index.rows)
        links, _ = link_neighbors(index, found, self.floor[rows], self.rules, self.n_jobs)
        gaps = index.points[:, None] - index.points[links]
        far = np.square(gaps).sum(axis=-1) > np.square(reach * planes.radius[rows])[:, None]
        links[far] = -1
        face = grow_regions(links, np.argsort(found.scale, kind="stable"))
        face = join_coplanar(index.points, face, found._replace(radius=planes.radius[rows]))
        large = np.bincount(face) > self.k
        number = np.where(large, np.cumsum(large) - 1, -1)
        inside = large[face]
        return rows[inside], number[face[inside]]

    def _refit(self, labels, planes, rows):
        """Planes of which rows have those of their own regions' points."""
        found = self._planes(rows, labels[rows])
        fitted = np.isfinite(found.scale)
        rows, found = rows[fitted], found.take(fitted)
        planes.put(rows, found._replace(scale=np.maximum(found.scale, self.floor[rows])))

    def _lend(self, labels, planes, members, rows):
        """Planes of which rows have that of the nearest member of their face."""
        points = self.index.points
        lenders, own_face, face = np.empty_like(rows), labels[rows], labels[members]
        for name in np.unique(own_face).tolist():
            own, others = own_face == name, members[face == name]
            lenders[own] = others[cKDTree(points[others]).query(points[rows[own]])[1]]
        planes.put(rows, planes.take(lenders))

    def _planes(self, rows, group):
        """Planes of the rows of the same group within reach; their scale is inf of too few."""
        points, reach = self.index.points[rows], NarrowFaceLimits().reach * self.planes.radius[rows]
        (m, d), k = points.shape, min(self.k, len(rows))
        found = Planes.unknown(m, d)
        tree = cKDTree(points, balanced_tree=False)

        def task(part):
            distances, near = tree.query(points[part], k=k)
            distances, near = distances.reshape(-1, k), near.reshape(-1, k)
            valid = distances <= reach[part, None]
            valid &= group[near] == group[part][:, None]
            gaps = points[near] - points[part][:, None]
            means, eigenvalues, axes = fit_planes(gaps, valid)
            size = valid.sum(axis=1)
            found.centroids[part], found.normals[part] = points[part] + means, axes[..., 0]
            variance = np.maximum(eigenvalues[:, 0], 0.0) * size / np.maximum(size - d, 1)
            found.scale[part] = np.where(size >= 2 * d, np.sqrt(variance), np.inf)

        self._each_part(m, task)
        return found

    def _each_part(self, m, task):
        run([(part,) for part in slices(m, max(1, CHUNK // self.k))], task, self.n_jobs)

    @property
    def k(self):
        """Size of a neighborhood."""
        return self.index.n_neighbors


class _Revised:
    """Planes of which some rows are overwritten here, and nowhere else."""

    def __init__(self, planes):
        self._planes, self.rows, self.own = planes, np.empty(0, np.intp), planes.take(slice(0))

    def take(self, rows):
        """The planes of some rows, as they now are."""
        found = self._planes.take(rows)
        place = np.searchsorted(self.rows, rows)
        some = np.flatnonzero(np.append(self.rows, -1)[place] == rows)
        found.put(some, self.own.take(place[some]))
        return found

    def put(self, rows, found):
        """Overwrite what is `FITTED` of some rows."""
        self.rows, place = np.unique(np.append(rows, self.rows), return_index=True)
        joined = {
            name: np.concatenate([getattr(found, name), getattr(self.own, name)])[place]
            for name in FITTED
        }
        self.own = self.own._replace(**joined)


def _off_surfaces(part, labels, wanted, index, planes, usual):
    """Rows of a part, of wanted regions, that lie off all surfaces around, if there are any; and
    the least usual noise of these."""
    rows, k = part.start + np.flatnonzero(wanted[labels[part]]), index.n_neighbors
    # Many points, of which most are in the tails of the noise: the nearer half tells.
    k, found = n_within_median(k) + 1, [(rows[:0], np.empty(0))]
    for some in slices(len(rows), max(1, CHUNK // k)):
        own = rows[some]
        near = index.query_own(own, k).indices
        known = labels[near], index.points[own], planes.take(near.ravel())
        _, share, flattest = _nearest(*known, usual)
        off = (share > ExplainLimits().explained) & np.isfinite(share)
        found.append((own[off], flattest[off]))
    return tuple(map(np.concatenate, zip(*found, strict=True)))


def _nearest(region, points, planes, usual):
    """The region on whose surface each of m points lies best, and how well.

    Not the question of `explain`: a surface is the median of a region's planes around. Single
    planes told worse (Rand .1 to .8, IoU up to 4.5 points of 100 on scenes of 20,000 points).
    `region` (m, k) are those of neighbors, which have the planes (m * k). `usual` (n_regions + 1,)
    is the noise that is usual in each region; inf for those that count for none, the last. Returns
    the region, -1 where there is none around; the distance from its surface in units of its usual
    noise, inf where there is none; and the least usual noise of the regions around.
    """
    m = len(points)
    owner, share, flattest = np.full(m, -1), np.full(m, np.inf), np.full(m, np.inf)
    row, region, height = _heights(region, points, planes, usual)
    height /= usual[region]
    np.minimum.at(flattest, row, usual[region])
    order = np.lexsort((region, height, row))
    best = order[np.flatnonzero(np.diff(row[order], prepend=-1))]
    owner[row[best]], share[row[best]] = region[best], height[best]
    return owner, share, flattest


def _heights(region, points, planes, usual):
    """Distances of points from the regions around: their numbers, regions, distances."""
    scale = planes.scale.reshape(region.shape)
    known = np.isfinite(usual)[region] & (scale <= JoinLimits().most_noise * usual[region])
    heights = np.zeros(region.shape)
    for axis in range(points.shape[1]):
        centroids, normals = (
            values[:, axis].reshape(region.shape) for values in (planes.centroids, planes.normals)
        )
        heights += (points[:, axis][:, None] - centroids) * normals
    row, column = np.nonzero(known)
    region, heights = region[row, column], np.abs(heights[row, column])
    key = row * len(usual) + region
    order = np.lexsort((heights, key))
    start = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(start, append=len(key))
    middle = order[start + (count - 1) // 2]
    return row[middle], region[middle], heights[middle]
