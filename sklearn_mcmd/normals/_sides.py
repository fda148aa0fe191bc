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

    Both are checked for the fitted points X (n, d). The sensor's origin is None, (d,), or (n, d) of
    these points.
    """

    def __init__(self, orientation, sensor_origin, X):
        named = orientation if isinstance(orientation, str) else None
        self.direction, self.sensor_origin, self.tree = None, None, named == "mst"
        if named == "sensor":
            if sensor_origin is None:
                raise ValueError(
                    'orientation="sensor" needs sensor_origin, where the sensor stood.'
                )
            origins = check_sensor_origin(sensor_origin, X)
            moved = (origins != origins[0]).any()
            self.sensor_origin = origins if moved else origins[0].copy()
        elif sensor_origin is not None:
            raise ValueError('sensor_origin is given but orientation is not "sensor".')
        elif orientation is not None and named is None:
            self.direction = _checked_direction(orientation, X.shape[1])

    def fit(self, index, normals, X, n_jobs):
        """Flip the normals of the fitted points X (n, d) in place, and keep what `orient` needs."""
        if self.sensor_origin is not None and self.sensor_origin.ndim == 2:
            orient_toward(normals, self.sensor_origin - X)
            self.sensor_origin = self.sensor_origin[index.rows]  # of its points
            return
        nearest = None
        if self.tree:
            nearest = np.zeros(len(X), int) if index.n_neighbors is None else index.places
            self._fit_tree(index, normals, nearest)
        self.orient(index, normals, X, n_jobs, nearest)

    def _fit_tree(self, index, normals, nearest):
        """Make normals of neighbors agree along a minimum spanning tree (Hoppe et al., 1992)."""
        if index.n_neighbors is None:
            self.tree_normals = normals[:1].copy()
            return
        apart = np.empty_like(index.points)
        apart[nearest] = normals
        n, k = len(index.points), min(TreeLimits().n_neighbors, len(index.points))
        first = np.repeat(np.arange(n, dtype=np.int32), k)
        second = index.query_own(slice(None), k).indices.ravel()
        first, second = spanning_forest(apart, index.points, first, second)
        signs = signs_along(apart, index.points, first, second)
        self.tree_normals = apart * signs[:, None]

    def orient(self, index, normals, X, n_jobs, nearest=None):
        """Flip normals (m, d) of points X (m, d) in place; of a tree, the `nearest` of the index's
        points (m,) may be known.

        Where the sensor moved, each counts as measured from where the nearest fitted point was.
        """
        if self.sensor_origin is not None:
            origins = self.sensor_origin
            if origins.ndim == 2:
                if index.n_neighbors is None:
                    origins = origins[cKDTree(index.points).query(X)[1]]
                else:
                    origins = origins[index.nearest(X, effective_n_jobs(n_jobs))]
            orient_toward(normals, origins - X)
        elif self.direction is not None:
            orient_toward(normals, self.direction)
        elif self.tree:
            if nearest is None:
                nearest = index.nearest(X, effective_n_jobs(n_jobs))
            orient_toward(normals, self.tree_normals[nearest])


def _checked_direction(orientation, d):
    direction = check_array(
        orientation, dtype=np.float64, ensure_2d=False, input_name="orientation"
    )
    if direction.shape != (d,):
        raise ValueError(
            f"orientation must have shape ({d},) as X has {d} features, got {direction.shape}."
        )
    if not direction.any():
        raise ValueError("orientation as a direction must not be zero.")
    return direction
