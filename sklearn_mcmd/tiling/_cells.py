"""Points on disk in cells of few points each: a k-d tree that grows while points arrive.

A cell that becomes too large is halved at the median of an axis, where the fewest points are near
the cut. So no cell has more points than it may have, however the density differs, and the points
are read only once. Each point is written about two and a half times.
"""

from pathlib import Path
from typing import Any

import numpy as np

from sklearn_mcmd.io._files import one_clear_line, replacing
from sklearn_mcmd.planes._resolution import is_single, steps_of_levels
from sklearn_mcmd.planes._whole import Steps
from sklearn_mcmd.tiling._folder import HEADERS, append, appended

BOXES = "cells.npz"
# How cells are cut; only the time depends on it.
COUNTED = 20_000  # points of a cell that are counted to find the best cut
NEAR = 0.02  # share of the length of a cell within which a point is near the cut
STRAY = 0.05  # share of the points at each end that do not count for the length


class CellWriter:
    """Scatters points (n, 3) to the files of cells in an empty folder.

    No cell has more than `capacity` points, but that copies of one are never divided. Each has a
    number of a dtype, its row in the inputs by default. Cells are boxes, or wedges of directions
    from a `center`, where all points were measured from there: no beam then crosses many cells.
    """

    def __init__(self, folder, capacity, dtype=np.int64, center=None):
        self.folder, self.capacity, self.dtype = Path(folder), capacity, np.dtype(dtype)
        self.center = center
        # Of each node, the axis, the place of the cut, and the first of two children; -1 of a leaf.
        self.nodes = [(-1, 0.0, -1)]
        self.counts, self.n_points = [0], 0
        self.boxes = [np.array([[-np.inf] * 3, [np.inf] * 3])]
        self.extents = [-self.boxes[0]]

    def add(self, xyz, rows):
        """Take points (n, 3), and the number of each."""
        self.n_points += len(xyz)
        self._add(0, xyz, places_of(xyz, self.center), rows)

    def _add(self, node, xyz, places, rows):
        """Take points of a node."""
        axis, cut, child = self.nodes[node]
        if child >= 0:
            left = places[:, axis] < cut
            for side, chosen in (1, np.flatnonzero(~left)), (0, np.flatnonzero(left)):
                if len(chosen) == len(rows):  # as mostly: a file's neighbors are neighbors in space
                    self._add(child + side, xyz, places, rows)
                elif len(chosen):
                    points = xyz[chosen]
                    same = points if places is xyz else places[chosen]
                    self._add(child + side, points, same, rows[chosen])
            return
        append(_points(self.folder, node), xyz)
        append(_rows(self.folder, node), rows, self.dtype)
        self.counts[node] += len(xyz)
        extent = self.extents[node]
        # Axis by axis takes a twentieth of the time.
        np.minimum(extent[0], [axis.min() for axis in places.T], out=extent[0])
        np.maximum(extent[1], [axis.max() for axis in places.T], out=extent[1])
        if self.counts[node] > self.capacity:
            self._divide(node)

    def close(self):
        """Write what the cells are."""
        leaves = np.flatnonzero(self.counts)
        stored: dict[str, Any] = {
            "boxes": np.array(self.boxes)[leaves],
            "extents": np.array(self.extents)[leaves],
            "names": leaves,
            "counts": np.array(self.counts)[leaves],
            "no_rows": np.empty(0, self.dtype),
            "center": np.empty(0) if self.center is None else self.center,
        }
        with replacing(self.folder / BOXES) as temporary, open(temporary, "wb") as file:
            np.savez(file, **stored)

    def _divide(self, node):
        """Make a leaf an inner node, and put its points below it."""
        paths = _points(self.folder, node), _rows(self.folder, node)
        xyz, rows = np.fromfile(paths[0]).reshape(-1, 3), np.fromfile(paths[1], self.dtype)
        places = places_of(xyz, self.center)
        axis, cut = _best_cut(places)
        if cut is None:
            return
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
        self._add(node, xyz, places, rows)


class Cells:
    """The points that a `CellWriter` has scattered.

    The boxes of cells, ``low <= place < high`` (n_cells, 3), together are all of space.
    """

    def __init__(self, folder):
        self.folder = Path(folder)
        path = self.folder / BOXES
        with one_clear_line(path, "read"), HEADERS, np.load(path) as stored:
            boxes, self.counts = stored["boxes"], stored["counts"]
            self._names, self._extents = stored["names"], stored["extents"]
            self._dtype, center = stored["no_rows"].dtype, stored["center"]
        self.low, self.high = boxes[:, 0], boxes[:, 1]
        self.center = center if len(center) else None

    def __len__(self):
        return len(self.counts)

    @property
    def n_points(self):
        return int(self.counts.sum())

    def points(self, cell):
        """The points of a cell in the order of the inputs."""
        path = _points(self.folder, self._names[cell])
        return np.array(appended(path, (self.counts[cell], 3)))

    def rows(self, cell):
        """The numbers of a cell's points, on disk: their rows in the inputs, ascending."""
        return appended(_rows(self.folder, self._names[cell]), self.counts[cell], self._dtype)

    def places(self, xyz):
        """Where points are for the boxes: the points, or their directions from the center."""
        return places_of(xyz, self.center)

    def depth(self, cell, xyz):
        """How far the places of points are within the box of a cell, negative beyond."""
        places = self.places(xyz)
        return np.minimum(places - self.low[cell], self.high[cell] - places).min(axis=1)

    def ranges(self, xyz):
        """How far points are from the center, if there is one."""
        return None if self.center is None else np.linalg.norm(xyz - self.center, axis=1)

    def extent(self, cell):
        """The least and the most coordinates of a cell's places."""
        return self._extents[cell]

    def away(self, low, high):
        """How far the places of each cell are from a box."""
        gaps = np.maximum(self._extents[:, 0] - high, low - self._extents[:, 1])
        return np.linalg.norm(np.maximum(gaps, 0.0), axis=1)

    def within(self, cell, margin):
        """Points of other cells within a margin around the box of a cell: coordinates, rows, their
        cells, and where they are in these."""
        low, high = self.low[cell] - margin, self.high[cell] + margin
        dtypes = self._dtype, np.int32, np.int64
        found = [(np.empty((0, 3)), *(np.empty(0, dtype) for dtype in dtypes))]
        for other in np.flatnonzero(self.away(low, high) == 0.0):
            if other == cell:
                continue
            xyz = self.points(other)
            places = self.places(xyz)
            inside = np.flatnonzero(((places >= low) & (places <= high)).all(axis=1))
            home = np.full(len(inside), other, np.int32)
            found.append((xyz[inside], self.rows(other)[inside], home, inside))
        return tuple(map(np.concatenate, zip(*found, strict=True)))


def places_of(xyz, center):
    """Points, or their directions from a center, 0 of those there."""
    if center is None:
        return xyz
    rays = xyz - center
    ranges = np.linalg.norm(rays, axis=1, keepdims=True)
    return rays / np.where(ranges > 0, ranges, 1.0)


def _points(folder, name):
    return folder / f"{name}.points"


def _rows(folder, name):
    return folder / f"{name}.rows"


def _best_cut(places):
    """The axis whose cut has the fewest points near it, and the cut, None if there is none.

    Of axes with as many, the longest. Stray points have no say: the longest side of a road below
    a few of them is its height, and a cut through its noise would have half of it on each side.
    """
    some = places[:: -(-len(places) // COUNTED)]
    low, middle, high = np.quantile(some, (STRAY, 0.5, 1 - STRAY), axis=0)
    length = high - low
    near = np.count_nonzero(np.abs(some - middle) < NEAR * length.max(), axis=0)
    for axis in np.lexsort((-length, near)):
        values = places[:, axis]
        cut = np.partition(values, len(values) // 2)[len(values) // 2]
        if cut == values.min():  # copies: the next value, which is inf if there is none
            cut = values.min(where=values > cut, initial=np.inf)
        if cut < np.inf:
            return axis, float(cut)
    return 0, None


class Rounding:
    """Collects, while the points are read once, to what their coordinates were rounded."""

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

    def found(self):
        """The dtype of all points that were taken, and their `Steps`."""
        levels = [axis.merged() for axis in self.axes]
        dtype = np.dtype(np.float32 if self.single and is_single(levels) else np.float64)
        levels = [(values.astype(dtype, copy=False), counts) for values, counts in levels]
        return {"dtype": dtype.name, "steps": steps_of_levels(levels)}


def rounding_told(constants):
    """What `Rounding.found` gave, from a file, as the `Whole` has it."""
    return {"dtype": constants["dtype"], "steps": Steps(*constants["steps"])}


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
