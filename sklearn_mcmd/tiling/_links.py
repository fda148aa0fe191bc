"""Planes, neighbors and links of the places of a cloud, cell by cell, for regions to grow along."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._columns import joined_columns, split_columns
from sklearn_mcmd.planes._indexed_cloud import (
    COMPILE_FROM,
    ORDER_FROM,
    distinct_rows,
    spatial_order,
)
from sklearn_mcmd.planes._linking import farthest_neighbors
from sklearn_mcmd.planes._record import Neighborhoods
from sklearn_mcmd.planes._self_search import SelfSearch
from sklearn_mcmd.segmentation import RegionGrowing
from sklearn_mcmd.segmentation._graph import Linking
from sklearn_mcmd.segmentation._steps import least_scales, rules_of
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._constants import Constants
from sklearn_mcmd.tiling._search import visit_far, visit_nearest
from sklearn_mcmd.tiling._tile import columns_of_tile
from sklearn_mcmd.tiling._whole import CHUNK, StoredIndex, WholeColumns

__all__ = [
    "GrowthJob",
    "find_links",
    "find_neighbors",
    "find_planes",
    "nearest_rows",
    "places_of_cell",
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

    _, found, n_proved = columns_of_tile(
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
    columns.finish(cell, "planes", n_places=len(points), n_proved=n_proved)


def places_of_cell(points):
    """Rows of the distinct points of a cell, near ones together, and the place of each point."""
    rows, place_of = distinct_rows(points)
    place_of = np.arange(len(points)) if place_of is None else place_of
    if len(rows) >= ORDER_FROM:
        order = spatial_order(points[rows])
        rows, new = rows[order], np.empty_like(order)
        new[order] = np.arange(len(order))
        place_of = new[place_of]
    return rows, place_of


def find_neighbors(cell, job):
    """Write the neighbors of the places of a cell, and what these tell of their planes.

    Columns: near, rows of all places; radius, limit and usable, as `Linking` measures them. The
    limit is left out where the scale is it.
    """
    cells, _ = job.open()
    whole = job.whole()
    points, own = whole.open("points"), whole.rows(cell)
    near, n_far = nearest_rows(cells, whole, cell, min(job.growing.n_neighbors, len(whole)))
    index = _OwnNeighbors(points, near, own.start)
    linking = _linking(index, whole, job)
    radius, usable, limits = [], [], []
    for rows in _chunks(own):
        some = linking.measured(rows)
        for values, found in zip((radius, limits, usable), some, strict=True):
            values.append(found)
    written = {"near": near, "radius": np.concatenate(radius), "usable": np.concatenate(usable)}
    if linking.has_limits:
        written["limit"] = np.concatenate(limits)
    whole.columns.write(cell, **written)
    whole.columns.finish(cell, "neighbors", n_far=n_far)


def nearest_rows(cells, whole, cell, k):
    """Rows of the k nearest of all places (n, k) of each place of a cell.

    Also how many have some of them in other cells.
    """
    points, own = whole.open("points"), whole.rows(cell)
    near = np.empty((own.stop - own.start, k), np.int32)

    def load(other):
        some = np.array(points[whole.rows(other)])
        return some, np.arange(len(some))

    rows_of = {}

    def keep(rows, _, found_near, found):
        if rows_of.get("of") is not found:  # they come one after the other
            there, places = found.places
            rows_of.update(of=found, rows=whole.starts[there.astype(np.intp)] + places)
        near[rows] = rows_of["rows"][found_near]

    queries = np.array(points[own])
    if len(queries) >= max(k, COMPILE_FROM):
        bounds = _search_own(queries, near, own.start)
        n_far = visit_far(cells, load, cell, queries, k, bounds, keep)
    else:
        n_far = visit_nearest(cells, load, cell, queries, k, keep)
    return near, n_far


def find_links(cell, job):
    """Write the links of the places of a cell: rows of all places."""
    whole = job.whole()
    linking = _linking(StoredIndex(whole), whole, job)
    own = whole.rows(cell)
    links = np.empty((own.stop - own.start, linking.k), np.int32)
    limit = whole.open("limit" if linking.has_limits else "scale")
    link = linking.linker(limit, whole.open("usable"))
    for rows in _chunks(own):
        link(rows, links[rows.start - own.start : rows.stop - own.start])
    whole.columns.write(cell, links=links)
    whole.columns.finish(cell, "links")


def _search_own(points, near, start):
    """Fill the neighbors of points among themselves; returns the distances of the last ones.

    It takes half of the time of a search among any points.
    """
    search, k = SelfSearch(points), near.shape[1]
    bounds = np.empty(len(points))
    for rows in _chunks(slice(0, len(points))):
        found = Neighborhoods(search.query(rows, k), np.full(rows.stop - rows.start, k))
        own = search.order[rows]
        bounds[own] = farthest_neighbors(search.points, found, rows.start)
        near[own] = start + search.order[found.indices]
    return bounds


def _linking(index, whole, job):
    return Linking(index, whole.planes(), whole.open("floor"), rules_of(job.growing))


def _chunks(rows):
    """Slices of a slice."""
    starts = range(rows.start, rows.stop, CHUNK)
    return [slice(start, min(start + CHUNK, rows.stop)) for start in starts]


class _OwnNeighbors(StoredIndex):
    """The index of a cell's places before the neighbors of all are known."""

    def __init__(self, points, near, start):
        self.points, self._own, self._start = points, near, start
        self.n_neighbors = near.shape[1]

    def _near(self, rows, k):
        return self._own[rows.start - self._start : rows.stop - self._start, :k]
