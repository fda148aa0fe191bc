"""The columns of ``RobustNormalEstimator.transform``, read back by the stages that follow it."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd._validation import check_extent
from sklearn_mcmd.planes._record import Planes

__all__ = ["Columns", "split_columns"]

# How far the length of a normal may be from 1. A file may have stored it with few digits.
TOLERANCE = 1e-3


class Columns(NamedTuple):
    """The first 3 d + 3 columns of a transformer; features may follow.

    coordinates, normals : ndarray of shape (n, d)
    surface_variation : ndarray of shape (n,)
    eigenvalues : ndarray of shape (n, d)
    offset : ndarray of shape (n,)
        Signed distance of each point's plane from the point, along its normal.
    scale : ndarray of shape (n,)
        Standard deviation of the plane's noise.
    """

    coordinates: np.ndarray
    normals: np.ndarray
    surface_variation: np.ndarray
    eigenvalues: np.ndarray
    offset: np.ndarray
    scale: np.ndarray

    def planes(self, rows):
        """The planes of some of the points: float64, of points that are projected on them.

        They count as having kept their neighborhoods; what columns do not tell is not a number.
        """
        points, normals = self.coordinates[rows], self.normals[rows].astype(np.float64)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)  # a file may have rounded them
        centroids = (points + self.offset[rows][:, None] * normals).astype(np.float64, copy=False)
        eigenvalues, scale = (
            values[rows].astype(np.float64, copy=False) for values in (self.eigenvalues, self.scale)
        )
        unknown = (np.full(len(points), np.nan) for _ in range(3))
        return Planes(centroids, normals, eigenvalues, scale, np.ones(len(points)), *unknown)


def split_columns(X, d=None):
    """Coordinates and planes of points, from the columns of a transformer.

    The number of dimensions follows from the columns: normals have length one, eigenvalues
    ascend, and surface variation is the share of the least in their sum.

    Parameters
    ----------
    X : ndarray of shape (n, n_columns)
    d : int, default=None
        Dimensions of the coordinates, if known.

    Returns
    -------
    Columns

    Raises
    ------
    ValueError
        If X has other columns.
    """
    most = (X.shape[1] - 3) // 3
    # With features behind them, the columns of 3D may look like those of more dimensions.
    possible = sorted(range(2, most + 1), key=lambda n: (n != 3, -n)) if d is None else (d,)
    for dimensions in possible:
        columns = _cut(X, dimensions)
        if _are_planes(columns):
            check_extent(columns.coordinates)
            return columns
    raise ValueError(
        f'normals="precomputed" but the {X.shape[1]} columns of X are not those of '
        "RobustNormalEstimator.transform: coordinates, unit normals, surface variation, "
        "eigenvalues, plane_offset and plane_scale (12 in 3D). Do not scale them; or give "
        'coordinates with normals="estimate".'
    )


def _cut(X, d):
    # Coordinates are copied to memory of their own, which makes all later work faster.
    eigenvalues = np.maximum(X[:, 2 * d + 1 : 3 * d + 1], 0)
    offset, scale = X[:, 3 * d + 1 : 3 * d + 3].T
    return Columns(X[:, :d].copy(), X[:, d : 2 * d], X[:, 2 * d], eigenvalues, offset, scale)


def _are_planes(columns):
    _, normals, variation, eigenvalues, _, _ = columns
    total = eigenvalues.sum(axis=1)
    lengths = np.sqrt(np.einsum("nd,nd->n", normals, normals))
    return (
        (np.abs(lengths - 1) <= TOLERANCE).all()
        and (np.diff(eigenvalues, axis=1) >= -TOLERANCE * total[:, None]).all()
        and (np.abs(variation * total - eigenvalues[:, 0]) <= TOLERANCE * total).all()
    )
