"""The results of tiles: what they are of normals, their files, and all in the order of inputs."""

from bisect import bisect_left

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.tiling._sensor_origins import stored_origins
from sklearn_mcmd.tiling._stored_columns import mapped
from sklearn_mcmd.tiling._stored_light import stored_light

NORMAL_COLUMNS = (
    *("normal_x", "normal_y", "normal_z", "surface_variation"),
    *("eigenvalue_0", "eigenvalue_1", "eigenvalue_2", "removed_fraction"),
)
# Points that may be fitted at once; only copies make a cloud of few places so large.
MOST_COPIES = 1_000_000


class Results:
    """The results of all tiles in the order of the points, of which each is asked for once."""

    def __init__(self, columns, cells):
        self.paths, self.cells = [columns.path(i, "results") for i in range(len(cells))], cells
        # Of each tile, the first result that was not taken, and the row of its point.
        self.starts, self.rows = [0] * len(cells), [0] * len(cells)

    def take(self, first, n, n_expected=None):
        """Results (n, n_columns) of points from the row `first` on; 0 or NaN of those without."""
        some, n_found = mapped(self.paths[0], "r"), 0
        none = np.nan if some.dtype.kind == "f" else 0
        values = np.full((n, some.shape[1]), none, some.dtype)
        for tile, path in enumerate(self.paths):
            if self.rows[tile] >= first + n:
                continue
            rows, start = self.cells.rows(tile), self.starts[tile]
            stop = bisect_left(rows, first + n, start)
            values[rows[start:stop].astype(np.int64) - first] = mapped(path, "r")[start:stop]
            n_found += stop - start
            self.starts[tile] = stop
            self.rows[tile] = rows[stop] if stop < len(rows) else np.inf
        if n_expected is not None and n_found != n_expected:  # a fault of ours
            raise RuntimeError(f"{n_expected - n_found} of {n_expected} points have no results")
        return values


def normal_columns(fitted):
    """Names of the results of a fitted estimator, and their values: float32 (n, n_columns)."""
    names, n_features = fitted.get_feature_names_out(["x", "y", "z"]), fitted.features_.shape[1]
    names = [*NORMAL_COLUMNS, *names[len(names) - n_features :]]
    columns = np.empty((len(fitted.normals_), len(names)), np.float32)
    columns[:, :3], columns[:, 3] = fitted.normals_, fitted.surface_variation_
    columns[:, 4:7], columns[:, 7] = fitted.eigenvalues_, fitted.removed_fraction_
    columns[:, 8:] = fitted.features_
    if fitted.n_neighbors == "auto":
        names, sizes = [*names, "n_neighbors"], fitted.n_neighbors_.astype(np.float32)
        columns = np.column_stack([columns, sizes])
    return names, columns


def scores_of(columns, cells):
    """The scores of all points, cell by cell."""
    for cell in range(len(cells)):
        yield columns.read(cell, "results")[:, 0]


def write_results_of_places(job, values):
    """Write the results of all points, which are the values of their places."""
    columns, whole = job.columns, job.whole()
    for cell in range(whole.n_cells):
        place_of = columns.read(cell, "place_of")
        columns.write(cell, results=values[whole.rows(cell)][place_of, None])


def fit_together(job, estimator, cells, values_of):
    """An estimator fitted to all points in the order of the inputs; writes ``values_of(fitted)``.

    Clouds of so few places are worked on in one piece, by other code than tiles.
    """
    n_points = int(cells.counts.sum())
    if n_points > MOST_COPIES:
        raise ValueError(
            f"{n_points:,} points at {len(job.whole()):,} places are no cloud to be divided into "
            "tiles; leave copies out"
        )
    parts = range(len(cells))
    rows, points = (np.concatenate(list(map(of, parts))) for of in (cells.rows, cells.points))
    order = np.argsort(rows)
    fitted, origins = clone(estimator), stored_origins(cells.folder)
    given = {} if origins is None else {"sensor_origin": origins[rows[order]]}
    if (light := stored_light(cells.folder)) is not None:
        given["intensity"] = light[rows[order]]
    fitted.fit(points[order].astype(job.constants.dtype), **given)
    values = np.empty_like(found := values_of(fitted))
    values[order] = found
    for cell, own in enumerate(np.split(values, np.cumsum(cells.counts)[:-1])):
        job.columns.write(cell, results=own.reshape(len(own), -1))
    return fitted
