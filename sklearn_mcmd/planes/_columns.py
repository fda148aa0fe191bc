"""The columns of ``RobustNormalEstimator.transform``, read back by the stages that follow it."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd._validation import check_extent

__all__ = ["Columns", "split_columns"]

# How far the length of a normal may be from 1. A file may have stored it with few digits.
TOLERANCE = 1e-3


class Columns(NamedTuple):
    """The first 3 d + 1 columns: `surface_variation` has shape (n,), the others (n, d)."""

    coordinates: np.ndarray
    normals: np.ndarray
    surface_variation: np.ndarray
    eigenvalues: np.ndarray


def split_columns(X, d=None):
    """Coordinates, normals, surface variation and eigenvalues of points.

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
    most = (X.shape[1] - 1) // 3
    # With features behind them, the columns of 3D may look like those of more dimensions.
    possible = sorted(range(2, most + 1), key=lambda n: (n != 3, -n)) if d is None else (d,)
    for dimensions in possible:
        columns = _cut(X, dimensions)
        if _are_planes(columns):
            check_extent(columns.coordinates)
            return columns
    raise ValueError(
        f'normals="precomputed" but the {X.shape[1]} columns of X are not those of '
        "RobustNormalEstimator.transform: coordinates, unit normals, surface variation and "
        'eigenvalues (10 in 3D). Do not scale them; or give coordinates with normals="estimate".'
    )


def _cut(X, d):
    # Coordinates are copied to memory of their own, which makes all later work faster.
    return Columns(
        X[:, :d].copy(), X[:, d : 2 * d], X[:, 2 * d], np.maximum(X[:, 2 * d + 1 : 3 * d + 1], 0)
    )


def _are_planes(columns):
    _, normals, variation, eigenvalues = columns
    if eigenvalues.shape[1] != normals.shape[1]:
        return False
    total = eigenvalues.sum(axis=1)
    lengths = np.sqrt(np.einsum("nd,nd->n", normals, normals))
    return (
        (np.abs(lengths - 1) <= TOLERANCE).all()
        and (np.diff(eigenvalues, axis=1) >= -TOLERANCE * total[:, None]).all()
        and (np.abs(variation * total - eigenvalues[:, 0]) <= TOLERANCE * total).all()
    )
