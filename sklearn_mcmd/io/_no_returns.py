"""Rows of zeros: rays without a return, which are no points."""

import numpy as np

from sklearn_mcmd._errors import counted

LARGE, ZERO = 1e5, 1e-6  # a coordinate from which on zeros are odd, and below which it is 0
LEFT_OUT = "n_no_returns"  # in the metadata: how many of those that were left out had a warning
# A place that was measured more often than this keeps company with itself, in outliers/.
FEW = 8


class NoReturns:
    """Counts the rows of zeros of a file, part by part.

    They are many if there are more than rows of which two coordinates are 0: rounding makes more of
    these, rays without a return make none. A few may be a point.
    """

    def __init__(self):
        self.n_points = self.n_large = self.n_zeros = self.n_exact = self.n_beside = 0
        self.first = self.first_exact = 0

    def add(self, xyz):
        sizes = np.abs(xyz, order="F")  # passes along columns are ten times as fast
        largest = sizes.max(axis=1, initial=0)
        zeros = np.flatnonzero(largest < ZERO)
        if not self.n_zeros and len(zeros):
            self.first = self.n_points + int(zeros[0])
        exact = zeros[largest[zeros] == 0]
        if not self.n_exact and len(exact):
            self.first_exact = self.n_points + int(exact[0])
        self.n_beside += int(np.count_nonzero((sizes == 0).sum(axis=1) == 2))
        self.n_exact += len(exact)
        self.n_points += len(xyz)
        self.n_large += int(np.count_nonzero(largest >= LARGE))
        self.n_zeros += len(zeros)
        return self

    @property
    def n_left_out(self):
        are_many = max(FEW, self.n_beside) < self.n_exact < self.n_points
        return self.n_exact if are_many else 0

    def warning(self, path):
        """What to warn of, or None if a few zeros are not amid large coordinates."""
        n_left_out = self.n_left_out
        n = n_left_out or self.n_zeros
        # A few are odd if more than half of the other points are far from them.
        if not n_left_out and (not n or 2 * self.n_large <= self.n_points - n):
            return None
        where = "" if n_left_out else f" amid coordinates of {LARGE:,.0f} and more"
        done = "they are left out" if n_left_out else "remove them"
        first = self.first_exact if n_left_out else self.first
        return (
            f"{path}: {counted(n, 'point', 'are', of=self.n_points)} 0, 0, 0{where}, the first is "
            f"point {first + 1}: no returns, as it seems; {done}"
        )
