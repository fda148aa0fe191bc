"""Points on disk in cells of few points each: a k-d tree that grows while points arrive.

A cell that becomes too large is halved at the median of an axis, where the fewest points are near
the cut. So no cell has more points than it may have, however the density differs, and the points
are read only once. Each point is written about two and a half times.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.io import PointFileError
from sklearn_mcmd.io._classes import ground_in
from sklearn_mcmd.io._files import one_clear_line
from sklearn_mcmd.io._ground import check_ground
from sklearn_mcmd.planes._resolution import is_single, step_of_levels
from sklearn_mcmd.runtime._chunks import slices
from sklearn_mcmd.tiling._stored_columns import HEADERS, in_place_of

BOXES = "cells.npz"
GROUND = "ground"  # the folder of the cells of the ground, which are divided in plan
LOCATED_AT_ONCE = 2**16  # points whose cells are found at once
# How cells are cut; only the time depends on it.
COUNTED = 20_000  # points of a cell that are counted to find the best cut
NEAR = 0.02  # share of the length of a cell within which a point is near the cut
STRAY = 0.05  # share of the points at each end that do not count for the length


class CellWriter:
    """Scatters points to the files of cells in an empty folder.

    No cell has more than `capacity` points, of d coordinates each, but that copies of one are never
    divided. Each has a number of a dtype, its row in the inputs by default.
    """

    def __init__(self, folder, capacity, d=3, dtype=np.int64):
        self.folder, self.capacity, self.d, self.dtype = Path(folder), capacity, d, np.dtype(dtype)
        # Of each node, the axis, the place of the cut, and the first of two children; -1 of a leaf.
        self.nodes = [(-1, 0.0, -1)]
        self.counts, self.n_points = [0], 0
        self.boxes = [np.array([[-np.inf] * d, [np.inf] * d])]
        self.extents = [-self.boxes[0]]

    def add(self, xyz, rows):
        """Take points (n, d), and the number of each."""
        self.n_points += len(xyz)
        waiting = [(0, xyz, rows)]
        while waiting:
            node, xyz, rows = waiting.pop()
            axis, cut, child = self.nodes[node]
            if child >= 0:
                left = xyz[:, axis] < cut
                parts = (child, xyz[left], rows[left]), (child + 1, xyz[~left], rows[~left])
                waiting += [part for part in parts if len(part[1])]
                continue
            _append(_points(self.folder, node), xyz, np.float64)
            _append(_rows(self.folder, node), rows, self.dtype)
            self.counts[node] += len(xyz)
            extent = self.extents[node]
            # Axis by axis takes a twentieth of the time.
            np.minimum(extent[0], [axis.min() for axis in xyz.T], out=extent[0])
            np.maximum(extent[1], [axis.max() for axis in xyz.T], out=extent[1])
            if self.counts[node] > self.capacity:
                waiting += self._divide(node)

    def close(self):
        """Write what the cells are."""
        leaves = np.flatnonzero(self.counts)
        boxes, extents = np.array(self.boxes)[leaves], np.array(self.extents)[leaves]
        known = {"names": leaves, "counts": np.array(self.counts)[leaves]}
        known["no_rows"] = np.empty(0, self.dtype)
        with in_place_of(self.folder / BOXES) as temporary, open(temporary, "wb") as file:
            np.savez(file, boxes=boxes, extents=extents, **known)

    def _divide(self, node):
        """Make a leaf an inner node; returns its points, which are to be put below it."""
        paths = _points(self.folder, node), _rows(self.folder, node)
        xyz = np.fromfile(paths[0]).reshape(-1, self.d)
        rows = np.fromfile(paths[1], self.dtype)
        axis, cut = _best_cut(xyz)
        if cut is None:
            return []
        for path in paths:
            path.unlink()
        child = len(self.nodes)
        self.nodes[node], self.counts[node] = (axis, cut, child), 0
        for side in (1, 0):
            box = self.boxes[node].copy()
            box[side, axis] = cut
            self.nodes.append((-1, 0.0, -1))
            self.counts.append(0)
            self.boxes.append(box)
            self.extents.append(-self.boxes[0])
        return [(node, xyz, rows)]


class GroundWriter(CellWriter):
    """Scatters the points of the ground to cells in plan, with their heights as numbers."""

    def __init__(self, folder, capacity):
        folder.mkdir()
        super().__init__(folder, capacity, dtype=np.float64)

    def take(self, cloud, chosen, path):
        """Take the ground of a part of the cloud."""
        xyz = cloud.xyz[ground_in(cloud)]
        if len(xyz):
            self.add(flat(xyz), xyz[:, 2])

    def close(self, path):
        """As above; an error that names the path, if there is too little ground."""
        with one_clear_line(path, "read"):
            check_ground(self.n_points)
        super().close()


def flat(xyz):
    """Points in plan, which have 0 as their z."""
    return xyz * [1.0, 1.0, 0.0]


class Cells:
    """The points that a `CellWriter` has scattered.

    The boxes of cells, ``low <= x < high`` (n_cells, d), together are all of space.
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        path = self.folder / BOXES
        with one_clear_line(path, "read"), HEADERS, np.load(path) as stored:
            boxes, self.counts = stored["boxes"], stored["counts"]
            self._names, self._extents = stored["names"], stored["extents"]
            self._dtype = stored["no_rows"].dtype
        self.low, self.high, self._stored = boxes[:, 0], boxes[:, 1], self.counts

    def __len__(self):
        return len(self.counts)

    def points(self, cell):
        """The points of a cell in the order of the inputs."""
        path = _points(self.folder, self._names[cell])
        xyz = np.fromfile(path)
        if len(xyz) != self._stored[cell] * self.low.shape[1]:
            raise PointFileError(f"{path}: is damaged; begin anew (restart)")
        return xyz.reshape(-1, self.low.shape[1])

    def rows(self, cell):
        """The numbers of a cell's points, on disk: their rows in the inputs, ascending."""
        path = _rows(self.folder, self._names[cell])
        with one_clear_line(path, "read"):
            return np.memmap(path, self._dtype, "r", shape=(self._stored[cell],))

    def free(self, cell):
        """Free the disk of a cell's coordinates, which sweeps have written elsewhere."""
        _points(self.folder, self._names[cell]).unlink(missing_ok=True)

    def restore(self, cell, xyz):
        """Undo `free`."""
        with in_place_of(_points(self.folder, self._names[cell])) as temporary:
            _append(temporary, xyz, np.float64)

    def of(self, points):
        """The cell in whose box each point lies; 0 where there is none, since it would be empty."""
        of = np.zeros(len(points), np.int32)
        for rows in slices(len(points), LOCATED_AT_ONCE):
            part, cells = points[rows], of[rows]
            low, high = part.min(axis=0), part.max(axis=0)
            for cell in np.flatnonzero(((self.low <= high) & (self.high > low)).all(axis=1)):
                cells[((part >= self.low[cell]) & (part < self.high[cell])).all(axis=1)] = cell
        return of

    def extent(self, cell):
        """The least and the most coordinates of a cell's points."""
        return self._extents[cell, 0], self._extents[cell, 1]


def _points(folder, name):
    return folder / f"{name}.points"


def _rows(folder, name):
    return folder / f"{name}.rows"


def _append(path, values, dtype):
    with one_clear_line(path, "written"), open(path, "ab") as file:
        file.write(np.ascontiguousarray(values, dtype).data)  # unlike tofile, it says why it fails


def _best_cut(points):
    """The axis whose cut has the fewest points near it, and the cut, None if there is none.

    Of axes with as many, the longest. Stray points have no say: the longest side of a road below
    a few of them is its height, and a cut through its noise would have half of it on each side.
    """
    some = points[:: -(-len(points) // COUNTED)]
    low, middle, high = np.quantile(some, (STRAY, 0.5, 1 - STRAY), axis=0)
    length = high - low
    near = np.count_nonzero(np.abs(some - middle) < NEAR * length.max(), axis=0)
    for axis in np.lexsort((-length, near)):
        values = points[:, axis]
        cut = np.partition(values, len(values) // 2)[len(values) // 2]
        if cut == values.min():  # copies: the next value, which is inf if there is none
            cut = values.min(where=values > cut, initial=np.inf)
        if cut < np.inf:
            return axis, float(cut)
    return 0, None


class Constants(NamedTuple):
    """What every tile must know of the whole cloud."""

    dtype: str  # of the coordinates: float32 if it rounded them
    step: float  # to which they were rounded, 0 where there is none


class WholeCloud:
    """Collects constants while the points are read once."""

    def __init__(self):
        self.single = True
        self.axes = [Levels() for _ in range(3)]

    def add(self, xyz):
        """Take some of the points, (n, 3)."""
        if self.single:
            with np.errstate(over="ignore"):
                self.single = bool((xyz.astype(np.float32) == xyz).all())
        for axis, values in zip(self.axes, xyz.T, strict=True):
            axis.add(*np.unique(values, return_counts=True))

    def constants(self, dtype=None):
        """The `Constants` of all points that were taken, in a given precision or that of these."""
        levels = [axis.merged() for axis in self.axes]
        if dtype is None:
            dtype = np.float32 if self.single and is_single(levels) else np.float64
        dtype = np.dtype(dtype)
        step = step_of_levels((values.astype(dtype), counts) for values, counts in levels)
        return Constants(dtype.name, float(step))


class Levels:
    """The values of an axis and how often each occurs; 16 bytes for each value."""

    def __init__(self):
        self.parts = []

    def add(self, values, counts):
        """Join parts of like size, so that each value is sorted a few times only."""
        self.parts.append((values, counts))
        while len(self.parts) > 1 and len(self.parts[-2][0]) < 2 * len(self.parts[-1][0]):
            self.parts.append(_joined([self.parts.pop(), self.parts.pop()]))

    def merged(self):
        return _joined(self.parts)


def _joined(parts):
    values, rows = np.unique(np.concatenate([v for v, _ in parts]), return_inverse=True)
    counts = np.zeros(len(values), np.int64)
    np.add.at(counts, rows, np.concatenate([c for _, c in parts]))
    return values, counts
