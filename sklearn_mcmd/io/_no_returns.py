"""Rows of zeros amid large coordinates: rays without a return, which are no points."""

import numpy as np

__all__ = ["NoReturns"]

LARGE, ZERO = 1e5, 1e-6


class NoReturns:
    """Counts the rows of zeros of a file, part by part."""

    def __init__(self):
        self.n_points = self.n_large = self.n_zeros = 0
        self.first = None

    def add(self, xyz):
        largest = np.abs(xyz).max(axis=1, initial=0)
        zeros = np.flatnonzero(largest < ZERO)
        if self.first is None and len(zeros):
            self.first = self.n_points + int(zeros[0])
        self.n_points += len(xyz)
        self.n_large += np.count_nonzero(largest >= LARGE)
        self.n_zeros += len(zeros)
        return self

    def warning(self, path):
        """What to warn of, or None if most other points are not large."""
        if not self.n_zeros or 2 * self.n_large <= self.n_points - self.n_zeros:
            return None
        return (
            f"{path}: {self.n_zeros:,} of {self.n_points:,} points are 0, 0, 0 amid coordinates of "
            f"{LARGE:,.0f} and more, the first is point {self.first + 1}: no returns, as it seems; "
            "remove them"
        )
