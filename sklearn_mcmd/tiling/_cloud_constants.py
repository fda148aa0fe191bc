"""What estimators find in the whole cloud, collected from its parts."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._resolution import is_single, step_of_levels

__all__ = ["Constants", "WholeCloud"]


class Constants(NamedTuple):
    """What every tile must know of the whole cloud: the precision of the coordinates, float32 if it
    rounded them, and the step to which they were rounded, 0 where there is none.
    """

    dtype: str
    step: float


class WholeCloud:
    """Collects constants while the points are read once."""

    def __init__(self):
        self.single = True
        self.axes = [_Levels() for _ in range(3)]

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


class _Levels:
    """The values of an axis and how often each occurs; 16 bytes for each value."""

    def __init__(self):
        self.parts = []

    def add(self, values, counts):
        """Join parts of like size, so that each value is sorted a few times only."""
        self.parts.append((values, counts))
        while len(self.parts) > 1 and len(self.parts[-2][0]) < 2 * len(self.parts[-1][0]):
            self.parts.append(_joined([self.parts.pop(), self.parts.pop()]))

    def merged(self):
        self.parts = [_joined(self.parts)]
        return self.parts[0]


def _joined(parts):
    values, rows = np.unique(np.concatenate([v for v, _ in parts]), return_inverse=True)
    counts = np.zeros(len(values), np.int64)
    np.add.at(counts, rows, np.concatenate([c for _, c in parts]))
    return values, counts
