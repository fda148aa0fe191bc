"""Planes, neighbors and links of the places of a cloud, cell by cell, for regions to grow along."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._columns import joined_columns, split_columns
from sklearn_mcmd.segmentation import RegionGrowing
from sklearn_mcmd.segmentation._graph import Linking
from sklearn_mcmd.segmentation._steps import least_scales, rules_of
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._constants import Constants
from sklearn_mcmd.tiling._stored import (
    OwnNeighbors,
    StoredIndex,
    chunks_of,
    nearest_rows,
    places_of_cell,
)
from sklearn_mcmd.tiling._tile import columns_of_tile
from sklearn_mcmd.tiling._whole import WholeColumns

__all__ = [
    "GrowthJob",
    "find_links",
    "find_neighbors",
    "find_planes",
]


class GrowthJob(NamedTuple):
    """What all sweeps over the cells of a cloud know.

    cells, columns : Path
        Folders of `Cells` and `Columns`.
    growing : RegionGrowing
        With an estimator of normals.
    constants : Constants
    n_threads : int
        Of each worker.
    """

    cells: Path
    columns: Path
    growing: RegionGrowing
    constants: Constants
    n_threads: int = 1

    def open(self):
        """The cells, and the columns of their places."""
        return Cells(self.cells), Columns(self.columns)

    def whole(self):
        """The columns of all places, once their planes are known."""
        cells, columns = self.open()
        return WholeColumns(columns, len(cells))


def find_planes(cell, job):
    """Write the places of a cell, and their planes as `RegionGrowing` takes them.

    Columns: points, in spatial order; copies; centroids, normals, scale; variation; floor, the
    least scale; and place_of, the place of each point of the cell.
    """
    cells, columns = job.open()
    dtype = np.dtype(job.constants.dtype)

    def of_fitted(fitted):
        return joined_columns(
            np.empty((len(fitted.normals_), 0), dtype), fitted.normals_, fitted.eigenvalues_,
            fitted.plane_offset_[:, None], fitted.plane_scale_[:, None],
        )  # fmt: skip

    _, found, report = columns_of_tile(
        cells, cell, job.growing.normal_estimator, job.constants, of_fitted, job.n_threads
    )
    points = cells.read(cell)["xyz"]
    rows, place_of = places_of_cell(points)
    copies = np.bincount(place_of, minlength=len(rows)).astype(np.int32)
    points, found = np.ascontiguousarray(points[rows]), found[rows]
    told = split_columns(np.hstack([points.astype(dtype), found]), 3)
    planes = told.planes(np.arange(len(points)))
    floor = least_scales(points, dtype, job.constants.step)
    columns.write(
        cell, points=points, copies=copies, place_of=place_of.astype(np.int32), floor=floor,
        centroids=planes.centroids, normals=planes.normals,
        scale=np.maximum(planes.scale, floor), variation=np.array(told.surface_variation),
    )  # fmt: skip
    columns.finish(cell, "planes", n_places=len(points), n_proved=report.n_proved)


def find_neighbors(cell, job):
    """Write the neighbors of the places of a cell, and what these tell of their planes.

    Columns: near, rows of all places; radius, limit and usable, as `Linking` measures them. The
    limit is left out where the scale is it.
    """
    cells, _ = job.open()
    whole = job.whole()
    points, own = whole.open("points"), whole.rows(cell)
    near, n_far = nearest_rows(cells, whole, cell, min(job.growing.n_neighbors, len(whole)))
    index = OwnNeighbors(points, near, own.start)
    linking = _linking(index, whole, job)
    radius, usable, limits = [], [], []
    for rows in chunks_of(own):
        some = linking.measured(rows)
        for values, found in zip((radius, limits, usable), some, strict=True):
            values.append(found)
    written = {"near": near, "radius": np.concatenate(radius), "usable": np.concatenate(usable)}
    if linking.has_limits:
        written["limit"] = np.concatenate(limits)
    whole.columns.write(cell, **written)
    whole.columns.finish(cell, "neighbors", n_far=n_far)


def find_links(cell, job):
    """Write the links of the places of a cell: rows of all places."""
    whole = job.whole()
    linking = _linking(StoredIndex(whole), whole, job)
    own = whole.rows(cell)
    links = np.empty((own.stop - own.start, linking.k), np.int32)
    limit = whole.open("limit" if linking.has_limits else "scale")
    link = linking.linker(limit, whole.open("usable"))
    for rows in chunks_of(own):
        link(rows, links[rows.start - own.start : rows.stop - own.start])
    whole.columns.write(cell, links=links)
    whole.columns.finish(cell, "links")


def _linking(index, whole, job):
    return Linking(index, whole.planes(), whole.open("floor"), rules_of(job.growing))
