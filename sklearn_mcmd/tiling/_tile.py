"""The work on one tile: normals of its points, each proved to be that of the whole cloud."""

import json
import os
import secrets
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from sklearn.base import clone

from sklearn_mcmd.planes._certificate import proved_points, reaches, to_border
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM, distinct_rows
from sklearn_mcmd.tiling._cells import Cells

__all__ = [
    "NORMAL_COLUMNS",
    "TileReport",
    "normal_columns",
    "normals_of_tile",
    "result_dtype",
    "tile_files",
]

# The halo is as wide as each level's neighborhoods, of which this share is no larger.
USUAL = 0.75
# It has no more points than this share of the tile's, or so many: next to a sparse tile there may
# be a dense one.
HALO, SMALL = 0.25, 20_000
SAMPLE, THINNED = 500, 50_000  # queries and points that tell the size of a neighborhood
MANY = 10  # times as many points as must be distinct
NORMAL_COLUMNS = (
    *("normal_x", "normal_y", "normal_z", "surface_variation"),
    *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "removed_fraction"),
)
# Columns of `transform` before the features: coordinates, normals, variation, eigenvalues, plane.
N_TRANSFORMED = 12


class TileReport(NamedTuple):
    """What the work on a tile came to.

    n_points : int
    n_halo : int
        Points read around the tile.
    n_proved : int
        Points whose normals the halo proved; the others were computed again.
    n_again : int
        Points that were read for these others.
    seconds : float
    """

    n_points: int
    n_halo: int
    n_proved: int
    n_again: int
    seconds: float


def normals_of_tile(folder, cell, estimator, constants, target):
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

    Returns
    -------
    TileReport
    """
    begin = time.perf_counter()
    cells = Cells(folder)
    records = cells.read(cell)
    own, rows = np.ascontiguousarray(records["xyz"]), records["row"].copy()
    del records
    levels, k = estimator._locality()
    width = (levels + 1) * _usual_reach(own, k, estimator.radius)
    halo, *box = cells.around(cell, width, max(int(HALO * len(own)), SMALL))
    points = _with_others(np.vstack([own, halo]), cells, k)
    columns, index = _fit(estimator, constants, points, len(own))
    reach = reaches(index)
    exact = reach < to_border(index.points, *box)
    places = index.places[: len(own)]
    rest = np.flatnonzero(~proved_points(index, exact, levels)[places])
    n_again, waiting = 0, [rest[np.argsort(places[rest])]]  # near ones together
    while waiting and len(rest):
        some = waiting.pop()
        needed = _dependence(cells, index, exact, reach, np.unique(places[some]), levels, box)
        if len(needed) > max(len(own), SMALL) and len(some) > 1:
            waiting += np.array_split(some, 2)
            continue
        points = _with_others(np.vstack([own[some], needed]), cells, k)
        columns[some] = _fit(estimator, constants, points, len(some))[0]
        n_again += len(needed)
    results = np.empty(len(own), result_dtype(columns.shape[1]))
    results["row"], results["values"] = rows, columns
    report = TileReport(
        *map(int, (len(own), len(halo), len(own) - len(rest), n_again)), time.perf_counter() - begin
    )
    _write(target, cell, results, report)
    return report


def normal_columns(fitted):
    """Names of the results of a fitted estimator, and their values: float32 (n, n_columns)."""
    names = [*NORMAL_COLUMNS, *fitted.get_feature_names_out(["x", "y", "z"])[N_TRANSFORMED:]]
    columns = np.empty((len(fitted.normals_), len(names)), np.float32)
    columns[:, :3], columns[:, 3] = fitted.normals_, fitted.surface_variation_
    columns[:, 4:7], columns[:, 7] = fitted.eigenvalues_, fitted.removed_fraction_
    columns[:, 8:] = fitted.features_
    return names, columns


def result_dtype(n_columns):
    """The dtype of the file of a tile: the place of a point in the input, and its results."""
    return np.dtype([("row", np.int64), ("values", np.float32, n_columns)])


def tile_files(folder, cell):
    """The file of results of a tile, which is there when it is whole, and that of its report."""
    return Path(folder) / f"{cell}.results", Path(folder) / f"{cell}.json"


def _fit(estimator, constants, points, n):
    """Results (n, n_columns) of the first n points, and the index of all of them."""
    estimator = clone(estimator)
    estimator._step_of_cloud = constants.step
    estimator.fit(points.astype(constants.dtype, copy=False))
    return normal_columns(estimator)[1][:n], estimator._model.index


def _dependence(cells, index, exact, reach, rows, levels, box):
    """All points (n, 3) that the results of some of the index's points depend on, and some more.

    Parameters
    ----------
    cells : Cells
    index : NeighborIndex
        Of all points of a box, and maybe of others.
    exact : ndarray of bool of shape (m,)
        Which neighborhoods the index knows. The others are searched for in all cells, ...
    reach : ndarray of shape (m,)
        ... not farther than this.
    rows : ndarray of int
        Of the index's points.
    levels : int
    box : pair of ndarray of shape (3,)
    """
    inside, beyond, new = np.zeros(len(exact), bool), np.empty((0, 3)), np.empty((0, 3))
    inside[rows], farthest = True, 0.0
    for _ in range(levels + 1):
        known = exact[rows]
        near = inside.copy()
        near[index.query_own(rows[known]).indices] = True
        queries = np.vstack([index.points[rows[~known]], new])
        if len(queries):
            # All neighbors of a point that was found lie as near to it as the ball is wide.
            bounds = np.append(reach[rows[~known]], np.full(len(new), 2.0 * farthest))
            found, farthest = cells.neighbors(queries, index.n_neighbors, bounds)
            within = ((found >= box[0]) & (found < box[1])).all(axis=1)
            near[index.nearest(found[within])] = True
            n_before, beyond = len(beyond), np.vstack([beyond, found[~within]])
            beyond = beyond[distinct_rows(beyond)[0]] if len(beyond) else beyond
            new = beyond[n_before:]
        rows, inside = np.flatnonzero(near & ~inside), near
    return np.vstack([index.points[inside], beyond])


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


def _write(folder, cell, results, report):
    """Write a tile under a temporary name, which it leaves when it is whole."""
    whole, report_file = tile_files(folder, cell)
    report_file.write_text(json.dumps(report._asdict()))
    temporary = whole.with_name(f"{cell}.{secrets.token_hex(4)}.part")  # of many machines
    with open(temporary, "wb") as file:
        file.write(results.data)  # unlike tofile, it says why it fails
    os.replace(temporary, whole)
