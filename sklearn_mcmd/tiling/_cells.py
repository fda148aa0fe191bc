"""Points on disk in cells of few points each: a k-d tree that grows while points arrive.

A cell that becomes too large is halved at the median of an axis, where the fewest points are near
the cut. So no cell has more points than it may have, however the density differs, and the points
are read only once. Each point is written about two and a half times.
"""

from pathlib import Path

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.tiling._cell_columns import in_place_of

__all__ = ["RECORD", "CellWriter", "Cells", "write_boxes"]

# A point as it is stored, with its place in the order of all inputs.
RECORD = np.dtype([("xyz", np.float64, 3), ("row", np.int64)])
BOXES = "cells.npz"
TOLD_APART = 2**16  # points whose cells are found at once
# Of a cell that is cut, COUNTED points tell how many lie near the cut: nearer than NEAR of the
# length that holds all but a share STRAY of them at each end. Only the time depends on these.
COUNTED, NEAR, STRAY = 20_000, 0.02, 0.05


class CellWriter:
    """Scatters points to the files of cells in an empty folder.

    No cell has more than `capacity` points, but that copies of one are never divided. Of a cell
    that is cut, `share` is left of the cut; results do not depend on it.
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
        counts, leaves = np.array(self.counts), np.flatnonzero(self.counts)
        boxes, extents = np.array(self.boxes)[leaves], np.array(self.extents)[leaves]
        return write_boxes(
            self.folder, names=leaves, low=boxes[:, 0], high=boxes[:, 1],
            least=extents[:, 0], most=extents[:, 1], counts=counts[leaves],
        )  # fmt: skip

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

    The boxes of cells, ``low <= x < high`` (n_cells, 3), together are all of space.
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        path = self.folder / BOXES
        with one_clear_line(path, "read"), np.load(path) as stored:
            self.low, self.high, self.counts = stored["low"], stored["high"], stored["counts"]
            self._names, self._least, self._most = (stored[n] for n in ("names", "least", "most"))

    def __len__(self):
        return len(self.counts)

    def read(self, cell):
        """The points of a cell, as records in the order of the inputs."""
        path = _path(self.folder, self._names[cell])
        records = np.fromfile(path, RECORD)
        if len(records) != self.counts[cell]:
            raise PointFileError(f"{path}: is damaged; begin anew (restart)")
        return records

    def of(self, points):
        """The cell in whose box each point lies; 0 where there is none, since it would be empty."""
        of = np.zeros(len(points), np.int32)
        for first in range(0, len(points), TOLD_APART):
            part, cells = points[first : first + TOLD_APART], of[first : first + TOLD_APART]
            low, high = part.min(axis=0), part.max(axis=0)
            for cell in np.flatnonzero(((self.low <= high) & (self.high > low)).all(axis=1)):
                cells[((part >= self.low[cell]) & (part < self.high[cell])).all(axis=1)] = cell
        return of

    def extent(self, cell):
        """The least and the most coordinates of a cell's points."""
        return self._least[cell], self._most[cell]


def write_boxes(folder, **told):
    """Write what the cells of a folder are; returns these as `Cells`."""
    with in_place_of(folder / BOXES) as temporary, open(temporary, "wb") as file:
        np.savez(file, **told)
    return Cells(folder)


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


def _no_extent():
    return np.array([[np.inf] * 3, [-np.inf] * 3])


def _path(folder, name):
    return folder / f"{name}.points"
