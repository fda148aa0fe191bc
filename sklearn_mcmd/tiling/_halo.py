"""A cell with its halo: the points of others on which the results of its own depend.

A point's result depends on its neighbors, on theirs, and so on for some hops: these rings of
neighbors are the halo of a cell. They are sought among the points within a margin around it, which
widens until the rings are complete. Beyond the width of a cell, or where single points are far from
all others, what is seen counts; how many points are then not proven is told.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.planes._indexed_cloud import LEAF, IndexedCloud
from sklearn_mcmd.planes._neighbor_table import part_size
from sklearn_mcmd.runtime._chunks import each_slice

# How far a result depends on others, as of `part_of_cell`.
HOPS = 5  # of planes: neighbors agree on them in two, then noise, bends and edges ask again
HOPS_OF_SIZES = 17  # where noise decides how many neighbors each has
HOPS_MORE = 1  # of outliers, regions and edges: planes explain points, are linked, and meet
WIDTH = 5.0  # of outliers and regions: groups have gaps, and what regions of two cells share tells


class HaloLimits(NamedTuple):
    """How far the halo of a cell is sought."""

    # The margin widens while more of the places that were asked may have neighbors beyond it.
    incomplete: float = 0.01
    most: float = 4.0  # points to search at most, as a multiple of the cell's own
    trimmed: float = 0.9  # if more of the points searched are of rings, the others stay as well
    sample: int = 1_000  # points of a cell that tell how far neighbors are


class Part(NamedTuple):
    """The points of a cell and of its halo, in the order of their rows in the inputs."""

    xyz: np.ndarray  # float64 (n, 3)
    rows: np.ndarray  # (n,)
    own: np.ndarray  # bool (n,), whether a point is of the cell
    homes: np.ndarray  # int (n,), the cell of each,
    at: np.ndarray  # and its number there
    # In places as of `Cells`: how far each is within the box of the cell, negative beyond; and how
    # far its neighbors may be so that all of them are in the part.
    depth: np.ndarray = np.empty(0)
    reach: np.ndarray = np.empty(0)
    ranges: np.ndarray | None = None  # from the center of the cells, if they have one

    @classmethod
    def of(cls, *columns):
        """Of columns in another order; of points that come twice, the first."""
        order = np.unique(columns[1], return_index=True)[1]
        return cls(*(values[order] for values in columns))

    def joined(self, xyz, rows, homes, at):
        """The part, of cells without a center, with some of more points, which are in no ring."""
        far = np.full(len(rows), np.inf)
        more = xyz, rows, np.zeros(len(rows), bool), homes, at, -far, far
        return Part.of(*map(np.concatenate, zip(self[:7], more, strict=True)))

    def taken(self, chosen):
        """Some of the points."""
        return Part._make(None if values is None else values[chosen] for values in self)

    def rings(self, cloud, n_neighbors, hops, n_jobs, through=True):
        """How many hops of neighbors away from the own points, all in the box of the cell at least,
        each point of their `IndexedCloud` is: int8, one more than `hops` beyond the last ring. Also
        which are doubtful: they may have neighbors outside of the part. And the share of these
        among the points asked. Rings do not go on from them if not `through`.
        """
        n, k, n_asked = len(cloud.points), min(n_neighbors, len(cloud.points)), 0
        away, doubtful = np.full(n, hops + 1, np.int8), np.zeros(n, bool)
        away[cloud.places[self.own]] = 0
        depth, reach = self.depth[cloud.rows], self.reach[cloud.rows]
        ranges = None if self.ranges is None else self.ranges[cloud.rows]
        # Of points deep in the box all neighbors are own ones.
        asked = near_border(cloud.points, depth, k, ranges)
        asked = asked[away[asked] == 0]
        for hop in range(hops):
            near_them = np.zeros(n, bool)

            def measure(some, asked=asked, near_them=near_them):
                rows = asked[some]
                near = cloud.neighbors(rows, k, k)
                radius = np.linalg.norm(cloud.points[near[:, -1]] - cloud.points[rows], axis=1)
                known = seen_from(radius, ranges, rows) < reach[rows]
                doubtful[rows] = ~known
                near_them[near if through else near[known]] = True

            each_slice(len(asked), part_size(k), measure, n_jobs)
            n_asked += len(asked)
            asked = np.flatnonzero(near_them & (away > hop + 1))
            away[asked] = hop + 1
        return away, doubtful, np.count_nonzero(doubtful) / max(1, n_asked)

    def proven(self, cloud, n_neighbors, hops, n_jobs):
        """Which of the own points have the results of the whole cloud: the neighbors of these are
        in the part, and so are theirs, hop by hop. And how many hops away each of the points is.
        """
        away, doubtful, _ = self.rings(cloud, n_neighbors, hops, n_jobs)
        n, k = len(cloud.points), min(n_neighbors, len(cloud.points))
        if not doubtful.any():
            return np.ones(np.count_nonzero(self.own), bool), away[cloud.places]
        # The table is asked below, and by a fit to the part later.
        each_slice(n, part_size(k), lambda rows: cloud.neighbors(rows, 1, k), n_jobs)
        new = doubtful.copy()
        for _ in range(hops - 1):
            new = cloud.table.asking(new) & ~doubtful
            doubtful |= new
        return ~doubtful[cloud.places[self.own]], away[cloud.places]


def part_of_cell(cells, cell, n_neighbors, hops, width, n_jobs=1):
    """The `Part` of a cell, and the `IndexedCloud` of its points: as many rings of `n_neighbors` as
    there are hops, and all points nearer than the `width`. This is in units of how far the last of
    a point's neighbors usually is, in places as of `Cells`."""
    own, n = part_within(cells, cell), int(cells.counts[cell])
    if len(cells) == 1:
        return own, IndexedCloud.of(own.xyz)
    limits, length = HaloLimits(), float(np.ptp(cells.extent(cell), axis=0).max())
    usual = usual_distance(cells, own.xyz, n_neighbors)
    margin = max(hops, width) * usual or length / 16 or 1.0  # 0 of copies
    while True:
        part = part_within(cells, cell, margin)
        cloud, has_all = IndexedCloud.of(part.xyz), len(part.rows) == cells.n_points
        if len(cloud.points) > n_neighbors or has_all:  # distinct ones: copies have no plane
            away, _, incomplete = part.rings(cloud, n_neighbors, hops, n_jobs, through=False)
            is_wide = has_all or margin >= length or len(part.rows) > limits.most * n
            if is_wide or incomplete <= limits.incomplete:
                break
        margin *= 2
    inside = (away <= hops)[cloud.places] | (part.depth > -width * usual)
    if inside.mean() > limits.trimmed:
        return part, cloud
    part = part.taken(inside)
    return part, IndexedCloud.of(part.xyz)


def part_within(cells, cell, margin=None):
    """The `Part` of a cell and of all points within a margin around its box, if there is one."""
    xyz, rows = cells.points(cell), np.asarray(cells.rows(cell))
    n = len(rows)
    own: tuple = xyz, rows, np.ones(n, bool), np.full(n, cell, np.int32), np.arange(n)
    if margin is None or len(cells) == 1:
        far = np.full(n, np.inf)
        return Part(*own)._replace(depth=far, reach=far)
    xyz, rows, *others = cells.within(cell, margin)
    halo = xyz, rows, np.zeros(len(xyz), bool), *others
    part = Part.of(*map(np.concatenate, zip(own, halo, strict=True)))
    depth = cells.depth(cell, part.xyz)
    return part._replace(depth=depth, reach=depth + margin, ranges=cells.ranges(part.xyz))


def usual_distance(cells, xyz, n_neighbors):
    """How far the last of the neighbors of a point is, in places as of `Cells`, among the points of
    a cell; of 95 % of points it is nearer."""
    some, k = xyz[:: -(-len(xyz) // HaloLimits().sample)], min(n_neighbors, len(xyz))
    tree = cKDTree(xyz, LEAF, compact_nodes=False, balanced_tree=False)
    last, begin = (cells.places(points) for points in (xyz[tree.query(some, [k])[1][:, 0]], some))
    return float(np.quantile(np.linalg.norm(last - begin, axis=1), 0.95))


def near_border(points, depth, k, ranges):
    """Rows of points in spatial order that may have neighbors beyond the box in which they are: a
    point's k-th neighbor is no farther than the end of a box around k points in succession, of
    which it is one."""
    starts = np.arange(max(1, len(points) // k)) * k
    of = np.minimum(np.arange(len(points)) // k, len(starts) - 1)
    low, high = (f.reduceat(points, starts) for f in (np.minimum, np.maximum))
    across = np.linalg.norm(high - low, axis=1)[of]
    # The diagonal of the box is a cheap bound, which leaves few.
    rows = np.flatnonzero(depth <= seen_from(across, ranges, slice(None)))
    low, high, points = low[of[rows]], high[of[rows]], points[rows]
    ends = np.linalg.norm(np.maximum(points - low, high - points), axis=1)
    return rows[depth[rows] <= seen_from(ends, ranges, rows)]


def seen_from(radius, ranges, rows):
    """Radii around some places, as angles from the center that is at these ranges, if there is
    one; inf where the center is within a radius."""
    if ranges is None:
        return radius
    with np.errstate(divide="ignore", invalid="ignore"):
        sine = radius / ranges[rows]
        return np.where(sine < 1, np.arcsin(np.minimum(sine, 1.0)), np.inf)
