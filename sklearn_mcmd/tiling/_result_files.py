"""The results of tiles: what they are of normals, and their files."""

import os
import secrets
from pathlib import Path

import numpy as np

__all__ = [
    "NORMAL_COLUMNS",
    "N_TRANSFORMED",
    "normal_columns",
    "result_dtype",
    "tile_file",
    "write_results",
]

NORMAL_COLUMNS = (
    *("normal_x", "normal_y", "normal_z", "surface_variation"),
    *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "removed_fraction"),
)
# Columns of `transform` before the features: coordinates, normals, variation, eigenvalues, plane.
N_TRANSFORMED = 12


def normal_columns(fitted):
    """Names of the results of a fitted estimator, and their values: float32 (n, n_columns)."""
    names = [*NORMAL_COLUMNS, *fitted.get_feature_names_out(["x", "y", "z"])[N_TRANSFORMED:]]
    columns = np.empty((len(fitted.normals_), len(names)), np.float32)
    columns[:, :3], columns[:, 3] = fitted.normals_, fitted.surface_variation_
    columns[:, 4:7], columns[:, 7] = fitted.eigenvalues_, fitted.removed_fraction_
    columns[:, 8:] = fitted.features_
    return names, columns


def result_dtype(n_columns, dtype=np.float32):
    """The dtype of the file of a tile: the place of a point in the input, and its results."""
    return np.dtype([("row", np.int64), ("values", dtype, (n_columns,))])


def tile_file(folder, cell):
    """The file of results of a tile, which is there when it is whole."""
    return Path(folder) / f"{cell}.results"


def write_results(folder, cell, rows, values, dtype):
    """Write the results of a tile under a temporary name, which they leave when they are whole."""
    results = np.empty(len(rows), dtype)
    results["row"], results["values"] = rows, values.reshape(results["values"].shape)
    path = tile_file(folder, cell)
    temporary = path.with_name(f"{path.stem}.{secrets.token_hex(4)}.part")  # one on all machines
    with open(temporary, "wb") as file:
        file.write(results.data)  # unlike tofile, it says why it fails
    os.replace(temporary, path)
