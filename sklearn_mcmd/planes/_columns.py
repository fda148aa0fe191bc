"""The columns of ``RobustNormalEstimator.transform``: written, and read back by later stages."""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd._validation import check_extent
from sklearn_mcmd.planes._principal_planes import surface_variation
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.runtime._chunks import slices

TOLERANCE = 1e-3  # of the length of a normal, which a file may have stored with few digits
CHUNK = 4096  # rows at once, whose columns stay in the processor's cache
ROWS_AT_ONCE = 100_000  # whose distances from planes are computed; it limits the memory


class Columns(NamedTuple):
    """The first 3 d + 3 columns of a transformer; features may follow."""

    coordinates: np.ndarray  # (n, d), as normals and eigenvalues; all others (n,)
    normals: np.ndarray
    surface_variation: np.ndarray
    eigenvalues: np.ndarray
    offset: np.ndarray  # signed distance of each point's plane from the point, along its normal
    scale: np.ndarray  # standard deviation of the plane's noise

    @classmethod
    def of(cls, fitted, X):
        """Those that a `RobustNormalEstimator` fitted to X has found, in the dtype of X, without
        the copies that `transform` makes."""
        columns = cls(
            coordinates=X,
            normals=fitted.normals_,
            surface_variation=fitted.surface_variation_,
            eigenvalues=fitted.eigenvalues_,
            offset=fitted.plane_offset_,
            scale=fitted.plane_scale_,
        )
        return cls._make(values.astype(X.dtype, copy=False) for values in columns)

    def planes(self, rows):
        """The planes of some of the points, float64; what columns lack is no number or left out."""
        planes = Planes.empty(len(rows), self.coordinates.shape[1])
        planes = planes.without("eigenvalues", "kept", "normal_error")
        planes.radius[:] = np.nan
        for part in slices(len(rows), CHUNK):
            chosen = rows[part]
            normals = self.normals[chosen].astype(np.float64)
            # A file may have rounded them.
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            planes.normals[part] = normals
            planes.centroids[part] = self.coordinates[chosen] + self.offset[chosen, None] * normals
            planes.scale[part] = self.scale[chosen]
        return planes


def column_names(coordinates, features):
    """Names of `joined_columns`, from those of the coordinates and of the features behind."""
    normals = (f"normal_{name}" for name in coordinates)
    eigenvalues = (f"eigenvalue_{i}" for i in range(len(coordinates)))
    planes = "surface_variation", *eigenvalues, "plane_offset", "plane_scale"
    return np.asarray([*coordinates, *normals, *planes, *features], dtype=object)


def joined_columns(X, normals, eigenvalues, *others):
    """Columns in their order, in the dtype of X: coordinates first, then `Columns` and features."""
    variation = surface_variation(eigenvalues)[:, None]
    columns = np.hstack([X, normals, variation, eigenvalues, *others])
    return columns.astype(X.dtype, copy=False)


def plane_offsets(planes, normals, X):
    """Signed distances (n,) of planes from their points X, along the normals."""
    offset = np.empty(len(X))
    for rows in slices(len(X), ROWS_AT_ONCE):
        np.einsum("nd,nd->n", planes.centroids[rows] - X[rows], normals[rows], out=offset[rows])
    return offset


def split_columns(X, d=None):
    """Coordinates and planes of points, as `Columns`, from the columns of a transformer.

    If `d` is None, the number of dimensions follows from the columns: normals have length
    one, eigenvalues ascend, and surface variation is the share of the least in their sum. Other
    columns raise a ValueError.
    """
    most = (X.shape[1] - 3) // 3
    # With features behind them, the columns of 3D may look like those of more dimensions.
    possible = sorted(range(2, most + 1), key=lambda n: (n != 3, -n)) if d is None else (d,)
    for dimensions in possible:
        columns = _cut(X, dimensions)
        if columns is not None:
            check_extent(columns.coordinates)
            return columns
    raise ValueError(
        f'normals="precomputed" but the {X.shape[1]} columns of X are not those of '
        "RobustNormalEstimator.transform: coordinates, unit normals, surface variation, "
        "eigenvalues, plane_offset and plane_scale (12 in 3D). Do not scale them; or give "
        'coordinates with normals="estimate".'
    )


def _cut(X, d):
    """The columns of d dimensions; None if they are not those of planes."""
    # Coordinates are copied to memory of their own, which makes all later work faster.
    coordinates, eigenvalues = np.empty((len(X), d), X.dtype), np.empty((len(X), d), X.dtype)
    normals, variation = X[:, d : 2 * d], X[:, 2 * d]
    offset, scale = X[:, 3 * d + 1 : 3 * d + 3].T
    for part in slices(len(X), CHUNK):
        coordinates[part] = X[part, :d]
        values = np.maximum(X[part, 2 * d + 1 : 3 * d + 1], 0, out=eigenvalues[part])
        if not _are_planes(normals[part], variation[part], values):
            return None
    return Columns(
        coordinates=coordinates,
        normals=normals,
        surface_variation=variation,
        eigenvalues=eigenvalues,
        offset=offset,
        scale=scale,
    )


def _are_planes(normals, variation, eigenvalues):
    total = eigenvalues.sum(axis=1)
    lengths = np.sqrt(np.einsum("nd,nd->n", normals, normals))
    return (
        (np.abs(lengths - 1) <= TOLERANCE).all()
        and (np.diff(eigenvalues, axis=1) >= -TOLERANCE * total[:, None]).all()
        and (np.abs(variation * total - eigenvalues[:, 0]) <= TOLERANCE * total).all()
    )
