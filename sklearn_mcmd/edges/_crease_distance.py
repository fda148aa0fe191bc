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
# Ends of steps, as shares of the time, for the display of progress: of what comes before creases,
# and there of measuring the spacing; then of giving faces and of letting them meet.
BEFORE, SPACED = 0.1, 0.4
GIVEN, MET = 0.26, 0.85
CERTAIN = -np.log(np.finfo(float).eps)  # logarithm of the inverse of the rounding of a likelihood


class FaceLimits(NamedTuple):
    """What a face is."""

    n_spacing: int = 8  # neighbors that tell the spacing, or all if fewer
    least_noise: float = 0.05  # share of the spacing: a point is not known better
    # Most noise, as a share of its radius. It is more than that of surfaces in the search for
    # outliers, 0.15: a face that passes for foliage costs edges, and `on_surfaces` tells foliage.
    flat: float = 0.2


class CreaseLimits(NamedTuple):
    """How creases are found."""

    far: float = 10.0  # largest distance of a point from a crease that counts, in spacings
    # Least share of the neighbors that are on surfaces: among leaves planes meet by chance. Half
    # costs small parts, whose own faces have too few points to be surfaces.
    on_surfaces: float = 0.25
    evening_steps: int = 3  # passes in which the spacing becomes the mean of those around
    smooth_steps: int = 3  # fits of a smooth surface
    huber: float = 1.5  # standard deviations beyond which points count less in such a fit
    # Radii of rounded edges, in spacings: what is rounded by less is sharp.
    radii: tuple = (1.0, 1.5, 2.0, 3.0, 4.0)


class MeetingLimits(NamedTuple):
    """When planes meet in a crease, and how far that explains its neighbors."""

    creases: CreaseLimits
    cosine: float  # of the angle between two faces that meet, at most
    explained: float  # standard deviations within which a plane explains a point


class Faces(NamedTuple):
    """The planes given to m points."""

    owners: np.ndarray  # int32 (m,): the points whose planes they are
    on_face: np.ndarray  # bool (m,): whether the point lies on its plane, and this is a face's


class CreaseArrays(NamedTuple):
    """What `meet_faces` works with for k neighbors: rows of one array, and an answer of each."""

    local: np.ndarray  # (d, k), coordinates of the neighbors from their mean
    rows: np.ndarray  # (7, k): heights above three planes, weights, terms of a regression
    mean: np.ndarray  # (d,), of the neighbors from the query
    differs: np.ndarray  # bool (k,), whether a neighbor lies on a face that is not joined yet
    equations: tuple  # of a quadric, as of `work_arrays`


def find_creases(index, planes, min_angle, on_surface, n_jobs=None):
    """The `Creases` of the points of an index, and the points' distances.

    Of the planes centroids, normals and scale are known; scale is changed. Those of two faces meet
    at `min_angle` degrees at least. `on_surface` (n,) is 1.0 of points on surfaces, else 0.0.
    """
    with progress_part(0.0, BEFORE):
        planes, spacing = _measured(index, planes, n_jobs)
    # A median of shares of the radius, so that it depends on no unit.
    usual = np.median(planes.scale / np.maximum(planes.radius, np.finfo(float).tiny))
    cosine = np.cos(np.radians(min_angle))
    meeting = MeetingPlanes(
        index=index,
        planes=planes,
        spacing=spacing,
        on_surface=on_surface,
        usual=usual,
        cosine=cosine,
        n_jobs=n_jobs,
    )
    with progress_part(BEFORE, 1.0):
        distances, faces, evidence = meeting.distances(index.points, index.query_own)
    return Creases(meeting, faces, evidence), distances


class Creases(NamedTuple):
    """The creases of a fitted cloud, from which the distances of other points follow."""

    meeting: "MeetingPlanes"
    faces: Faces
    evidence: np.ndarray  # float64 (n,), as of `MeetingPlanes`

    def distance(self, queries):
        """Distances of queries (m, d) to the nearest crease, in spacings. Where none is found it is
        between `far` and twice as much, the less, the more planes around turn."""
        with progress_part(0.0, BEFORE):
            around = _search(self.meeting.index, queries, self.meeting.n_jobs)
        with progress_part(BEFORE, 1.0):
            return self.meeting.distances(queries, around.take, fitted=self)[0]


@dataclass(frozen=True)
class MeetingPlanes:
    """The planes of a cloud's points, and which of them may meet in creases.

    The scale of a plane is its noise.
    """

    index: NeighborIndex
    planes: Planes
    spacing: np.ndarray  # float64 (n,), of the points
    on_surface: np.ndarray  # float64 (n,), 1 or 0
    usual: float  # noise of half of the planes over their radius, at most
    cosine: float  # that of two faces that meet is smaller
    n_jobs: int | None

    def distances(self, queries, around_of, fitted=None):
        """Distances to creases, the `Faces` of the points of the cloud, and their evidence.

        ``around_of(rows)`` are the `Neighborhoods` of some of the queries. These are the points of
        the cloud, unless their `Creases` are fitted already.

        The evidence, float64 (m,), is half of the BIC of the best two or three faces less that of
        the best surface without a crease: negative where there is an edge, NaN where nothing is
        asked.
        """
        with progress_part(0.0, GIVEN):
            given_faces, doubtful, distances = self._give_faces(queries, around_of)
        faces = given_faces if fitted is None else fitted.faces
        with progress_part(GIVEN, MET):
            off, evidence = self._meet(queries, around_of, given_faces.owners, doubtful, faces)
        if fitted is not None:
            evidence = fitted.evidence
        with progress_part(MET, 1.0):
            self._judge(around_of, evidence, off, distances)
        return distances, faces, evidence

    def _give_faces(self, queries, around_of):
        """The `Faces` of queries, whether planes around differ by the least angle where they are of
        a face and near surfaces, bool (m,), and distances as if there were no crease.

        Where the planes of neighbors differ, the one that explains the query best is given, and
        else that of the nearest neighbor.
        """
        m, planes = len(queries), self.planes
        faces = Faces(np.empty(m, np.int32), np.empty(m, bool))
        doubtful, distances = np.empty(m, bool), np.empty(m)
        usable = np.ones(len(planes.scale), bool)
        # Of two planes that differ by an angle, one differs from any third by half of it; and
        # cos(angle / 2) = sqrt((1 + cos(angle)) / 2).
        half_turn = np.sqrt(0.5 * (1.0 + self.cosine))

        def give(part):
            asked, near, turned = queries[part], around_of(part), distances[part]
            owners = near.indices[:, 0].copy()
            _compiled("count_turned")(near, planes.normals, half_turn, turned)
            rows = np.flatnonzero(turned)
            if len(rows):
                owners[rows] = give_planes(
                    asked[rows], near.take(rows), planes, usable, self.spacing
                )
            owned = planes.take(owners)
            flat = are_faces(owned, self.usual)
            height = np.abs(np.einsum("md,md->m", asked - owned.centroids, owned.normals))
            on_plane = height <= ExplainLimits().explained * owned.scale
            faces.owners[part], faces.on_face[part] = owners, flat & on_plane
            shares = np.empty(len(flat))
            _compiled("average_around")(self.on_surface, near, shares)
            doubtful[part] = flat & (shares >= CreaseLimits().on_surfaces) & (turned > 0.0)
            # Beyond all creases that are sought: nearer where more planes turn.
            turned[:] = CreaseLimits().far * (2.0 - turned)

        _each_slice(self.index, m, give, self.n_jobs)
        return faces, doubtful, distances

    def _meet(self, queries, around_of, owners, doubtful, faces):
        """Distances to where faces meet in spacings, inf if nowhere, larger off the planes; and the
        evidence. `faces` are those of the cloud, and `owners` have the queries' planes."""
        (m, d), k = queries.shape, self.index.n_neighbors
        off, evidence = np.full(m, np.inf), np.full(m, np.nan)
        limits = MeetingLimits(CreaseLimits(), self.cosine, ExplainLimits().explained)

        def meet(part):
            rows = part.start + np.flatnonzero(doubtful[part])
            if not len(rows):
                return
            off_rows, evidence_rows = off[rows], evidence[rows]
            arrays, equations = work_arrays(max(d, 3) + 7, k)
            work = CreaseArrays(
                local=arrays[7:],
                rows=arrays[:7],
                mean=np.empty(d),
                differs=np.empty(k, bool),
                equations=equations,
            )
            _compiled("meet_faces")(
                self.index.points,
                queries[rows],
                around_of(rows),
                self.planes,
                self.spacing,
                owners[rows],
                faces,
                limits,
                work,
                off_rows,
                evidence_rows,
            )
            off[rows], evidence[rows] = off_rows, evidence_rows

        _each_slice(self.index, m, meet, self.n_jobs)
        return off, evidence

    def _judge(self, around_of, evidence, off, distances):
        """Let the neighbors say, in place, how far each point counts as from the crease: as far as
        it is, which `off` says, where they say that an edge is the better model, else farther."""

        def judge(part):
            rows = part.start + np.flatnonzero(off[part] < np.inf)
            if len(rows):
                judged, sorted_evidence = off[rows], np.empty(self.index.n_neighbors)
                _compiled("judge_distances")(
                    around_of(rows), evidence, CERTAIN, sorted_evidence, judged
                )
                distances[rows] = np.minimum(distances[rows], judged)

        _each_slice(self.index, len(off), judge, self.n_jobs)


def _measured(index, planes, n_jobs):
    """The planes of an index's points with radius, and noise, which is not known better; and the
    spacing: the side of the cell that one point of a surface takes, the mean of those around."""
    points, (n, d) = index.points, index.points.shape
    last = min(FaceLimits().n_spacing, index.n_neighbors - 1)
    # Volume of the unit ball of d - 1 dimensions: the surface within reach of the `last` neighbor
    # holds as many points, so that each takes the cell of ball * near^(d - 1) / last.
    ball = np.pi ** (0.5 * (d - 1)) / gamma(0.5 * (d - 1) + 1.0)
    spacing, radius = np.empty(n), np.empty(n)

    def measure(part):
        ends = points[index.query_own(part).indices[:, [last, -1]]] - points[part, None]
        near, radius[part] = np.sqrt(np.einsum("mkd,mkd->km", ends, ends))
        spacing[part] = near * (ball / last) ** (1.0 / (d - 1))
        least = FaceLimits().least_noise * spacing[part]
        np.maximum(planes.scale[part], least, out=planes.scale[part])

    with progress_part(0.0, SPACED):
        _each_slice(index, n, measure, n_jobs)
    with progress_part(SPACED, 1.0):
        for _ in range(CreaseLimits().evening_steps):
            spacing = _evened(index, spacing, n_jobs)
    return planes._replace(radius=radius), spacing


def _evened(index, spacing, n_jobs):
    """The mean spacing around points."""
    means = np.empty_like(spacing)

    def even(part):
        _compiled("average_around")(spacing, index.query_own(part), means[part])

    _each_slice(index, len(means), even, n_jobs)
    return means


def _each_slice(index, m, work, n_jobs):
    """Call ``work(part)`` with slices of m queries, each as large as the arrays of a task allow."""
    each_slice(m, max(1, CHUNK // (index.n_neighbors * index.points.shape[1])), work, n_jobs)


def _search(index, queries, n_jobs):
    """The neighborhoods of queries: one search for all that follows."""
    m, k = len(queries), index.n_neighbors
    indices = np.empty((m, k), dtype=np.int32)

    def search(rows):
        indices[rows] = index.query(queries[rows]).indices

    each_chunk(queries, index.chunk, search, n_jobs)
    return Neighborhoods(indices, np.full(m, k))


def are_faces(planes, usual):
    """Whether planes are those of faces: flat, or the flatter half of all, `usual` at most."""
    return are_flat(planes, max(FaceLimits().flat, usual))


def give_planes(queries, around, planes, usable, spacing):
    """Of the planes of its neighbors, the one that explains each query best: their rows. `usable`
    is True for all planes; an array, so that it is made once."""
    nearest = around.indices[:, 0]
    least = np.maximum(FaceLimits().least_noise * spacing[nearest], np.finfo(float).tiny)
    owners = explain(queries, around, planes, usable, least, likely=True)[0]
    return np.where(owners < 0, nearest, owners)  # what no plane reaches has the nearest one's


def _compiled(name):
    return compiled_function("edges._crease_distance_numba", name)
