"""Which of its two sides a normal points to."""

import numpy as np
from joblib import effective_n_jobs
from sklearn.utils.validation import check_array

from sklearn_mcmd.planes._orientation import orient_by_spanning_tree, orient_toward

__all__ = ["Sides"]

# Number of neighbors whose normals orientation="mst" makes agree.
TREE_NEIGHBORS = 12


class Sides:
    """The sides of normals that `orientation` and `sensor_origin` of the estimator ask for.

    Parameters
    ----------
    direction : ndarray of shape (d,) or None
    sensor_origin : ndarray of shape (d,) or None
    tree : bool
        Whether neighbors are to agree, along a spanning tree.
    """

    def __init__(self, direction=None, sensor_origin=None, tree=False):
        self.direction, self.sensor_origin, self.tree = direction, sensor_origin, tree

    @classmethod
    def settled(cls, orientation, sensor_origin, d):
        """Check the parameters for clouds of d dimensions."""
        named = orientation if isinstance(orientation, str) else None
        if named == "sensor":
            if sensor_origin is None:
                raise ValueError(
                    'orientation="sensor" needs sensor_origin, where the sensor stood.'
                )
            if isinstance(sensor_origin, str):
                return cls(sensor_origin=np.zeros(d))  # "origin"
            return cls(sensor_origin=_check_vector(sensor_origin, "sensor_origin", d))
        if sensor_origin is not None:
            raise ValueError('sensor_origin is given but orientation is not "sensor".')
        if orientation is None or named == "mst":
            return cls(tree=named == "mst")
        direction = _check_vector(orientation, "orientation", d)
        if not direction.any():
            raise ValueError("orientation as a direction must not be zero.")
        return cls(direction=direction)

    def fit(self, index, normals, X, n_jobs):
        """Keep what the sides depend on of the fitted points X (n, d) and their normals (n, d)."""
        self.tree_normals = None
        if not self.tree:
            return
        if index.n_neighbors is None:
            self.tree_normals = normals[:1].copy()
            return
        apart = np.empty_like(index.points)
        apart[index.nearest(X, effective_n_jobs(n_jobs))] = normals
        k = min(TREE_NEIGHBORS, len(index.points))
        neighbors = index.query_own(slice(None), k).indices
        self.tree_normals = orient_by_spanning_tree(apart, index.points, neighbors)

    def orient(self, index, normals, X, n_jobs):
        """Flip normals (m, d) of points X (m, d) in place."""
        if self.sensor_origin is not None:
            orient_toward(normals, self.sensor_origin - X)
        elif self.direction is not None:
            orient_toward(normals, self.direction)
        elif self.tree:
            nearest = index.nearest(X, effective_n_jobs(n_jobs))
            orient_toward(normals, self.tree_normals[nearest])


def _check_vector(vector, name, d):
    vector = check_array(vector, ensure_2d=False, dtype=np.float64, input_name=name)
    if vector.shape != (d,):
        raise ValueError(
            f"{name} must have shape ({d},) as X has {d} features, got {vector.shape}."
        )
    return vector
