"""Which of its two sides a normal points to."""

from typing import NamedTuple

import numpy as np
from joblib import effective_n_jobs
from scipy.spatial import cKDTree
from sklearn.utils.validation import check_array

from sklearn_mcmd._validation import check_sensor_origin
from sklearn_mcmd.planes._orientation import orient_toward, signs_along, spanning_forest


class TreeLimits(NamedTuple):
    """What the tree of ``orientation="mst"`` joins."""

    n_neighbors: int = 12  # nearest points whose normals are to agree


class Sides:
    """The sides of normals that `orientation` and `sensor_origin` of the estimator name.

    The direction is (d,) or None, the sensor's origin None, (d,), or (n, d) of the fitted points.
    """

    def __init__(self, direction=None, sensor_origin=None, tree=False):
        self.direction, self.sensor_origin, self.tree = direction, sensor_origin, tree
        self.tree_normals = None  # of the fitted points, where neighbors are to agree

    @classmethod
    def of(cls, orientation, sensor_origin, X):
        """Check the parameters for the fitted points X (n, d)."""
        named = orientation if isinstance(orientation, str) else None
        if named == "sensor":
            if sensor_origin is None:
                raise ValueError(
                    'orientation="sensor" needs sensor_origin, where the sensor stood.'
                )
            origins = check_sensor_origin(sensor_origin, X)
            moved = (origins != origins[0]).any()
            return cls(sensor_origin=origins if moved else origins[0].copy())
        if sensor_origin is not None:
            raise ValueError('sensor_origin is given but orientation is not "sensor".')
        if orientation is None or named == "mst":
            return cls(tree=named == "mst")
        d, name = X.shape[1], "orientation"
        direction = check_array(orientation, dtype=np.float64, ensure_2d=False, input_name=name)
        if direction.shape != (d,):
            raise ValueError(
                f"orientation must have shape ({d},) as X has {d} features, got {direction.shape}."
            )
        if not direction.any():
            raise ValueError("orientation as a direction must not be zero.")
        return cls(direction=direction)

    def fit(self, index, normals, X, n_jobs):
        """Flip the normals of the fitted points X (n, d) in place, and keep what `orient` needs."""
        if self._moves():
            orient_toward(normals, self.sensor_origin - X)
            self.sensor_origin = self.sensor_origin[index.rows]  # of its points
            return
        if self.tree:
            self._fit_tree(index, normals, X, n_jobs)
        self.orient(index, normals, X, n_jobs)

    def _moves(self):
        """Whether the sensor had more than one position."""
        return np.ndim(self.sensor_origin) == 2

    def _fit_tree(self, index, normals, X, n_jobs):
        """Make normals of neighbors agree along a minimum spanning tree (Hoppe et al., 1992)."""
        if index.n_neighbors is None:
            self.tree_normals = normals[:1].copy()
            return
        apart = np.empty_like(index.points)
        apart[index.nearest(X, effective_n_jobs(n_jobs))] = normals
        n, k = len(index.points), min(TreeLimits().n_neighbors, len(index.points))
        first = np.repeat(np.arange(n, dtype=np.int32), k)
        second = index.query_own(slice(None), k).indices.ravel()
        edges = spanning_forest(apart, index.points, first, second)
        self.tree_normals = apart * signs_along(apart, index.points, *edges)[:, None]

    def orient(self, index, normals, X, n_jobs):
        """Flip normals (m, d) of points X (m, d) in place.

        Where the sensor moved, each counts as measured from where the nearest fitted point was.
        """
        if self._moves():
            nearest = _nearest(index, X, n_jobs)
            orient_toward(normals, self.sensor_origin[nearest] - X)
        elif self.sensor_origin is not None:
            orient_toward(normals, self.sensor_origin - X)
        elif self.direction is not None:
            orient_toward(normals, self.direction)
        elif self.tree:
            nearest = index.nearest(X, effective_n_jobs(n_jobs))
            orient_toward(normals, self.tree_normals[nearest])


def _nearest(index, queries, n_jobs):
    if index.n_neighbors is None:  # and no tree
        return cKDTree(index.points).query(queries)[1]
    return index.nearest(queries, effective_n_jobs(n_jobs))
