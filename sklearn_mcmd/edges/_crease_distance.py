"""How far points are from a crease: the line in which the planes of two faces meet.

Near an edge the neighborhood of a point holds two faces. The point is given the plane that
explains it best, its own or a neighbor's, and so are its neighbors; where two of these planes
meet is the edge, known to a fraction of the spacing of the points. Whether there is an edge is
decided by the Bayesian information criterion (BIC): faces that meet in creases, or a surface
without any. The verdict is pooled over the neighbors, as an edge is a line and not a point.
"""

from dataclasses import dataclass, replace
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
SEARCHED, MEASURED, GIVEN, MET = 0.1, 0.15, 0.3, 0.9
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
    evening_steps: int = 2  # passes in which the spacing becomes the mean of those around
    smooth_steps: int = 3  # fits of a smooth surface
    huber: float = 1.5  # standard deviations beyond which points count less in such a fit
    # Radii of rounded edges, in spacings: what is rounded by less is sharp.
    radii: tuple = (1.0, 1.5, 2.0, 3.0, 4.0)


class Faces(NamedTuple):
    """The plane given to each of m points."""

    normals: np.ndarray  # (m, d)
    levels: np.ndarray  # (m,), as all below: n . x of the plane's points
    height: np.ndarray  # of the point above its plane
    scale: np.ndarray  # standard deviation of the noise
    spacing: np.ndarray  # of the points around
    flat: np.ndarray  # bool: whether the plane is that of a face, not of foliage or a cluster
    on_face: np.ndarray  # bool: whether the point lies on such a plane

    @classmethod
    def empty(cls, m, d, make=np.empty):
        """A record to be filled, of arrays that `make` makes."""
        numbers, answers = (make(m) for _ in range(4)), (make(m, bool) for _ in range(2))
        return cls(make((m, d)), *numbers, *answers)

    put, take = Planes.put, Planes.take  # type: ignore[misc]


def find_creases(index, planes, min_angle, n_jobs=None):
    """The `Creases` of the points of an index, and their distances.

    Of the planes centroids, normals and scale are known, and are changed. Those of two faces meet
    at `min_angle` degrees at least.
    """
    # Of heights, which are differences of coordinates that may be large. One point may be far.
    origin = np.array([np.median(coordinate) for coordinate in index.points.T])
    planes.centroids[:] -= origin
    with progress_part(0.0, MEASURED):
        _measure_spacing(index, planes, n_jobs)
    creases = Creases(
        index=index,
        origin=origin,
        planes=planes,
        flat=are_faces(planes),
        usable=np.ones(len(index.points), bool),
        cosine=cosine_of(min_angle),
        n_jobs=n_jobs,
    )
    faces, evidence, distance = creases.measure(index.points, index.query_own)
    return replace(creases, faces=faces, evidence=evidence), distance


def cosine_of(min_angle):
    """The largest cosine of the angle between two faces that meet."""
    return np.cos(np.radians(min_angle))


@dataclass(frozen=True)
class Creases:
    """A cloud whose creases are known, once its faces are."""

    index: NeighborIndex
    origin: np.ndarray
    planes: Planes
    flat: np.ndarray  # bool: which planes are those of faces
    usable: np.ndarray  # True for all planes
    cosine: float  # that of two faces that meet is smaller
    n_jobs: int | None
    faces: Faces | None = None  # of the points
    evidence: np.ndarray | None = None

    def distance(self, queries, around=None):
        """Distances of queries (m, d) to the nearest crease, in spacings. Where none is found it is
        between `far` and twice as much, the less, the less flat the neighborhood."""
        with progress_part(0.0, SEARCHED):
            around = _search(self.index, queries, self.n_jobs) if around is None else around
        return self.measure(queries, around.take)[2]

    def measure(self, queries, around):
        """Faces of queries, evidence for creases, and distances from these; ``around(part)`` are
        the `Neighborhoods` of a slice of them."""
        with progress_part(MEASURED, GIVEN):
            own = self.give_planes(queries, around)
        with progress_part(GIVEN, MET):
            distance, evidence = self.meet(queries, own, around)
        with progress_part(MET, 1.0):
            self.judge(own, distance, evidence, around)
        return own, evidence, distance

    def give_planes(self, queries, around):
        """Of the planes of its neighbors, the one that explains each query best."""
        faces = Faces.empty(*queries.shape, self.index.empty)

        def give(part, around):
            asked = queries[part] - self.origin
            faces.put(part, give_faces(asked, around, self.planes, self.flat, self.usable))

        _in_chunks(self.index, len(queries), around, give, self.n_jobs)
        return faces

    def meet(self, queries, own, around):
        """Distance to the nearest crease in spacings, inf if none, and its evidence: half of the
        BIC of the best two or three faces less that of the best surface without a crease, negative
        where there is an edge. `own` are the faces of the queries."""
        distance, evidence = (self.index.empty(len(queries)) for _ in range(2))
        others = own if self.faces is None else self.faces
        others = others.normals, others.levels, others.on_face
        told = CreaseLimits(), self.cosine, ExplainLimits().explained
        fill = compiled_function("edges._crease_distance_numba", "meet_faces")

        def meet(part, around):
            k, d = around.indices.shape[1], queries.shape[1]
            arrays, equations = work_arrays(max(d, 3) + 7, k)
            room = arrays[7:], arrays[:7], np.empty(d), np.empty(k, bool), equations
            given = queries[part], self.origin, around, own.take(part), others, told, room
            fill(self.index.points, *given, distance[part], evidence[part])

        _in_chunks(self.index, len(queries), around, meet, self.n_jobs)
        return distance, evidence

    def judge(self, faces, distance, evidence, around):
        """Let the neighbors say, in place, how far each point counts as from the crease: as far as
        it is where they say that an edge is the better model, and farther where not."""
        evidence = evidence if self.evidence is None else self.evidence

        fill = compiled_function("edges._crease_distance_numba", "judge_distances")
        limits = CreaseLimits().far, CERTAIN, ExplainLimits().explained

        def judge(part, around):
            room = np.empty(around.indices.shape[1])
            given = evidence, faces.take(part), limits, room, distance[part]
            fill(self.index.points, around, *given)

        _in_chunks(self.index, len(distance), around, judge, self.n_jobs)


def _in_chunks(index, n, around, work, n_jobs):
    """Call `work` with slices of n queries and their neighborhoods."""
    step = max(1, CHUNK // (index.n_neighbors * index.points.shape[1]))
    each_slice(n, step, lambda part: work(part, around(part)), n_jobs)


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
    m, even = len(index.points), index.empty(len(index.points))

    def measure(part, around):
        found = spacing_of(index, part, around, planes.scale[part])
        planes.radius[part], planes.spacing[part], planes.scale[part] = found

    def smooth(part, around):
        even[part] = evened(planes.spacing, around)

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


def evened(spacing, around):
    """The mean spacing around some points."""
    return spacing[around.indices].mean(axis=1)


def flatness(planes):
    """The noise of planes over their radius."""
    return planes.scale / np.maximum(planes.radius, np.finfo(float).tiny)


def are_faces(planes, usual=None):
    """Whether planes are those of faces: flat, or the flatter half of all, `usual` at most."""
    usual = np.median(flatness(planes)) if usual is None else usual
    return are_flat(planes, max(FaceLimits().flat, usual))


def give_faces(queries, around, planes, flat, usable):
    """Of the planes of its neighbors, the one that explains each query best: `Faces`. `usable` is
    True for all planes; an array, so that it is made once."""
    spacing = planes.spacing[around.indices].mean(axis=1)
    least = np.maximum(FaceLimits().least_noise * spacing, np.finfo(float).tiny)
    owners = explain(queries, around, planes, usable, least, likely=True)[0]
    far = np.flatnonzero(owners < 0)
    if len(far):
        # What no plane reaches is given the likeliest as if all were boundless.
        near = around.take(far)
        members = np.unique(near.indices)
        boundless = planes.take(members)
        boundless = boundless._replace(radius=np.full_like(boundless.radius, np.inf))
        near = near._replace(indices=np.searchsorted(members, near.indices).astype(np.int32))
        all_usable = usable[: len(members)]
        found = explain(queries[far], near, boundless, all_usable, least[far], likely=True)[0]
        # Points in one place have no planes.
        owners[far] = members[np.where(found < 0, near.indices[:, 0], found)]
    normals = planes.normals[owners]
    levels = np.einsum("md,md->m", planes.centroids[owners], normals)
    height = np.einsum("md,md->m", queries, normals) - levels
    scale = np.maximum(planes.scale[owners], least)
    flat = flat[owners]
    on_face = flat & (np.abs(height) <= ExplainLimits().explained * scale)
    return Faces(
        normals=normals,
        levels=levels,
        height=height,
        scale=scale,
        spacing=spacing,
        flat=flat,
        on_face=on_face,
    )
