"""The work on one tile: normals of its points, each proved to be that of the whole cloud."""

import json
import os
import secrets
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from sklearn.base import clone

from sklearn_mcmd.planes._certificate import proved_points, reaches, to_border
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM, distinct_rows
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._mending import WiderCloud, mended

__all__ = [
    "NORMAL_COLUMNS",
    "columns_of_tile",
    "normal_columns",
    "normals_of_tile",
    "result_dtype",
    "tile_files",
    "total_proved",
    "write_proved",
    "write_results",
]

# The halo is as wide as each level's neighborhoods, of which this share is no larger.
USUAL = 0.75
# It has no more points than this share of the tile's, or so many: next to a sparse tile there may
# be a dense one.
HALO, SMALL = 0.25, 20_000
SAMPLE, THINNED = 500, 50_000  # queries and points that tell the size of a neighborhood
MENDED = 20_000  # points whose results are mended at once, or an eighth of the tile's
MANY = 10  # times as many points as must be distinct
NORMAL_COLUMNS = (
    *("normal_x", "normal_y", "normal_z", "surface_variation"),
    *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "removed_fraction"),
)
# Columns of `transform` before the features: coordinates, normals, variation, eigenvalues, plane.
N_TRANSFORMED = 12


def normals_of_tile(folder, cell, estimator, constants, target, n_threads=1, columns_of=None):
    """Write the results of a tile; it depends on nothing but its arguments and the cells.

    Parameters
    ----------
    folder : path
        Of the `Cells`.
    cell : int
    estimator : RobustNormalEstimator
    constants : Constants
    target : path
        Of a folder. The file of results has the dtype `result_dtype`, sorted by rows.
    n_threads : int, default=1
    columns_of : callable, default=None
        What is stored of a fitted estimator: names and values; `normal_columns` with None.
    """
    named = normal_columns if columns_of is None else columns_of
    rows, columns, n_proved = columns_of_tile(
        Cells(folder), cell, estimator, constants, lambda fitted: named(fitted)[1], n_threads
    )
    write_proved(target, cell, rows, columns, n_proved)


def columns_of_tile(cells, cell, estimator, constants, columns_of, n_threads=1):
    """What is found of the points of a cell, each proved to be that of the whole cloud.

    Parameters
    ----------
    cells : Cells
    cell : int
    estimator : RobustNormalEstimator
    constants : Constants
    columns_of : callable
        Takes the fitted estimator, and returns the columns (n, n_columns) of its points.
    n_threads : int, default=1

    Returns
    -------
    rows : ndarray of int of shape (n,)
        Of the inputs.
    columns : ndarray of shape (n, n_columns)
    n_proved : int
        Points whose results the halo proved; the others were computed again.
    """
    records = cells.read(cell)
    own, rows = np.ascontiguousarray(records["xyz"]), records["row"].copy()
    del records
    levels, k = estimator._locality()
    width = (levels + 1) * _usual_reach(own, k, estimator.radius)
    halo, *box = cells.around(cell, width, max(int(HALO * len(own)), SMALL))
    complete = partial(_with_others, cells=cells, k=k)
    points = complete(np.vstack([own, halo]))
    fitted = clone(estimator).set_params(n_jobs=n_threads)
    fitted._tangents, fitted._step_of_cloud = estimator._tangents, constants.step
    fitted.fit(points.astype(constants.dtype, copy=False))
    columns, index = columns_of(fitted)[: len(own)], fitted._model.index
    reach = reaches(index, n_threads)
    exact = reach < to_border(index.points, *box)
    places = index.places[: len(own)]
    rest = np.flatnonzero(~proved_points(index, exact, levels, n_threads)[places])
    wrong, again = np.unique(places[rest], return_inverse=True)
    at_once = max(MENDED, len(own) // 8)
    for first in range(0, len(wrong), at_once):  # near ones together
        cloud = WiderCloud(cells, index, exact, reach, box, complete)
        result = mended(fitted, cloud, wrong[first : first + at_once], constants.dtype)
        these = (again >= first) & (again < first + at_once)
        columns[rest[these]] = columns_of(result)[again[these] - first]
    return rows, columns, len(own) - len(rest)


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


def tile_files(folder, cell):
    """The file of results of a tile, which is there when it is whole, and that of its report."""
    return Path(folder) / f"{cell}.results", Path(folder) / f"{cell}.json"


def total_proved(folder, cells):
    """How many points of some tiles the first halo has proved."""
    return sum(json.loads(tile_files(folder, cell)[1].read_text())["n_proved"] for cell in cells)


def _usual_reach(points, k, radius):
    """How far a usual neighborhood reaches; a guess, which costs time where it is wrong."""
    step = -(-len(points) // THINNED)
    thinned = points[::step]
    # A surface has k points where the thinned one has k / step in the same area.
    k_thinned = max(2, min(-(-k // step), len(thinned)))
    if len(thinned) < 2:
        return 0.0
    queries = thinned[:: -(-len(thinned) // SAMPLE)]
    distances = cKDTree(thinned, balanced_tree=False).query(queries, k_thinned)[0][:, -1]
    reach = float(np.quantile(distances, USUAL)) * np.sqrt(k / (k_thinned * step))
    return reach if radius is None else min(reach, radius)


def _with_others(points, cells, k):
    """Points with others of the cloud, so that more than k of them are distinct, and many.

    Small clouds are computed by other code, whose results differ by rounding. More points of the
    cloud do not change what a point's neighborhood is.
    """
    n_least = max(COMPILE_FROM, k + 1)
    for cell in range(len(cells)):
        some = points[: MANY * n_least]  # if enough of these are distinct, the others need no look
        if any(len(part) >= n_least <= len(distinct_rows(part)[0]) for part in (some, points)):
            break
        points = np.vstack([points, cells.read(cell)["xyz"]])
    return points


def write_proved(folder, cell, rows, values, n_proved):
    """Write how many points of a tile are proved, and then results, which tell that both are."""
    tile_files(folder, cell)[1].write_text(json.dumps({"n_proved": n_proved}))
    write_results(folder, cell, rows, values, result_dtype(values.shape[1], values.dtype))


def write_results(folder, cell, rows, values, dtype):
    """Write the results of a tile under a temporary name, which they leave when they are whole."""
    results = np.empty(len(rows), dtype)
    results["row"], results["values"] = rows, values.reshape(results["values"].shape)
    path = tile_files(folder, cell)[0]
    temporary = path.with_name(f"{path.stem}.{secrets.token_hex(4)}.part")  # one on all machines
    with open(temporary, "wb") as file:
        file.write(results.data)  # unlike tofile, it says why it fails
    os.replace(temporary, path)
