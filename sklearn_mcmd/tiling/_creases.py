"""The creases of a cloud, cell by cell: spacings, the planes given to points, where faces meet."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from sklearn_mcmd.edges import SharpFeatureDetector
from sklearn_mcmd.edges._creases import (
    least_cosine,
    meet_faces,
    pool_evidence,
    told_distances,
)
from sklearn_mcmd.edges._faces import Faces, are_flat, give_faces, measure_spacing
from sklearn_mcmd.planes import _columns
from sklearn_mcmd.planes._indexed_cloud import distinct_rows, spatial_order
from sklearn_mcmd.planes._nearest import NearestPoints
from sklearn_mcmd.planes._record import Neighborhoods, Planes
from sklearn_mcmd.tiling._cells import Cells
from sklearn_mcmd.tiling._columns import Columns
from sklearn_mcmd.tiling._outputs import SCORED
from sklearn_mcmd.tiling._search import visit_nearest, within_reach
from sklearn_mcmd.tiling._surfaces import all_places
from sklearn_mcmd.tiling._tile import result_dtype, tile_files, write_whole

__all__ = [
    "EdgeJob",
    "face_columns",
    "find_creases",
    "find_distances",
    "find_faces",
    "find_ordered_places",
    "find_spacing",
    "kept_places",
]

# Columns of the planes: centroid, normal, scale, radius and spacing.
CENTROID, NORMAL, SCALE, RADIUS, SPACING = slice(0, 3), slice(3, 6), 6, 7, 8
# Of the planes given to points: normal, level, height, scale and spacing.
LEVEL, HEIGHT, FACE_SCALE, FACE_SPACING = 3, 4, 5, 6
N_PLANE, N_FACE = 9, 7
N_STORED = 5  # numbers of a plane in the results of the normals


class EdgeJob(NamedTuple):
    """What all sweeps over the cells of a cloud know.

    cells, kept : Path
        Folders of the `Cells` of all points, and of those that are kept.
    columns : Path
        Folder of `Columns`.
    faces : Path
        Folder of what the normal estimator has found.
    detector : SharpFeatureDetector
    dtype : str
        Precision of the coordinates.
    origin : tuple of float
        The middle of the box of the kept points.
    """

    cells: Path
    kept: Path
    columns: Path
    faces: Path
    detector: SharpFeatureDetector
    dtype: str
    origin: tuple = (0.0, 0.0, 0.0)

    def open(self):
        """The cells of the kept points, and the columns of their places."""
        return Cells(self.kept), Columns(self.columns)

    def removed(self, cell):
        """Records of the points of a cell, and which of them were removed."""
        records, columns = Cells(self.cells).read(cell), Columns(self.columns)
        if self.kept == self.cells:
            return records, np.zeros(len(records), bool)
        return records, ~columns.read(cell, "kept")


def kept_places(cells, columns):
    """What loads the kept places of a cell, and their rows; there may be none."""
    load_some = all_places(columns)

    def load(cell):
        return load_some(cell) if cells.counts[cell] else (np.empty((0, 3)), np.empty(0, np.intp))

    return load


def face_columns(fitted, dtype):
    """Normals, offsets and scales of the planes of a fitted estimator, in the dtype of `transform`:
    (n, 5)."""
    columns = np.empty((len(fitted.normals_), N_STORED), dtype)
    columns[:, :3], columns[:, 3] = fitted.normals_, fitted.plane_offset_
    columns[:, 4] = fitted.plane_scale_
    return [*"xyz", "offset", "scale"], columns


def find_ordered_places(cell, job):
    """Write the distinct points of a cell, near ones together, and the place of each point.

    Columns: points; place_of.
    """
    cells, columns = job.open()
    points = cells.read(cell)["xyz"]
    rows, place_of = distinct_rows(points)
    order = spatial_order(points[rows])
    rows, places = rows[order], np.empty(len(order), np.int32)
    places[order] = np.arange(len(order), dtype=np.int32)
    place_of = places if place_of is None else places[place_of]
    columns.write(cell, points=points[rows], first_rows=rows.astype(np.int32), place_of=place_of)
    columns.finish(cell, "places", n_places=len(rows))


def find_spacing(cell, job):
    """Write the plane of each place, and the spacing around it.

    Columns: planes; reach, the distance of the last neighbor.
    """
    cells, columns = job.open()
    points, first = columns.read(cell, "points"), columns.read(cell, "first_rows")
    stored = np.fromfile(tile_files(job.faces, cell)[0], result_dtype(N_STORED, job.dtype))
    stored, n = stored["values"][first], len(points)
    own = _columns.Columns(
        points.astype(job.dtype), np.ascontiguousarray(stored[:, :3]), None, None,
        np.ascontiguousarray(stored[:, 3]), np.ascontiguousarray(stored[:, 4]),
    ).planes(np.arange(n))  # fmt: skip
    planes, reach = np.empty((n, N_PLANE)), np.empty(n)
    planes[:, CENTROID], planes[:, NORMAL] = own.centroids - job.origin, own.normals
    centered, shifted = points - job.origin, _Made(lambda found: found.points - job.origin)

    def measure(rows, distances, near, found):
        reach[rows] = distances[:, -1]
        planes[rows, SPACING], planes[rows, RADIUS], planes[rows, SCALE] = measure_spacing(
            shifted.of(found), centered[rows], _around(near), own.scale[rows]
        )

    k = job.detector.n_neighbors
    n_far = visit_nearest(cells, kept_places(cells, columns), cell, points, k, measure)
    columns.write(cell, planes=planes, reach=reach)
    columns.finish(cell, "spacing", n_far=n_far)


def find_faces(cell, job):
    """Write the plane that is given to each place.

    Columns: faces; flat; on_face.
    """
    columns, centered, found, everything = _neighbors(cell, job)
    planes = _planes(found.after([columns.read(cell, "planes")], columns, "planes"))
    flat, usable = are_flat(planes), np.ones(len(planes.scale), bool)
    n = len(centered)
    faces, own_flat, on_face = np.empty((n, N_FACE)), np.empty(n, bool), np.empty(n, bool)

    def give(rows, _, near):
        given = give_faces(centered[rows], _around(near), planes, flat, usable)
        faces[rows, :LEVEL], own_flat[rows], on_face[rows] = (
            given.normals, given.flat, given.on_face,
        )  # fmt: skip
        for place, values in (
            (LEVEL, given.levels), (HEIGHT, given.height),
            (FACE_SCALE, given.scale), (FACE_SPACING, given.spacing),
        ):  # fmt: skip
            faces[rows, place] = values

    everything.visit(columns.read(cell, "points"), job.detector.n_neighbors, give)
    columns.write(cell, faces=faces, flat=own_flat, on_face=on_face)
    columns.finish(cell, "faces")


def find_creases(cell, job):
    """Write how far each place is from a crease, before its neighbors are asked.

    Columns: to_crease; evidence, which is not a number where there is none.
    """
    columns, centered, found, everything = _neighbors(cell, job)
    own = columns.read(cell, "faces")
    on_face = columns.read(cell, "on_face")
    around = _faces(
        found.after([own], columns, "faces"), found.after([on_face], columns, "on_face")
    )
    own = _faces(own, on_face, columns.read(cell, "flat"))
    near_points = np.vstack([centered, found.points - job.origin])
    distance, evidence = np.empty((2, len(centered)))
    cosine = least_cosine(job.detector.min_angle)

    def meet(rows, _, near):
        distance[rows], evidence[rows] = meet_faces(
            centered[rows], own.take(rows), _around(near), near_points, around, cosine
        )

    everything.visit(columns.read(cell, "points"), job.detector.n_neighbors, meet)
    columns.write(cell, to_crease=distance, evidence=evidence)
    columns.finish(cell, "creases")


def find_distances(cell, job):
    """Write the scores of all points of a cell, in the order of the inputs."""
    records, removed = job.removed(cell)
    scores = np.empty(len(records), SCORED)
    scores["row"] = records["row"]
    values = scores["values"][:, 0]
    if not removed.all():
        values[~removed] = _distances_of_kept(cell, job)
    if removed.any():
        values[removed] = _distances_of_removed(cell, job, records["xyz"][removed])
    write_whole(tile_files(job.columns, cell)[0], scores)


def _distances_of_kept(cell, job):
    columns, centered, found, everything = _neighbors(cell, job)
    distance = columns.read(cell, "to_crease")
    evidence = found.after([columns.read(cell, "evidence")], columns, "evidence")
    own = _faces(columns.read(cell, "faces"), columns.read(cell, "on_face"))
    near_points = np.vstack([centered, found.points - job.origin])

    def judge(rows, _, near):
        pooled, most = pool_evidence(_around(near), near_points, evidence)
        distance[rows] = told_distances(own.take(rows), distance[rows], pooled, most)

    everything.visit(columns.read(cell, "points"), job.detector.n_neighbors, judge)
    return distance[columns.read(cell, "place_of")]


def _distances_of_removed(cell, job, queries):
    """Distances of new points, by their neighbors among those that were kept."""
    cells, columns = job.open()
    distance, cosine = np.empty(len(queries)), least_cosine(job.detector.min_angle)

    def make(found):
        planes = _planes(found.values(columns, "planes"))
        faces = _faces(found.values(columns, "faces"), found.values(columns, "on_face"))
        flat, usable = are_flat(planes), np.ones(len(planes.scale), bool)
        return found.points - job.origin, planes, flat, usable, faces

    made = _Made(make)

    def judge(rows, _, near, found):
        if not len(near):
            return
        points, planes, flat, usable, faces = made.of(found)
        around, some = _around(near), queries[rows] - job.origin
        own = give_faces(some, around, planes, flat, usable)
        to_crease, _ = meet_faces(some, own, around, points, faces, cosine)
        pooled, most = pool_evidence(around, points, found.values(columns, "evidence"))
        distance[rows] = told_distances(own, to_crease, pooled, most)

    k = job.detector.n_neighbors
    visit_nearest(cells, kept_places(cells, columns), cell, queries, k, judge)
    return distance


def _neighbors(cell, job):
    """Columns, the places of a cell about the origin, others near them, and a search of both."""
    cells, columns = job.open()
    points, reach = columns.read(cell, "points"), columns.read(cell, "reach")
    found = within_reach(cells, all_places(columns), points, reach, skip=cell)
    everything = NearestPoints(np.vstack([points, found.points]))
    return columns, points - job.origin, found, everything


class _Made:
    """What is made of points that were found, once for each."""

    def __init__(self, make):
        self.make, self.known, self.made = make, None, None

    def of(self, found):
        if found is not self.known:
            self.known, self.made = found, self.make(found)
        return self.made


def _around(near):
    return Neighborhoods(near.astype(np.int32, copy=False), np.full(len(near), near.shape[1]))


def _planes(values):
    """Planes (n, 9) as other code takes them."""
    n, unknown = len(values), (np.empty((0, 3)), np.empty(0))
    vectors = (np.ascontiguousarray(values[:, part]) for part in (CENTROID, NORMAL))
    scale, radius, spacing = (
        np.ascontiguousarray(values[:, part]) for part in (SCALE, RADIUS, SPACING)
    )
    return Planes(*vectors, unknown[0], scale, np.ones(n), radius, spacing, unknown[1])


def _faces(values, on_face, flat=None):
    """Planes (n, 7) that were given to points, as other code takes them."""
    level, height, scale, spacing = (
        np.ascontiguousarray(values[:, part]) for part in (LEVEL, HEIGHT, FACE_SCALE, FACE_SPACING)
    )
    flat = on_face if flat is None else flat
    normals = np.ascontiguousarray(values[:, :LEVEL])
    return Faces(normals, level, height, scale, spacing, flat, on_face)
