"""The work on one tile whose neighborhoods differ in size; sizes are those of the whole cloud."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.normals import RobustNormalEstimator
from sklearn_mcmd.planes._around import extents
from sklearn_mcmd.planes._certificate import SLACK, proved_points, reaches, to_border
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM, IndexedCloud, distinct_rows
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._constants import Constants
from sklearn_mcmd.tiling._mending import WiderCloud, mended
from sklearn_mcmd.tiling._search import all_places, around_box, as_near_as
from sklearn_mcmd.tiling._tile import (
    HALO,
    MENDED,
    SMALL,
    USUAL,
    _usual_reach,
    normal_columns,
    write_proved,
)

__all__ = ["SizedJob", "normals_of_sized_tile"]


class SizedJob(NamedTuple):
    """What the work on all tiles knows.

    cells, columns : Path
        Folders of `Cells` and `Columns`, of which "points" and "sizes" are read.
    estimator : RobustNormalEstimator
    constants : Constants
    largest : int
        Most neighbors of a place.
    n_threads : int
    """

    cells: Path
    columns: Path
    estimator: RobustNormalEstimator
    constants: Constants
    largest: int
    n_threads: int = 1


def normals_of_sized_tile(cell, job):
    """Write the results of a tile, as `normals_of_tile` does, and the numbers of neighbors."""
    cells, columns = Cells(job.cells), Columns(job.columns)
    rows, place_of = cells.read(cell)["row"].copy(), columns.read(cell, "place_of")
    own, sizes = columns.read(cell, "points"), columns.read(cell, "sizes")
    load, levels = all_places(columns), job.estimator._locality()[0]
    k = int(np.quantile(sizes, USUAL))
    width = (levels + 1) * _usual_reach(own, k, job.estimator.radius)
    halo, *box = around_box(cells, load, cell, width, max(int(HALO * len(own)), SMALL))
    complete = partial(_with_others, cells=cells, columns=columns, k=job.largest)
    points = np.vstack([own, halo.points])
    points, sizes = complete(points, halo.after([sizes], columns, "sizes"))
    fitted = clone(job.estimator).set_params(n_jobs=job.n_threads)
    fitted._step_of_cloud, fitted._sizes_of_cloud = job.constants.step, (job.largest, sizes)
    fitted.fit(points.astype(job.constants.dtype, copy=False))
    values, index = normal_columns(fitted)[1][: len(own)], fitted._model.index
    reach = reaches(index, job.n_threads)
    exact = reach < to_border(index.points, *box)
    places = index.places[: len(own)]
    rest = np.flatnonzero(~proved_points(index, exact, levels, job.n_threads)[places])
    at_once = max(MENDED, len(own) // 8)
    order = rest[np.argsort(places[rest])]  # near ones together
    for first in range(0, len(order), at_once):
        some = order[first : first + at_once]
        cloud = SizedCloud(cells, index, exact, reach, box, complete, columns)
        result = mended(fitted, cloud, places[some], job.constants.dtype)
        values[some] = normal_columns(result)[1]
    values = np.column_stack([values, sizes[: len(own)].astype(np.float32)])
    n_far = int(np.bincount(place_of, minlength=len(own))[rest].sum())
    write_proved(job.columns, cell, rows, values[place_of], len(rows) - n_far)


class SizedCloud(WiderCloud):
    """A `WiderCloud` whose neighborhoods have the sizes of their points.

    Parameters
    ----------
    cells, index, exact, reach, box
        As of `WiderCloud`.
    complete : callable
        Adds points of the cloud, and their sizes, to some.
    columns : Columns
    """

    def __init__(self, cells, index, exact, reach, box, complete, columns):
        super().__init__(cells, index, exact, reach, box, complete)
        self.columns = columns

    def _searched(self, rows, queries):
        """An index of points around queries, their neighborhoods, and how far these reach."""
        most = int(self.sizes[rows].max())
        found = as_near_as(self.cells, all_places(self.columns), queries, most, self.reach[rows])
        points, sizes = self.complete(found.points, found.values(self.columns, "sizes"))
        sizes = sizes[IndexedCloud.of(points).rows]
        near = NeighborIndex(points, self.index.n_neighbors, self.index.radius, sizes)
        around = near.query_own(near.nearest(queries))
        reach = SLACK * extents(near.points, queries, around)[1]
        return near, around, np.maximum(reach, self.index.radius or 0.0)

    def _numbers(self, near, used):
        numbers = super()._numbers(near, used)
        n_new = len(self.reach) - len(self.sizes)
        self.sizes = np.append(self.sizes, np.zeros(n_new, self.sizes.dtype))
        self.sizes[numbers] = near.sizes[used]
        return numbers


def _with_others(points, sizes, cells, columns, k):
    """Points with others of the cloud and their sizes, so that more than k are distinct, and many.

    See `tiling._tile`.
    """
    n_least = max(COMPILE_FROM, k + 1)
    for cell in range(len(cells)):
        if len(points) >= n_least <= len(distinct_rows(points)[0]):
            break
        points = np.vstack([points, columns.read(cell, "points")])
        sizes = np.concatenate([sizes, columns.read(cell, "sizes")])
    return points, sizes
