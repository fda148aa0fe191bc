"""A cell with its halo: the points of others on which the results of its own depend.

A point's result depends on its neighbors, on theirs, and so on for some hops: these rings of
neighbors are the halo of a cell. They are sought among the points within a margin around it, which
widens until the rings are complete. Beyond the width of a cell, or where single points are far from
all others, what is seen counts; how many points are then not proven is told.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._indexed_cloud import IndexedCloud
from sklearn_mcmd.planes._neighbor_table import part_size
from sklearn_mcmd.runtime._chunks import each_slice

# How far a result depends on others, as of `part_of_cell`.
HOPS = 5  # of planes: neighbors agree on them in two, then noise, bends and edges ask again
HOPS_OF_SIZES = 17  # where noise decides how many neighbors each has
HOPS_MORE = 1  # of outliers, regions and edges: planes explain points, are linked, and meet
WIDTH = 5.0  # of outliers and regions: groups have gaps, and what regions of two cells share tells
# Of so many places in succession, or of as many as make so many blocks, it is known in which others
# they have neighbors: finer takes more memory, coarser more time.
BLOCK, BLOCKS = 256, 4096


class HaloLimits(NamedTuple):
    """How far the halo of a cell is sought."""

    # The margin widens while more of the places that were asked may have neighbors beyond it.
    incomplete: float = 0.01
    most: float = 4.0  # points to search at most, as a multiple of the cell's own


class Part(NamedTuple):
    """The points of a cell and of its halo, in the order of their rows in the inputs."""

    xyz: np.ndarray  # float64 (n, 3)
    rows: np.ndarray  # (n,)
    own: np.ndarray  # bool (n,), whether a point is of the cell
    homes: np.ndarray  # int (n,), the cell of each,
    at: np.ndarray  # and its number there
    # (n,): how far its neighbors may be, in places as of `Cells`, and all of them are in the part.
    reach: np.ndarray
    ranges: np.ndarray | None = None  # (n,) from the center of the cells, if they have one

    @classmethod
    def of(cls, *columns):
        """Of columns in another order."""
        order = np.argsort(columns[1], kind="stable")
        return cls._make(None if values is None else values[order] for values in columns)

    def joined(self, xyz, rows, homes, at):
        """The part with some of more points: those that it has not, neighbors of none of the
        rings."""
        new = ~np.isin(rows, self.rows)
        n = np.count_nonzero(new)
        more = xyz[new], rows[new], np.zeros(n, bool), homes[new], at[new], np.full(n, np.inf)
        return Part.of(*map(np.concatenate, zip(self[:6], more, strict=True)), None)

    def taken(self, chosen):
        """Some of the points."""
        return Part._make(None if values is None else values[chosen] for values in self)

    def proven(self, cloud, n_neighbors, hops, n_jobs):
        """Which of the own points have the results of the whole cloud: the neighbors of these are
        in the part, and so are theirs, hop by hop. `cloud` is the `IndexedCloud` of the points.
        """
        n, k = len(cloud.points), min(n_neighbors, len(cloud.points))
        doubtful, reach = np.zeros(n, bool), self.reach[cloud.rows]
        ranges = None if self.ranges is None else self.ranges[cloud.rows]
        size, block = part_size(k), max(BLOCK, -(-n // BLOCKS))
        n_blocks = -(-n // block)
        asks = np.zeros((n_blocks, n_blocks), bool)  # which blocks have neighbors in which

        def measure(rows):
            near = cloud.neighbors(rows, k, k)
            radius = np.linalg.norm(cloud.points[near[:, -1]] - cloud.points[rows], axis=1)
            doubtful[rows] = seen_from(radius, ranges, rows) >= reach[rows]
            asks[np.arange(rows.start, rows.stop)[:, None] // block, near // block] = True

        each_slice(n, size, measure, n_jobs)
        new = doubtful
        for _ in range(hops):
            hit, before = np.zeros(n_blocks, bool), doubtful.copy()
            hit[np.flatnonzero(new) // block] = True
            asking = np.repeat(asks[:, hit].any(axis=1), block)[:n] & ~before
            rows = np.flatnonzero(asking)

            def spread(some, rows=rows, before=before):
                near = cloud.neighbors(rows[some], k, k)
                doubtful[rows[some]] = before[near].any(axis=1)

            each_slice(len(rows), size, spread, n_jobs)
            new = doubtful & ~before
        return ~doubtful[cloud.places[self.own]]


def part_of_cell(cells, cell, n_neighbors, hops, width, usual):
    """The `Part` of a cell: as many rings of `n_neighbors` as there are hops, and all points nearer
    than the `width`. This is in units of the `usual`, which is about how far the last of a point's
    neighbors is, in places as of `Cells`."""
    own_xyz, own_rows = cells.points(cell), np.asarray(cells.rows(cell))
    n_own = len(own_xyz)
    own_homes, own_at = np.full(n_own, cell, np.int32), np.arange(n_own)
    if len(cells) == 1:
        every = np.ones(n_own, bool)
        return Part(own_xyz, own_rows, every, own_homes, own_at, np.full(n_own, np.inf))
    limits, length = HaloLimits(), float(np.ptp(cells.extent(cell), axis=0).max())
    margin = 2 * max(hops, width) * usual or length / 16 or 1.0  # 0 of a sample of copies
    while True:
        halo = cells.within(cell, margin)
        xyz = np.concatenate([own_xyz, halo[0]])
        rings = Rings(cells, cell, xyz, n_own, margin)
        has_all, has_few = len(xyz) == cells.n_points, len(rings.cloud.points) <= n_neighbors
        if has_few and not has_all:  # distinct ones: copies have no plane
            margin *= 2
            continue
        rings.grow(n_neighbors, hops)
        rings.widen(width * usual)
        is_wide = has_all or margin >= length or len(xyz) > limits.most * n_own
        if is_wide or rings.incomplete <= limits.incomplete:
            break
        margin = min(2 * margin, length)
    places = rings.cloud.places
    ranges = None if rings.ranges is None else rings.ranges[places]
    own: tuple = own_rows, own_homes, own_at
    rows, homes, at = map(np.concatenate, zip(own, halo[1:], strict=True))
    part = Part(xyz, rows, np.arange(len(xyz)) < n_own, homes, at, rings.reach[places], ranges)
    part = part.taken(rings.inside[places])
    return Part.of(*part)


class Rings:
    """The rings of neighbors around the own points of a cell, the first n of `xyz`, which holds all
    within a margin around its box."""

    def __init__(self, cells, cell, xyz, n_own, margin):
        self.cloud = cloud = IndexedCloud(xyz)
        places = cells.places(cloud.points)
        low, high = cells.low[cell], cells.high[cell]
        self.inside = np.zeros(len(places), bool)  # of the own points and the rings
        self.inside[cloud.places[:n_own]] = True
        # How far each place is from the box, and from where the margin ends.
        self.depth = np.minimum(places - low, high - places).min(axis=1)
        self.border = np.minimum(places - low + margin, high + margin - places).min(axis=1)
        self.ranges = None
        if cells.center is not None:
            self.ranges = np.linalg.norm(cloud.points - cells.center, axis=1)
        self.reach, self.incomplete = self.depth.copy(), 0.0

    def grow(self, n_neighbors, hops):
        """Add ring by ring."""
        k, n_asked, n_incomplete = min(n_neighbors, len(self.cloud.points)), 0, 0
        ring = np.flatnonzero(self.inside & (self.depth <= self._farthest(k)))
        for _ in range(hops):
            if not len(ring):  # the points of no other cell are neighbors
                break
            distances, near = self.cloud.nearest(self.cloud.points[ring], k)
            radius = seen_from(distances[:, -1], self.ranges, ring)
            self.reach[ring] = self.border[ring]
            known = radius < self.border[ring]  # of others, neighbors may be missing anyway
            n_asked += len(ring)
            n_incomplete += int(np.count_nonzero(~known))
            new = np.zeros(len(self.inside), bool)
            new[near[known]] = True
            ring = np.flatnonzero(new & ~self.inside)
            self.inside[ring] = True
        self.reach[ring] = np.inf  # whose neighbors matter to no own point
        self.incomplete = n_incomplete / max(1, n_asked)

    def _farthest(self, k):
        """How far the k-th neighbor of each place is at most: no farther than the end of a box
        around k places in succession, of which it is one."""
        points = self.cloud.points
        starts = np.arange(max(1, len(points) // k)) * k
        of = np.minimum(np.arange(len(points)) // k, len(starts) - 1)
        low, high = (f.reduceat(points, starts)[of] for f in (np.minimum, np.maximum))
        ends = np.linalg.norm(np.maximum(points - low, high - points), axis=1)
        return seen_from(ends, self.ranges, slice(None))

    def widen(self, width):
        """Add all places nearer to the box than the width."""
        near = (self.depth > -width) & ~self.inside
        self.inside[near], self.reach[near] = True, np.inf


def seen_from(radius, ranges, rows):
    """Radii around some places, as angles from the center that is at these ranges, if there is
    one; inf where the center is within a radius."""
    if ranges is None:
        return radius
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = radius / ranges[rows]
        return np.where(sine < 1, np.arcsin(np.minimum(sine, 1.0)), np.inf)
