"""Points on disk in cells of few points each: a k-d tree that grows while points arrive.

A cell that becomes too large is halved at the median of an axis, where the fewest points are near
the cut. So no cell has more points than it may have, however the density differs, and the points
are read only once. Each point is written about two and a half times.
"""

import os
import secrets
from contextlib import suppress
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.planes._certificate import SLACK
from sklearn_mcmd.planes._indexed_cloud import distinct_rows

__all__ = ["RECORD", "CellWriter", "Cells"]

# A point as it is stored, with its place in the order of all inputs.
RECORD = np.dtype([("xyz", np.float64, 3), ("row", np.int64)])
BOXES = "cells.npz"
LEAF = 32
# VOXELS along each side of a cell tell where neighbors may be; KEPT of them stay in memory, with
# 60 bytes each.
GRID, VOXELS, KEPT = ".voxels", 96, 1_000_000
# Of a cell that is cut, COUNTED points tell how many lie near the cut: nearer than NEAR of the
# length that holds all but a share STRAY of them at each end. Only the time depends on these.
COUNTED, NEAR, STRAY = 20_000, 0.02, 0.05


class CellWriter:
    """Scatters points to the files of cells.

    Parameters
    ----------
    folder : path
        An empty folder.
    capacity : int
        Largest number of points in a cell; copies of one point are never divided.
    share : float, default=0.5
        Share of the points of a cell that are left of the cut. Results do not depend on it.
    """

    def __init__(self, folder, capacity, share=0.5):
        self.folder, self.capacity, self.share = Path(folder), capacity, share
        # Of each node, the axis, the place of the cut, and the first of two children; -1 of a leaf.
        self.nodes = [(-1, 0.0, -1)]
        self.counts, self.n_points = [0], 0
        self.boxes = [np.array([[-np.inf] * 3, [np.inf] * 3])]
        self.extents = [_no_extent()]

    def add(self, xyz, rows):
        """Take points (n, 3); `rows` are their places, or that of the first of them."""
        records = np.empty(len(xyz), RECORD)
        if np.ndim(rows) == 0:
            rows = np.arange(rows, rows + len(xyz))
        records["xyz"], records["row"] = xyz, rows
        self.n_points += len(xyz)
        self._put(0, records)

    def close(self):
        """Write what the cells are; returns these as `Cells`."""
        leaves = [i for i, (_, _, child) in enumerate(self.nodes) if child < 0 and self.counts[i]]
        boxes, extents = np.array(self.boxes)[leaves], np.array(self.extents)[leaves]
        counts = np.array(self.counts)[leaves]
        np.savez(
            self.folder / BOXES, names=leaves, low=boxes[:, 0], high=boxes[:, 1],
            least=extents[:, 0], most=extents[:, 1], counts=counts,
        )  # fmt: skip
        return Cells(self.folder)

    def _put(self, node, records):
        waiting = [(node, records)]
        while waiting:
            node, records = waiting.pop()
            axis, cut, child = self.nodes[node]
            if child >= 0:
                left = records["xyz"][:, axis] < cut
                parts = (child, records[left]), (child + 1, records[~left])
                waiting += [part for part in parts if len(part[1])]
                continue
            path = _path(self.folder, node)
            with one_clear_line(path, "written"), open(path, "ab") as file:
                file.write(records.data)  # unlike tofile, it says why it fails
            self.counts[node] += len(records)
            extent, xyz = self.extents[node], records["xyz"]
            np.minimum(extent[0], xyz.min(axis=0), out=extent[0])
            np.maximum(extent[1], xyz.max(axis=0), out=extent[1])
            if self.counts[node] > self.capacity:
                waiting += self._divide(node)

    def _divide(self, node):
        """Make a leaf an inner node; returns its points, which are to be put below it."""
        path = _path(self.folder, node)
        records = np.fromfile(path, RECORD)
        axis, cut = _best_cut(records["xyz"], self.share)
        if cut is None:
            return []
        path.unlink()
        child = len(self.nodes)
        self.nodes[node], self.counts[node] = (axis, cut, child), 0
        for side in (1, 0):
            box = self.boxes[node].copy()
            box[side, axis] = cut
            self.nodes.append((-1, 0.0, -1))
            self.counts.append(0)
            self.boxes.append(box)
            self.extents.append(_no_extent())
        return [(node, records)]


class Cells:
    """The points that a `CellWriter` has scattered.

    Attributes
    ----------
    low, high : ndarray of shape (n_cells, 3)
        Boxes ``low <= x < high`` that together are all of space.
    counts : ndarray of int of shape (n_cells,)
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        with np.load(self.folder / BOXES) as stored:
            self.low, self.high, self.counts = stored["low"], stored["high"], stored["counts"]
            self._names, self._least, self._most = (stored[n] for n in ("names", "least", "most"))
        self._grids = {}

    def __len__(self):
        return len(self.counts)

    def read(self, cell):
        """The points of a cell, as records in the order of the inputs."""
        return np.fromfile(_path(self.folder, self._names[cell]), RECORD)

    def extent(self, cell):
        """The least and the most coordinates of a cell's points."""
        return self._least[cell], self._most[cell]

    def around(self, cell, width, most):
        """Points outside a cell and near its box.

        Parameters
        ----------
        cell : int
        width : float
            Distance from the box up to which points are taken. It is halved as often as there are
            too many.
        most : int
            Points that may be taken.

        Returns
        -------
        points : ndarray of shape (n, 3)
        low, high : ndarray of shape (3,)
            The box of which these and the cell's are all points.
        """
        low, high = self.low[cell] - width, self.high[cell] + width
        reached = ((self._least < high) & (self._most >= low)).all(axis=1)
        reached[cell] = False
        points = np.empty((0, 3))
        for other in np.flatnonzero(reached):
            points = np.vstack([points, _inside(self.read(other)["xyz"], low, high)])
            while len(points) > most:
                width /= 2
                low, high = self.low[cell] - width, self.high[cell] + width
                points = _inside(points, low, high)
        return points, low, high

    def neighbors(self, queries, k, reach):
        """Points of the cloud not farther from queries than the k-th nearest of each.

        Parameters
        ----------
        queries : ndarray of shape (m, 3)
        k : int
            Neighbors, of points that are distinct.
        reach : ndarray of shape (m,)
            Distances within which each has k neighbors; inf is always right.

        Returns
        -------
        found : ndarray of shape (n, 3)
            Distinct.
        reach : ndarray of shape (m,)
            Distances of the k-th neighbors; inf where there are fewer.
        """
        trees, nearest, reach = {}, np.full((len(queries), k), np.inf), reach.copy()
        low, high = queries.min(axis=0) - reach.max(), queries.max(axis=0) + reach.max()
        near = np.flatnonzero(((self._least <= high) & (self._most >= low)).all(axis=1))
        gaps = {cell: _gaps(queries, self._least[cell], self._most[cell]) for cell in near}
        for cell in sorted(near, key=lambda cell: gaps[cell].min()):
            asking = np.flatnonzero(gaps[cell] <= reach)
            tree = self._tree(cell, queries[asking], reach[asking], k) if len(asking) else None
            if tree is None or tree.n == 0:
                continue
            trees[cell] = tree
            distances = tree.query(queries[asking], np.arange(1, k + 1))[0]
            both = np.sort(np.hstack([nearest[asking], distances]), axis=1)
            nearest[asking] = both[:, :k]
            reach[asking] = np.minimum(reach[asking], SLACK * both[:, k - 1])
        found = [np.empty((0, 3))]
        for cell, tree in trees.items():
            asking = np.flatnonzero(gaps[cell] <= reach)
            if len(asking):
                found.append(tree.data[_within(tree, queries[asking], reach[asking])])
        return np.vstack(found), reach

    def _tree(self, cell, queries, reach, k):
        """The distinct points of a cell that may be among the k nearest of queries."""
        grid = self._grids.pop(cell, None)
        if grid is None:
            file = _path(self.folder, self._names[cell]).with_suffix(GRID)
            if not file.exists():
                _Grid.write(file, self.read(cell)["xyz"])
            grid = _Grid(file)
        self._grids[cell] = grid  # the last
        while len(self._grids) > 1 and sum(len(g.counts) for g in self._grids.values()) > KEPT:
            self._grids.pop(next(iter(self._grids)))
        return _tree_of(grid.near(queries, grid.bounds(queries, reach, k)))


class _Grid:
    """The distinct points of a cell, by voxels in a file; only what lies in the voxels is read.

    Kept in memory are the voxels that hold points, and how many each of them has.

    Parameters
    ----------
    file : path
        That `write` has made.
    """

    def __init__(self, file):
        self.file, n = file, VOXELS + 1
        with open(file, "rb") as stored:
            self.n_points, n_taken = (int(n) for n in np.fromfile(stored, np.int64, 2))
            low, size = np.fromfile(stored, np.float64, 6).reshape(2, 3)
            taken, self.counts = np.fromfile(stored, np.int32, 2 * n_taken).reshape(2, -1)
            self.offset = stored.tell()
        middles = low + (np.stack(np.unravel_index(taken, (n,) * 3), axis=1) + 0.5) * size
        self.tree = cKDTree(middles, leafsize=LEAF, balanced_tree=False)
        rounding = 4 * np.spacing(np.abs(middles).max())
        self.half = 0.501 * np.linalg.norm(size) + rounding  # of a diagonal

    @staticmethod
    def write(file, points):
        """Write the points of a cell by voxels; whoever else does the same writes the same."""
        points, n = points[distinct_rows(points)[0]], VOXELS + 1
        low, high = points.min(axis=0), points.max(axis=0)
        size = np.maximum(high - low, np.finfo(float).tiny) / VOXELS
        x, y, z = (((points[:, i] - low[i]) / size[i]).astype(np.int32) for i in range(3))
        voxels = (x * n + y) * n + z
        counts = np.bincount(voxels, minlength=n**3)
        taken = np.flatnonzero(counts)
        table = np.stack([taken, counts[taken]]).astype(np.int32)
        ordered = points[np.argsort(voxels, kind="stable")]
        temporary = file.with_name(f"{file.name}.{secrets.token_hex(4)}")  # of many processes
        try:
            with one_clear_line(file, "written"), open(temporary, "wb") as stored:
                stored.write(np.array([len(points), len(taken)], np.int64).data)
                for values in (np.stack([low, size]), table, ordered):
                    stored.write(values.data)
            with suppress(PermissionError):  # Windows, where another process reads the same
                os.replace(temporary, file)
        finally:
            temporary.unlink(missing_ok=True)

    def bounds(self, queries, reach, k):
        """Distances within which each query has k points of the cell, or those that are given."""
        most = min(k, len(self.counts))
        if not len(queries) or self.n_points < k:
            return reach
        distances, voxels = self.tree.query(queries, np.arange(1, most + 1))
        enough = np.cumsum(self.counts[voxels], axis=1) >= k
        last = np.where(enough.any(axis=1), enough.argmax(axis=1), most)
        distances = np.append(distances, np.full((len(queries), 1), np.inf), axis=1)
        bounds = np.take_along_axis(distances, last[:, None], axis=1)[:, 0]
        return np.minimum(reach, SLACK * (bounds + self.half))

    def near(self, queries, reach):
        """The points of all voxels that a ball may touch."""
        stored = np.memmap(self.file, np.float64, "r", self.offset, (self.n_points, 3))
        if np.isinf(reach).any():
            return np.array(stored)
        touched = np.zeros(len(self.counts), bool)
        touched[_within(self.tree, queries, reach + self.half)] = True
        return np.array(stored[np.repeat(touched, self.counts)])


def _tree_of(points):
    return cKDTree(points, leafsize=LEAF, balanced_tree=False)


def _within(tree, queries, reach):
    """Rows of a tree's points within a distance of any query."""
    found = tree.query_ball_point(queries, reach, return_sorted=False)
    return np.unique(np.concatenate(found).astype(np.intp))


def _best_cut(points, share):
    """The axis whose cut has the fewest points near it, and the cut, None if there is none.

    Of axes with as many, the longest. Stray points have no say: the longest side of a road below
    a few of them is its height, and a cut through its noise would have half of it on each side.
    """
    some = points[:: -(-len(points) // COUNTED)]
    low, high = np.quantile(some, (STRAY, 1 - STRAY), axis=0)
    length = high - low
    width = NEAR * length.max()
    axes = []
    for axis in range(3):
        cut = np.quantile(some[:, axis], share)
        near = np.count_nonzero(np.abs(some[:, axis] - cut) < width)
        axes.append((near, -length[axis], axis))
    for _, _, axis in sorted(axes):
        cut = _cut(points[:, axis], share)
        if cut is not None:
            break
    return axis, cut


def _cut(values, share):
    """A value between the least and the most; None if there is none."""
    cut = np.partition(values, int(share * len(values)))[int(share * len(values))]
    if cut > values.min():
        return float(cut)
    above = values[values > cut]
    return float(above.min()) if len(above) else None


def _inside(points, low, high):
    return points[((points >= low) & (points < high)).all(axis=1)]


def _gaps(queries, low, high):
    """Distances of queries from a box; 0 within it."""
    return np.linalg.norm(np.maximum(np.maximum(low - queries, queries - high), 0.0), axis=1)


def _no_extent():
    return np.array([[np.inf] * 3, [-np.inf] * 3])


def _path(folder, name):
    return folder / f"{name}.points"
