"""How far points are from a crease: the line in which the planes of two faces meet.

Near an edge the neighborhood of a point holds two faces. The point is given the plane that
explains it best, its own or a neighbor's, and so are its neighbors; where two of these planes
meet is the edge, known to a fraction of the spacing of the points. Whether there is an edge is
decided by the Bayesian information criterion (BIC): faces that meet in creases, or a surface
without any. The verdict is pooled over the neighbors, as an edge is a line and not a point. Where
the planes of all neighbors are alike, nothing is asked.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import gamma

from sklearn_mcmd.planes._around import are_flat
from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._quadrics import work_arrays
from sklearn_mcmd.planes._record import Neighborhoods, Planes
from sklearn_mcmd.runtime._chunks import each_chunk, each_slice
from sklearn_mcmd.runtime._compiling import compiled_function
from sklearn_mcmd.runtime._progress import progress_part

CHUNK = 500_000  # entries of the largest array a task holds
# Ends of the steps, as shares of the time, for the display of progress.
SEARCHED, MEASURED, GIVEN, MET = 0.1, 0.25, 0.5, 0.9
CERTAIN = -np.log(np.finfo(float).eps)  # logarithm of the inverse of the rounding of a likelihood


class FaceLimits(NamedTuple):
    """What a face is."""

    n_spacing: int = 8  # neighbors that tell the spacing, or all if fewer
    least_noise: float = 0.05  # share of the spacing: a point is not known better
    # Most noise, as a share of its radius. It is more than that of surfaces in the search for
    # outliers, 0.15: a face that passes for foliage costs edges, but little foliage is left in a
    # cleaned cloud.
    flat: float = 0.2


class CreaseLimits(NamedTuple):
    """How creases are found."""

    far: float = 10.0  # largest distance of a point from a crease that counts, in spacings
    evening_steps: int = 3  # passes in which the spacing becomes the mean of those around
    smooth_steps: int = 3  # fits of a smooth surface
    huber: float = 1.5  # standard deviations beyond which points count less in such a fit
    # Radii of rounded edges, in spacings: what is rounded by less is sharp.
    radii: tuple = (1.0, 1.5, 2.0, 3.0, 4.0)


class Faces(NamedTuple):
    """The planes given to m points."""

    owners: np.ndarray  # int32 (m,): the points whose planes they are
    on_face: np.ndarray  # bool (m,): whether the point lies on its plane, and this is a face's
    doubtful: np.ndarray  # bool (m,): whether planes around differ by the least angle


def find_creases(index, planes, min_angle, n_jobs=None):
    """The `Creases` of the points of an index, and their distances.

    Of the planes centroids, normals and scale are known; scale is changed. Those of two faces meet
    at `min_angle` degrees at least.
    """
    with progress_part(0.0, MEASURED):
        _measure_spacing(index, planes, n_jobs)
    n = len(index.points)
    faces = Faces(np.empty(n, np.int32), *(np.empty(n, bool) for _ in range(2)))
    creases = Creases(
        index=index,
        planes=planes,
        flat=are_faces(planes),
        usable=np.ones(n, bool),
        cosine=cosine_of(min_angle),
        n_jobs=n_jobs,
        faces=faces,
        evidence=np.empty(n),
    )
    return creases, creases.measure(index.points, index.query_own, faces, creases.evidence)


def cosine_of(min_angle):
    """The largest cosine of the angle between two faces that meet."""
    return np.cos(np.radians(min_angle))


@dataclass(frozen=True)
class Creases:
    """A cloud whose creases are known."""

    index: NeighborIndex
    planes: Planes
    flat: np.ndarray  # bool: which planes are those of faces
    usable: np.ndarray  # True for all planes
    cosine: float  # that of two faces that meet is smaller
    n_jobs: int | None
    faces: Faces  # of the points
    evidence: np.ndarray  # for a surface without a crease; NaN where nothing is asked

    def distance(self, queries, around=None):
        """Distances of queries (m, d) to the nearest crease, in spacings. Where none is found it is
        between `far` and twice as much, the less, the more planes around turn."""
        with progress_part(0.0, SEARCHED):
            around = _search(self.index, queries, self.n_jobs) if around is None else around
        m = len(queries)
        faces = Faces(np.empty(m, np.int32), np.empty(m, bool), np.empty(m, bool))
        return self.measure(queries, around.take, faces, np.empty(m))

    def measure(self, queries, around, faces, evidence):
        """Distances of queries from creases; fills their faces and evidence. ``around(part)`` are
        the `Neighborhoods` of a slice of them."""
        with progress_part(MEASURED, GIVEN):
            distance = self.give_planes(queries, around, faces)
        with progress_part(GIVEN, MET):
            off = self.meet(queries, around, faces, evidence)
        with progress_part(MET, 1.0):
            self.judge(around, off, distance)
        return distance

    def give_planes(self, queries, around, faces):
        """Fill the faces of queries, and return their distances as if there were no crease.

        Where the planes of neighbors differ, the one that explains the query best is given, and
        else that of the nearest neighbor.
        """
        distance, planes = np.empty(len(queries)), self.planes
        usable, far = self.usable, CreaseLimits().far
        # Of two planes that differ by an angle, one differs from any third by half of it.
        half_turn = np.sqrt(0.5 * (1.0 + self.cosine))
        count = compiled_function("edges._crease_distance_numba", "count_turned")

        def give(part, around):
            asked, owners, turned = queries[part], around.indices[:, 0].copy(), distance[part]
            count(around, planes.normals, half_turn, turned)
            rows = np.flatnonzero(turned)
            if len(rows):
                owners[rows] = give_planes(asked[rows], around.take(rows), planes, usable)
            flat, gaps = self.flat[owners], asked - planes.centroids[owners]
            height = np.abs(np.einsum("md,md->m", gaps, planes.normals[owners]))
            near = height <= ExplainLimits().explained * planes.scale[owners]
            faces.owners[part], faces.on_face[part] = owners, flat & near
            faces.doubtful[part] = flat & (turned > 0.0)
            distance[part] = far * (2.0 - turned)

        _in_chunks(self.index, len(queries), around, give, self.n_jobs)
        return distance

    def meet(self, queries, around, faces, evidence):
        """Distances to the nearest crease in spacings, inf if none, larger off the planes; and fill
        the evidence: half of the BIC of the best two or three faces less that of the best surface
        without a crease, negative where there is an edge."""
        (m, d), k = queries.shape, self.index.n_neighbors
        distance, planes = np.empty(m), self.planes
        told = CreaseLimits(), self.cosine, ExplainLimits().explained
        fill = compiled_function("edges._crease_distance_numba", "meet_faces")

        def meet(rows, around):
            found = np.full(len(rows), np.inf), np.full(len(rows), np.nan)
            arrays, equations = work_arrays(max(d, 3) + 7, k)
            room = arrays[7:], arrays[:7], np.empty(d), np.empty(k, bool), equations
            given = queries[rows], around, planes, faces.owners[rows]
            fill(self.index.points, *given, self.faces, told, room, *found)
            distance[rows], evidence[rows] = found

        distance[:], evidence[:] = np.inf, np.nan
        doubtful = np.flatnonzero(faces.doubtful)
        _in_chunks(self.index, m, around, meet, self.n_jobs, doubtful)
        return distance

    def judge(self, around, off, distance):
        """Let the neighbors say, in place, how far each point counts as from the crease: as far as
        it is, which `off` says, where they say that an edge is the better model, else farther."""
        fill = compiled_function("edges._crease_distance_numba", "judge_distances")

        def judge(rows, around):
            found, room = off[rows], np.empty(around.indices.shape[1])
            fill(around, self.evidence, CERTAIN, room, found)
            distance[rows] = np.minimum(distance[rows], found)

        n, near = len(distance), np.flatnonzero(off < np.inf)
        _in_chunks(self.index, n, around, judge, self.n_jobs, near)


def _in_chunks(index, n, around, work, n_jobs, rows=None):
    """Call `work` with slices of n queries, or some of the rows that are wanted, and with their
    neighborhoods."""
    step = max(1, CHUNK // (index.n_neighbors * index.points.shape[1]))

    def task(part):
        part = part if rows is None else rows[part]
        work(part, around(part))

    each_slice(n if rows is None else len(rows), step, task, n_jobs)


def _search(index, queries, n_jobs):
    """The neighborhoods of queries: one search for all that follows."""
    m, k = len(queries), index.n_neighbors
    indices = np.empty((m, k), dtype=np.int32)

    def search(rows):
        indices[rows] = index.query(queries[rows]).indices

    each_chunk(queries, index.chunk, search, n_jobs)
    return Neighborhoods(indices, np.full(m, k))


def _measure_spacing(index, planes, n_jobs):
    """Fill radius, spacing (the side of the cell that one point of a surface takes), and noise of
    the planes, which is not known better."""
    m, even = len(index.points), np.empty(len(index.points))

    def measure(part, around):
        found = spacing_of(index, part, around, planes.scale[part])
        planes.radius[part], planes.spacing[part], planes.scale[part] = found

    def smooth(part, around):
        average_around(planes.spacing, around, even[part])

    works = [measure, *[smooth] * CreaseLimits().evening_steps]
    for step, work in enumerate(works):
        with progress_part(step / len(works), (step + 1) / len(works)):
            _in_chunks(index, m, index.query_own, work, n_jobs)
        if step:
            planes.spacing[:] = even


def spacing_of(index, part, around, scale):
    """Radius, spacing and noise of the planes of a slice of an index's points."""
    n, d = min(FaceLimits().n_spacing, index.n_neighbors - 1), index.points.shape[1]
    ball = np.pi ** (0.5 * (d - 1)) / gamma(0.5 * (d - 1) + 1.0)
    ends = index.points[around.indices[:, [n, -1]]] - index.points[part, None]
    near, radius = np.sqrt(np.einsum("mkd,mkd->km", ends, ends))
    spacing = near * (ball / n) ** (1.0 / (d - 1))
    return radius, spacing, np.maximum(scale, FaceLimits().least_noise * spacing)


def average_around(spacing, around, out):
    """Fill the mean spacing around some points."""
    compiled_function("edges._crease_distance_numba", "average_around")(spacing, around, out)


def flatness(planes):
    """The noise of planes over their radius."""
    return planes.scale / np.maximum(planes.radius, np.finfo(float).tiny)


def are_faces(planes, usual=None):
    """Whether planes are those of faces: flat, or the flatter half of all, `usual` at most."""
    usual = np.median(flatness(planes)) if usual is None else usual
    return are_flat(planes, max(FaceLimits().flat, usual))


def give_planes(queries, around, planes, usable):
    """Of the planes of its neighbors, the one that explains each query best: their rows. `usable`
    is True for all planes; an array, so that it is made once."""
    nearest = around.indices[:, 0]
    least = np.maximum(FaceLimits().least_noise * planes.spacing[nearest], np.finfo(float).tiny)
    owners = explain(queries, around, planes, usable, least, likely=True)[0]
    return np.where(owners < 0, nearest, owners)  # what no plane reaches has the nearest one's
