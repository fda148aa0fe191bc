"""Faces a few points wide beside larger ones: what growth left over, grown by itself."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._indexed_cloud import distinct_numbers
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
from sklearn_mcmd.segmentation._region_sums import median_by_region, n_regions_of, region_sizes

TINY = np.finfo(np.float64).tiny  # least noise: no division by zero of points at the origin
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
        # Step 1: points that lie off the surfaces of all larger regions around them.
        planes, left_over = self.planes, np.flatnonzero(~surface[labels])
        usual = median_by_region(planes.scale, labels, len(sizes))
        outer = np.where(surface, np.append(np.maximum(usual, TINY), np.inf), np.inf)
        # Many points, of which most are in the tails of the noise: the nearer half tells.
        _, share, flattest = self._nearest(left_over, n_within_median(self.k) + 1, labels, outer)
        off = np.flatnonzero((share > cutoff) & np.isfinite(share))
        off = off[np.lexsort(self.index.points[left_over[off]].T)]  # as `by_place`
        # Step 2: faces of these, by planes of their own.
        rows, face = self._faces(left_over[off], flattest[off])
        if len(rows) == 0:
            return labels
        first = len(sizes)
        labels[rows] = first + face
        self._refit(labels, rows)  # points of other faces were among those asked
        of_faces = median_by_region(planes.scale[rows], face, int(face.max()) + 1)
        usual = np.concatenate([outer[:-1], np.maximum(of_faces, TINY), [np.inf]])
        # Step 3: points around go to the surface on which they lie best.
        fresh, members = rows, by_place(self.index.points, rows)
        while len(fresh):
            around = distinct_numbers(self.index.query_own(fresh, self.k).indices)
            around = around[labels[around] < first]
            owner, share, _ = self._nearest(around, self.k, labels, usual)
            won = (owner >= first) & (share <= cutoff)
            fresh = around[won]
            labels[fresh] = owner[won]
            # Handed on as it is, a plane leads off no face; one fitted to an edge's points would.
            self._lend(labels, members, fresh)
            members = by_place(self.index.points, np.union1d(members, fresh))
        return labels

    def _nearest(self, rows, k, labels, usual):
        """The region on whose surface each of m rows lies best among k neighbors, and how well.

        Not the question of `explain`: a surface is the median of a region's planes around. Single
        planes told worse (Rand .1 to .8, IoU up to 4.5 points of 100 on scenes of 20,000 points).
        `usual` (n_regions + 1,) is the noise that is usual in each region; inf for those that count
        for none, the last. Returns the region, -1 where there is none around; the distance from its
        surface in units of its usual noise, inf where there is none; and the least usual noise of
        the regions around.
        """
        m = len(rows)
        owner, share, flattest = np.full(m, -1), np.full(m, np.inf), np.full(m, np.inf)

        def task(part):
            row, region, height = self._heights(rows[part], k, labels, usual)
            height /= usual[region]
            np.minimum.at(flattest[part], row, usual[region])
            order = np.lexsort((region, height, row))
            best = order[np.flatnonzero(np.diff(row[order], prepend=-1))]
            owner[part][row[best]], share[part][row[best]] = region[best], height[best]

        self._each_part(m, task)
        return owner, share, flattest

    def _heights(self, rows, k, labels, usual):
        """Distances of rows from the regions around: places in `rows`, regions, distances."""
        points, planes, most_noise = self.index.points, self.planes, JoinLimits().most_noise
        near = self.index.query_own(rows, k).indices
        region = labels[near]
        quiet = np.isfinite(usual)[region] & (planes.scale[near] <= most_noise * usual[region])
        heights = np.zeros(near.shape)
        for axis in range(points.shape[1]):
            gaps = points[rows, axis][:, None] - planes.centroids[near, axis]
            heights += gaps * planes.normals[near, axis]
        row, column = np.nonzero(quiet)
        region, heights = region[row, column], np.abs(heights[row, column])
        # The median, the lower one of two, of the heights over each region's planes around a row.
        key = row * len(usual) + region
        order = np.lexsort((heights, key))
        start = np.flatnonzero(np.diff(key[order], prepend=-1))
        count = np.diff(start, append=len(key))
        middle = order[start + (count - 1) // 2]
        return row[middle], region[middle], heights[middle]

    def _faces(self, rows, flattest):
        """Regions of rows by planes among themselves: rows, and the face of each, from 0 on."""
        if len(rows) <= self.k:
            return rows[:0], rows[:0]
        reach = NarrowFaceLimits().reach
        planes = self._planes(rows, np.zeros(len(rows), dtype=np.intp))
        flat = planes.scale <= JoinLimits().most_noise * flattest
        rows, planes = rows[flat], planes.take(flat)
        if len(rows) <= self.k:
            return rows[:0], rows[:0]
        index = NeighborIndex(self.index.points[rows], self.k)
        rows, planes = rows[index.rows], planes.take(index.rows)
        radius = self.planes.radius[rows]
        links, _ = link_neighbors(index, planes, self.floor[rows], self.rules, self.n_jobs)
        gaps = index.points[:, None] - index.points[links]
        far = np.square(gaps).sum(axis=-1) > np.square(reach * radius)[:, None]
        links[far] = -1
        face = grow_regions(links, np.argsort(planes.scale, kind="stable"))
        face = join_coplanar(index.points, face, planes._replace(radius=radius))
        large = np.bincount(face) > self.k
        number = np.where(large, np.cumsum(large) - 1, -1)
        inside = large[face]
        return rows[inside], number[face[inside]]

    def _refit(self, labels, rows):
        """Give rows the planes of their own regions' points."""
        planes = self._planes(rows, labels[rows])
        fitted = np.isfinite(planes.scale)
        rows, planes = rows[fitted], planes.take(fitted)
        self._put(rows, planes._replace(scale=np.maximum(planes.scale, self.floor[rows])))

    def _lend(self, labels, members, rows):
        """Give rows the plane of the nearest member of their face."""
        points = self.index.points
        lenders, face_of_rows, face = np.empty_like(rows), labels[rows], labels[members]
        for name in np.unique(face_of_rows).tolist():
            borrowing, of_face = face_of_rows == name, members[face == name]
            nearest = cKDTree(points[of_face]).query(points[rows[borrowing]])[1]
            lenders[borrowing] = of_face[nearest]
        self._put(rows, self.planes.take(lenders))

    def _put(self, rows, planes):
        """Overwrite what is known of the planes of some rows."""
        for name in ("centroids", "normals", "scale"):
            getattr(self.planes, name)[rows] = getattr(planes, name)

    def _planes(self, rows, group):
        """Planes of the rows of the same group within reach; their scale is inf of too few."""
        points, reach = self.index.points[rows], NarrowFaceLimits().reach * self.planes.radius[rows]
        (m, d), k = points.shape, min(self.k, len(rows))
        planes = Planes.unknown(m, d)
        tree = cKDTree(points, balanced_tree=False)

        def task(part):
            distances, near = tree.query(points[part], k=k)
            distances, near = distances.reshape(-1, k), near.reshape(-1, k)
            valid = distances <= reach[part, None]
            valid &= group[near] == group[part][:, None]
            gaps = points[near] - points[part][:, None]
            means, eigenvalues, axes = fit_planes(gaps, valid)
            size = valid.sum(axis=1)
            planes.centroids[part], planes.normals[part] = points[part] + means, axes[..., 0]
            # d numbers determine a plane; of fewer than 2 d points it says nothing.
            variance = np.maximum(eigenvalues[:, 0], 0.0) * size / np.maximum(size - d, 1)
            planes.scale[part] = np.where(size >= 2 * d, np.sqrt(variance), np.inf)

        self._each_part(m, task)
        return planes

    def _each_part(self, m, task):
        run([(part,) for part in slices(m, max(1, CHUNK // self.k))], task, self.n_jobs)

    @property
    def k(self):
        """Size of a neighborhood."""
        return self.index.n_neighbors
