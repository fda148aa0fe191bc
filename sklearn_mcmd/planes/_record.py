"""The record of planes, which every stage reads and compiled code takes as one argument."""

from typing import NamedTuple

import numpy as np


class Neighborhoods(NamedTuple):
    """The neighbors of m queries as rows of an index's points, the nearest first."""

    indices: np.ndarray  # int32 (m, k); members beyond the size repeat the first
    sizes: np.ndarray  # int64 (m,)

    def take(self, rows):
        """The neighborhoods of some of the queries."""
        return Neighborhoods(self.indices[rows], self.sizes[rows])

    @property
    def valid(self):
        """Which members are neighbors and not padding: bool (m, k)."""
        return np.arange(self.indices.shape[1]) < self.sizes[:, None]


class Planes(NamedTuple):
    """Planes of m neighborhoods, one row each; lengths are in units of the points."""

    centroids: np.ndarray  # (m, d), as both below; all others (m,)
    normals: np.ndarray
    eigenvalues: np.ndarray  # of the covariance of the kept members, ascending
    scale: np.ndarray  # standard deviation of the noise along the normal; negative: no plane
    kept: np.ndarray  # share of the neighborhood that is kept after outliers are removed
    radius: np.ndarray  # distance of the last neighbor from the query
    normal_error: np.ndarray  # root mean square tilt in degrees, see `normal_errors`

    @classmethod
    def empty(cls, m, d):
        """A record to be filled."""
        vectors = (np.empty((m, d)) for _ in range(3))
        return cls(*vectors, *(np.empty(m) for _ in range(4)))

    @classmethod
    def unknown(cls, m, d):
        """A record of no numbers, to be filled in part."""
        return cls(*(np.full_like(values, np.nan) for values in cls.empty(m, d)))

    def take(self, rows):
        """The record of some of the queries. Of a slice these are views, which can be filled."""
        return type(self)(*(values[rows] if len(values) else values for values in self))

    def without(self, *names):
        """The record with no values of some of its fields, to save their memory."""
        return self._replace(**{name: getattr(self, name)[:0].copy() for name in names})

    def put(self, rows, part):
        """Overwrite what is known of some of the queries."""
        for values, new in zip(self, part, strict=True):
            if len(values) and len(new):
                values[rows] = new
