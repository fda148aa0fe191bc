"""The surfaces of a cloud, cell by cell: places, their planes, links, and what surfaces explain."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from sklearn_mcmd.outliers import MCMDOutlierDetector
from sklearn_mcmd.outliers._cloud import JudgedCloud, both_spacings, least_of
from sklearn_mcmd.outliers._company import CompanyLimits
from sklearn_mcmd.outliers._surfaces import (
    SurfaceLimits,
    distances_to_surfaces,
    link_limits,
    own_distances,
    usable_planes,
)
from sklearn_mcmd.planes._certificate import SLACK, to_border
from sklearn_mcmd.planes._chunks import each_slice
from sklearn_mcmd.planes._indexed_cloud import COMPILE_FROM, distinct_rows
from sklearn_mcmd.planes._linking import connected, farthest_neighbors, link_planes
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.planes._record import Neighborhoods, Planes
from sklearn_mcmd.planes._self_search import SelfSearch
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._constants import Constants
from sklearn_mcmd.tiling._joining import parts_of_cell
from sklearn_mcmd.tiling._search import around_box, as_near_as, within_reach
from sklearn_mcmd.tiling._tile import HALO, SMALL, _usual_reach

__all__ = ["Job", "all_places", "find_explained", "find_links", "find_places", "find_planes"]

LIMITS, COMPANY = SurfaceLimits(), CompanyLimits()
CHUNK = 4096  # places that are linked at once
# Columns of the planes: centroid, normal, scale and radius.
CENTROID, NORMAL, SCALE, RADIUS = slice(0, 3), slice(3, 6), 6, 7


class Job(NamedTuple):
    """What all sweeps over the cells of a cloud know.

    cells, columns : Path
        Folders of `Cells` and `Columns`.
    detector : MCMDOutlierDetector
    constants : Constants
    n_points, n_places : int
        Of the whole cloud.
    n_explained : int
        Places that a surface explains.
    largest : float
        Measurements of the largest group of the rest.
    """

    cells: Path
    columns: Path
    detector: MCMDOutlierDetector
    constants: Constants
    n_points: int = 0
    n_places: int = 0
    n_explained: int = 0
    largest: float = 0.0

    def open(self):
        """The cells, and the columns of their places."""
        return Cells(self.cells), Columns(self.columns)

    @property
    def paper(self):
        """Whether each point is judged by its own plane alone."""
        return self.detector.strictness is None

    @property
    def least(self):
        """Places that a surface has at least, and measurements of a group that is a thing."""
        return least_of(self.detector.n_neighbors, self.n_places, self.n_points)

    def floor(self, points):
        """Rounding error of points (m, 3)."""
        return 8 * np.finfo(self.constants.dtype).eps * np.abs(points).max(axis=1)


def all_places(columns):
    """The points of a cell, and their rows."""

    def load(cell):
        points = columns.read(cell, "points")
        return points, np.arange(len(points))

    return load


def find_places(cell, job):
    """Write the distinct points of a cell, how many copies each has, and the place of each point.

    Columns: points; counts; place_of, empty where there are no copies.
    """
    cells, columns = job.open()
    points = cells.read(cell)["xyz"]
    rows, place_of = distinct_rows(points)
    counts = np.ones(len(rows), np.int32)
    if place_of is not None:
        counts = np.bincount(place_of).astype(np.int32)
    place_of = np.empty(0, np.int32) if place_of is None else place_of.astype(np.int32)
    columns.write(cell, points=points[rows], counts=counts, place_of=place_of)
    columns.finish(cell, "places", n_places=len(rows))


def find_planes(cell, job):
    """Write the plane of each place, by its neighborhood in the whole cloud.

    Columns: planes, and what `_evaluate` returns besides.
    """
    cells, columns = job.open()
    load = all_places(columns)
    points, counts = columns.read(cell, "points"), columns.read(cell, "counts")
    k = job.detector.n_neighbors
    halo, *box = around_box(
        cells, load, cell, _usual_reach(points, k, None), max(int(HALO * len(points)), SMALL)
    )
    found = _evaluate(job, columns, points, counts, halo)
    radius = found["planes"][:, RADIUS]
    far = np.flatnonzero(~(SLACK * radius < to_border(points, *box)))
    waiting = [far]
    while waiting and len(far):
        some = waiting.pop()
        needed = as_near_as(cells, load, points[some], k, radius[some])
        if len(needed.points) > max(len(points), SMALL) and len(some) > 1:
            waiting += np.array_split(some, 2)
            continue
        for name, values in _evaluate(job, columns, points[some], counts[some], needed).items():
            found[name][some] = values
    columns.write(cell, **found)
    n_far = int(counts[far].sum())
    columns.finish(cell, "planes", n_proved=int(counts.sum()) - n_far)


def find_links(cell, job):
    """Write the connected parts of a cell's surfaces.

    Columns: surface_labels, surface_sizes and surface_links, which are `Parts`.
    """
    cells, columns = job.open()
    points, usable = columns.read(cell, "points"), columns.read(cell, "usable")
    farthest = columns.read(cell, "farthest")
    found = within_reach(cells, all_places(columns), points[usable], farthest[usable], skip=cell)
    n, linked, leaving = len(points), _unlinked(points, job), [np.empty((0, 2), np.int32)]
    if usable.any():  # then there are as many neighbors
        width = linked.shape[1]
        index = _Searched(np.vstack([points, found.points]))
        order = index.order
        planes = _record(found.after([columns.read(cell, "planes")], columns, "planes"), order)
        usable_there = found.after([usable], columns, "usable")[order]
        farthest = found.after([farthest], columns, "farthest")[order]
        links = link_planes(index, width, planes, link_limits(LIMITS), usable_there, farthest)
        del planes
        for first in range(0, len(links), CHUNK):
            part, rows = links[first : first + CHUNK], order[first : first + CHUNK]
            part, rows = part[rows < n], rows[rows < n]
            to = np.where(part < 0, rows[:, None], order[part])
            i, j = np.nonzero(to >= n)
            leaving.append(np.stack([rows[i], to[i, j] - n], axis=1))
            linked[rows] = np.where(to >= n, rows[:, None], to)
    labels = np.where(usable, connected(linked)[0], -1)
    rows, others = np.vstack(leaving).T
    there, rows_there = found.places
    parts = parts_of_cell(labels, np.ones(n), rows, there[others], rows_there[others])
    columns.write(cell, **{f"surface_{name}": v for name, v in parts._asdict().items()})
    columns.finish(cell, "links")


def find_explained(cell, job):
    """Write how far each place is from the surfaces.

    Columns: off, distances in standard deviations; explained; owner_scale, the standard deviation
    of the plane that explains the place.
    """
    cells, columns = job.open()
    points, distances = columns.read(cell, "points"), columns.read(cell, "distances")
    on_surface = _on_surface(columns, cell, job.least[0])
    planes = columns.read(cell, "planes")
    off = np.flatnonzero(~on_surface)
    queries, reach = points[off], planes[off, RADIUS]
    found = within_reach(cells, all_places(columns), queries, reach, skip=cell)
    around = _measured(found.after([planes], columns, "planes"), job.detector.noise_scale)
    usable = [on_surface]
    for other, rows in found.parts:
        usable.append(_on_surface(columns, other, job.least[0])[rows])
    usable, owner_scale = np.concatenate(usable), around.scale[: len(points)].copy()
    floor = job.floor(queries)

    def explain(rows, _, near):
        near = Neighborhoods(near.astype(np.int32), np.full(len(near), near.shape[1]))
        owners, distances[off[rows]] = distances_to_surfaces(
            queries[rows], near.take, around, usable, floor[rows], len(near.sizes)
        )
        owner_scale[off[rows]] = np.where(owners < 0, owner_scale[off[rows]], around.scale[owners])

    everything = NearestPoints(np.vstack([points, found.points]))
    everything.visit(queries, job.detector.n_neighbors, explain)
    explained = distances <= LIMITS.explained
    columns.write(cell, off=distances, explained=explained, owner_scale=owner_scale)
    columns.finish(cell, "explained", n_explained=int(explained.sum()))


def fit_planes(job, points):
    """The detector's model of some points, and the row of each of its points."""
    detector = clone(job.detector)
    detector._step_of_cloud = job.constants.step
    detector._fit_planes(points.astype(job.constants.dtype, copy=False))
    return detector._model


def _evaluate(job, columns, points, counts, others):
    """What is found of the first points (n, 3), by their neighborhoods among them and others.

    planes : ndarray of shape (n, 8)
    distances : ndarray of shape (n,)
        From the own plane in standard deviations, or the paper's, if the detector is the paper's.
    usable : ndarray of bool of shape (n,)
        Whether it may be part of a surface.
    spacing, other_spacing : ndarray of shape (n,)
        To measurements, and to those at other places.
    farthest : ndarray of shape (n,)
        Distance of the last neighbor to which the place may be linked.
    """
    n, detector = len(points), job.detector
    points = np.vstack([points, others.points])
    counts = others.after([counts], columns, "counts")
    points, counts = _with_others(points, counts, columns, detector.n_neighbors, n)
    model = fit_planes(job, points)
    index, counts = model.index, counts[model.index.rows]
    cloud = JudgedCloud(
        model, strictness=detector.strictness, noise_scale=detector.noise_scale, n_jobs=1
    )
    width = min(LIMITS.n_links, index.n_neighbors)
    found = {
        name: np.empty((n, 8) if name == "planes" else n)
        for name in ("planes", "distances", "spacing", "other_spacing", "farthest")
    }

    def task(rows):
        around = index.query_own(rows, keep=False)
        mine = np.flatnonzero(index.rows[rows] < n)
        if not len(mine):
            return
        part, near = index.points[rows][mine], around.take(mine)
        places = index.rows[rows][mine]
        planes, distances = model.evaluate_neighborhoods(part, near)
        for where, values in (
            (CENTROID, planes.centroids), (NORMAL, planes.normals),
            (SCALE, planes.scale), (RADIUS, planes.radius),
        ):  # fmt: skip
            found["planes"][places, where] = values
        if cloud.own_planes_only:
            found["distances"][places] = cloud.paper_scores(planes, distances)
        else:
            measured = cloud.measured(planes)
            found["distances"][places] = own_distances(part, measured, job.floor(part))
        found["spacing"][places], found["other_spacing"][places] = both_spacings(
            index.points, counts, part, near.indices, COMPANY.n_near
        )
        first = Neighborhoods(
            np.ascontiguousarray(around.indices[:, :width]), np.full(len(around.sizes), width)
        )
        found["farthest"][places] = farthest_neighbors(index.points, first, rows.start)[mine]

    each_slice(len(index.points), model.chunk(), task, 1)
    found["usable"] = usable_planes(_record(found["planes"]), found["distances"], LIMITS)
    return found


def _with_others(points, counts, columns, k, n):
    """Distinct points with others of the cloud, so that compiled code does the work.

    Small clouds are computed by other code, whose results differ by rounding. More points of the
    cloud do not change what a point's neighborhood is. The first n stay the first.
    """
    n_least, cell = max(COMPILE_FROM, k + 1), 0
    while True:
        rows, _ = distinct_rows(points)
        points, counts = points[rows], counts[rows]
        if len(points) >= n_least:
            return points, counts
        points = np.vstack([points, columns.read(cell, "points")])
        counts = np.concatenate([counts, columns.read(cell, "counts")])
        cell += 1


def _on_surface(columns, cell, least):
    labels = columns.read(cell, "surface_labels")
    whole = np.append(columns.read(cell, "surface_whole"), 0)  # the last is that of no part
    return (whole >= least)[labels] & (labels >= 0)


def _unlinked(points, job):
    """Each point linked to itself: int32 (n, width)."""
    width = min(LIMITS.n_links, job.detector.n_neighbors)
    return np.repeat(np.arange(len(points), dtype=np.int32)[:, None], width, axis=1)


def _record(planes, order=slice(None)):
    """Planes (n, 8) as other code takes them."""
    unknown = np.empty((0, 3)), np.empty(0)
    vectors = (np.ascontiguousarray(planes[order, part]) for part in (CENTROID, NORMAL))
    scale, radius = (np.ascontiguousarray(planes[order, part]) for part in (SCALE, RADIUS))
    return Planes(*vectors, unknown[0], scale, unknown[1], radius, unknown[1], unknown[1])


def _measured(planes, noise_scale):
    planes = _record(planes)
    if noise_scale is None:
        return planes
    return planes._replace(scale=np.full(len(planes.scale), float(noise_scale)))


class _Searched:
    """Points in spatial order that know their neighbors, as `link_planes` asks for them.

    A `NeighborIndex` of few points would find equally distant neighbors in another order.
    """

    chunk = CHUNK

    def __init__(self, points):
        self._search = SelfSearch(points)
        self.order, self.points = self._search.order, self._search.points

    def query_own(self, rows, k):
        found = self._search.query(rows, k)
        return Neighborhoods(found, np.full(len(found), k))
