"""The results of tiles: what they are of normals, their files, and all in the order of inputs."""

from pathlib import Path

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.tiling._cell_columns import in_place_of
from sklearn_mcmd.tiling._sensor_origins import stored_origins
from sklearn_mcmd.tiling._stored_columns import whole_of

__all__ = [
    "LABELED",
    "NORMAL_COLUMNS",
    "N_TRANSFORMED",
    "SCORED",
    "VERDICTS",
    "Results",
    "fit_together",
    "has_scores",
    "normal_columns",
    "result_dtype",
    "scores_in_parts",
    "tile_file",
    "write_results",
]

NORMAL_COLUMNS = (
    *("normal_x", "normal_y", "normal_z", "surface_variation"),
    *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "removed_fraction"),
)
# Columns of `transform` before the features: coordinates, normals, variation, eigenvalues, plane.
N_TRANSFORMED = 12
# Points that may be fitted at once; only copies make a cloud of few places so large.
MOST_COPIES = 1_000_000
# Results that wait in memory to be written: of a tile, and bytes of all of them.
WAITING, WAITING_BYTES = 2048, 50e6


def result_dtype(n_columns, dtype=np.float32):
    """The dtype of the file of a tile: the place of a point in the input, and its results."""
    return np.dtype([("row", np.int64), ("values", dtype, (n_columns,))])


# Scores; the same where heights have a say: scores of all points, or the depths of groups below the
# ground if these are more; and these depths, NaN of points that are used but not judged.
SCORED, VERDICTS = result_dtype(1, np.float64), result_dtype(2, np.float64)
LABELED = result_dtype(1, np.int32)  # regions


class Results:
    """The results of all tiles in the order of the points, of which each is asked for once."""

    def __init__(self, folder, n_tiles, dtype):
        self.paths = [tile_file(folder, cell) for cell in range(n_tiles)]
        self.dtype = dtype
        self.waiting = [np.empty(0, self.dtype)] * n_tiles
        self.read = [0] * n_tiles
        self.n_read = int(np.clip(WAITING_BYTES / n_tiles / self.dtype.itemsize, 16, WAITING))

    def take(self, first, n, expected=True):
        """Results (n, n_columns) of the points from the row `first` on.

        `expected` are the points that have results, a mask, True for all; False if that is unknown.
        Others have NaN.
        """
        of_row = self.dtype["values"]
        values, found = np.empty((n, of_row.shape[0]), of_row.base), 0
        if expected is not True:
            values[:] = np.nan
        for tile in range(len(self.paths)):
            for part in self._parts(tile, first + n):
                values[part["row"] - first] = part["values"]
                found += len(part)
        wanted = n if expected is True else np.count_nonzero(expected)
        if expected is not False and found != wanted:
            # a fault of ours
            raise RuntimeError(f"{wanted - found} of {wanted} points have no results")
        return values

    def _parts(self, tile, stop):
        while True:
            waiting = self.waiting[tile]
            n = int(np.searchsorted(waiting["row"], stop))
            yield waiting[:n]
            self.waiting[tile] = waiting[n:]
            if n < len(waiting):
                return
            offset = self.read[tile] * self.dtype.itemsize
            self.waiting[tile] = np.fromfile(
                self.paths[tile], self.dtype, self.n_read, offset=offset
            )
            self.read[tile] += len(self.waiting[tile])
            if not len(self.waiting[tile]):
                return


def normal_columns(fitted):
    """Names of the results of a fitted estimator, and their values: float32 (n, n_columns)."""
    names = [*NORMAL_COLUMNS, *fitted.get_feature_names_out(["x", "y", "z"])[N_TRANSFORMED:]]
    columns = np.empty((len(fitted.normals_), len(names)), np.float32)
    columns[:, :3], columns[:, 3] = fitted.normals_, fitted.surface_variation_
    columns[:, 4:7], columns[:, 7] = fitted.eigenvalues_, fitted.removed_fraction_
    columns[:, 8:] = fitted.features_
    if fitted.n_neighbors == "auto":
        names, sizes = [*names, "n_neighbors"], fitted.n_neighbors_.astype(np.float32)
        columns = np.column_stack([columns, sizes])
    return names, columns


def tile_file(folder, cell):
    """The file of results of a tile, which is there when it is whole."""
    return Path(folder) / f"{cell}.results"


def has_scores(results, cell):
    """Whether the scores of a tile are there."""
    return tile_file(results, cell).exists()


def scores_in_parts(results, n_cells, dtype=SCORED):
    """The scores of all points, tile by tile."""
    for cell in range(n_cells):
        yield np.fromfile(tile_file(results, cell), dtype)["values"][:, 0]


def write_results(folder, cell, rows, values, dtype):
    """Write the results of a tile."""
    results = np.empty(len(rows), dtype)
    results["row"], results["values"] = rows, values.reshape(results["values"].shape)
    with in_place_of(tile_file(folder, cell)) as temporary:
        temporary.write_bytes(results.data)  # unlike tofile, it says why it fails


def fit_together(job, estimator, cells, words=" at {:,} places"):
    """An estimator fitted to all points of a cloud in the order of the inputs, and `put`.

    Clouds of so few places are worked on in one piece, by other code than tiles.
    ``put(values, dtype)`` writes values of these points as results of the job. `words` tell where
    the points are, for the error.
    """
    n_points = int(cells.counts.sum())
    if n_points > MOST_COPIES:
        words = words.format(len(whole_of(job)))
        raise ValueError(f"{n_points:,} points{words} are no cloud to be divided into tiles")
    records = [cells.read(cell) for cell in range(len(cells))]
    rows, points = (np.concatenate([part[name] for part in records]) for name in ("row", "xyz"))
    order = np.argsort(rows)
    fitted, origins = clone(estimator), stored_origins(cells.folder)
    given = {} if origins is None else {"sensor_origin": origins[rows[order]]}
    fitted.fit(points[order].astype(job.constants.dtype), **given)
    places, ends = np.empty_like(order), np.cumsum([len(part) for part in records])[:-1]
    places[order] = np.arange(len(order))

    def put(values, dtype):
        for cell, some in enumerate(np.split(places, ends)):
            write_results(job.columns, cell, records[cell]["row"], values[some], dtype)

    return fitted, put
