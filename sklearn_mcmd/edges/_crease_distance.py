"""How far points are from a crease: the line in which the planes of two faces meet.

Near an edge the neighborhood of a point holds two faces. The point is given the plane that
explains it best, its own or a neighbor's, and so are its neighbors; where two of these planes
meet is the edge, known to a fraction of the spacing of the points. Whether there is an edge is
decided by the Bayesian information criterion (BIC): faces that meet in creases, or a surface
without any. The verdict is pooled over the neighbors, as an edge is a line and not a point. Where
the planes of all neighbors are alike, nothing is asked.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate, pairwise
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
# Ends of what comes before creases, as shares of the time, for the display of progress.
SEARCHED = MEASURED = 0.1
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


class Step(NamedTuple):
    """What finds columns of points, by those that the steps before have found.

    ``find(creases, part, queries, around, own)`` fills a slice of the columns `own` of queries;
    ``around(rows)`` are the `Neighborhoods` of a slice or of some of them.
    """

    find: Callable
    share: int  # of the time, beside those of the other steps
    fills: dict  # columns, and their dtypes
    ends: tuple = ()  # columns of which no later step asks


def spacing_steps():
    """The steps, by name, that find what is to be known of planes; the spacing is evened out."""
    numbers = "spacing", "face_radius", "face_noise", "face_kept"
    found = dict.fromkeys(numbers, float) | {"usable": bool}
    steps = {"spacing": Step(_measure, 2, found, ("scale",))}
    for before, name in pairwise(_spacings()):
        even = partial(_even, before=before, name=name)
        steps[name] = Step(even, 1, {name: float}, (before,))
    return steps


def crease_steps():
    """The steps, by name, that find creases then; crease becomes the distance."""
    faces = {"owners": np.int32, "on_face": bool, "doubtful": bool}
    return {
        "faces": Step(_give_faces, 9, {"crease": float, **faces}),
        "creases": Step(_meet, 20, {"off": float, "evidence": float}),
        "edges": Step(_judge, 5, {}, ("off",)),
    }


def find_creases(index, planes, min_angle, n_jobs=None):
    """The `Creases` of the points of an index, and their distances.

    Of the planes centroids, normals and scale are known; scale is changed. Those of two faces meet
    at `min_angle` degrees at least.
    """
    known = {name: getattr(planes, name) for name in ("centroids", "normals", "scale")}
    known |= {"face_noise": planes.scale, "face_kept": planes.kept}  # which are filled
    creases = Creases(index, known, cosine_of(min_angle), n_jobs)
    with progress_part(0.0, MEASURED):
        creases.run(spacing_steps(), index.points, index.query_own, known)
    creases = replace(creases, usual=np.median(flatness(known)))
    with progress_part(MEASURED, 1.0):
        creases.run(crease_steps(), index.points, index.query_own, known)
    return creases, known.pop("crease")


def cosine_of(min_angle):
    """The largest cosine of the angle between two faces that meet."""
    return np.cos(np.radians(min_angle))


@dataclass(frozen=True)
class Creases:
    """A cloud whose creases become known, step by step."""

    index: NeighborIndex
    known: dict  # columns of all points, as far as steps have found them
    cosine: float  # that of two faces that meet is smaller
    n_jobs: int | None
    usual: float | None = None  # flatness of all planes, once they are measured

    @property
    def planes(self):
        """The planes, with no values of fields that creases do not ask for."""
        known = self.known
        return Planes.empty(0, self.index.points.shape[1])._replace(
            centroids=known["centroids"],
            normals=known["normals"],
            scale=known["face_noise"],
            kept=known["face_kept"],
            radius=known["face_radius"],
            spacing=known[_spacings()[-1]],
        )

    @property
    def faces(self):
        return Faces(*(self.known[name] for name in Faces._fields))

    def distance(self, queries, around=None):
        """Distances of queries (m, d) to the nearest crease, in spacings. Where none is found it is
        between `far` and twice as much, the less, the more planes around turn."""
        with progress_part(0.0, SEARCHED):
            around = _search(self.index, queries, self.n_jobs) if around is None else around
        own = {}
        with progress_part(SEARCHED, 1.0):
            self.run(crease_steps(), queries, around.take, own)
        return own["crease"]

    def run(self, steps, queries, around, own):
        """Take one step after the other; columns of which nobody asks any more are left out."""
        ends = list(accumulate((step.share for step in steps.values()), initial=0))
        for step, (low, high) in zip(steps.values(), pairwise(ends), strict=True):
            with progress_part(low / ends[-1], high / ends[-1]):
                self.fill(step, queries, around, own)
            for name in step.ends:
                own.pop(name, None)

    def fill(self, step, queries, around, own):
        """Fill the columns of a step, which may be there: those `own` of queries."""
        (m, d), k = queries.shape, self.index.n_neighbors
        own.update({n: np.empty(m, kind) for n, kind in step.fills.items() if n not in own})

        def task(part):
            step.find(self, part, queries, around, own)

        each_slice(m, max(1, CHUNK // (k * d)), task, self.n_jobs)


def _measure(creases, part, queries, around, own):
    """Find radius, spacing (the side of the cell that one point of a surface takes), and noise of
    planes, which is not known better."""
    points, around = creases.index.points, around(part)
    n, d = min(FaceLimits().n_spacing, around.indices.shape[1] - 1), points.shape[1]
    ball = np.pi ** (0.5 * (d - 1)) / gamma(0.5 * (d - 1) + 1.0)
    ends = points[around.indices[:, [n, -1]]] - queries[part, None]
    near, own["face_radius"][part] = np.sqrt(np.einsum("mkd,mkd->km", ends, ends))
    spacing = near * (ball / n) ** (1.0 / (d - 1))
    own["face_noise"][part] = np.maximum(own["scale"][part], FaceLimits().least_noise * spacing)
    own["spacing"][part], own["face_kept"][part], own["usable"][part] = spacing, 1.0, True


def _even(creases, part, queries, around, own, before, name):
    """Find the mean spacing around points."""
    _compiled("average_around")(creases.known[before], around(part), own[name][part])


def _give_faces(creases, part, queries, around, own):
    """Find the faces of queries, and their distances as if there were no crease.

    Where the planes of neighbors differ, the one that explains the query best is given, and else
    that of the nearest neighbor.
    """
    asked, near, planes, turned = queries[part], around(part), creases.planes, own["crease"][part]
    # Of two planes that differ by an angle, one differs from any third by half of it.
    half_turn, owners = np.sqrt(0.5 * (1.0 + creases.cosine)), near.indices[:, 0].copy()
    _compiled("count_turned")(near, planes.normals, half_turn, turned)
    rows = np.flatnonzero(turned)
    if len(rows):
        usable = creases.known["usable"]
        owners[rows] = give_planes(asked[rows], near.take(rows), planes, usable)
    given = planes.take(owners)
    flat = are_faces(given, creases.usual)
    height = np.abs(np.einsum("md,md->m", asked - given.centroids, given.normals))
    on_plane = height <= ExplainLimits().explained * given.scale
    own["owners"][part], own["on_face"][part] = owners, flat & on_plane
    own["doubtful"][part] = flat & (turned > 0.0)
    own["crease"][part] = CreaseLimits().far * (2.0 - turned)


def _meet(creases, part, queries, around, own):
    """Find distances to where faces meet in spacings, inf if nowhere, larger off the planes; and
    the evidence: half of the BIC of the best two or three faces less that of the best surface
    without a crease, negative where there is an edge, NaN where nothing is asked."""
    index, (k, d) = creases.index, (creases.index.n_neighbors, queries.shape[1])
    off, evidence = own["off"][part], own["evidence"][part]
    off[:], evidence[:] = np.inf, np.nan
    some = np.flatnonzero(own["doubtful"][part])
    if not len(some):
        return
    rows, told = part.start + some, (CreaseLimits(), creases.cosine, ExplainLimits().explained)
    found = off[some], evidence[some]
    arrays, equations = work_arrays(max(d, 3) + 7, k)
    room = arrays[7:], arrays[:7], np.empty(d), np.empty(k, bool), equations
    given = queries[rows], around(rows), creases.planes, own["owners"][rows]
    _compiled("meet_faces")(index.points, *given, creases.faces, told, room, *found)
    off[some], evidence[some] = found


def _judge(creases, part, queries, around, own):
    """Let the neighbors say, in place, how far each point counts as from the crease: as far as it
    is, which `off` says, where they say that an edge is the better model, else farther."""
    rows = part.start + np.flatnonzero(own["off"][part] < np.inf)
    if len(rows):
        found, room = own["off"][rows], np.empty(creases.index.n_neighbors)
        _compiled("judge_distances")(around(rows), creases.known["evidence"], CERTAIN, room, found)
        own["crease"][rows] = np.minimum(own["crease"][rows], found)


def _search(index, queries, n_jobs):
    """The neighborhoods of queries: one search for all that follows."""
    m, k = len(queries), index.n_neighbors
    indices = np.empty((m, k), dtype=np.int32)

    def search(rows):
        indices[rows] = index.query(queries[rows]).indices

    each_chunk(queries, index.chunk, search, n_jobs)
    return Neighborhoods(indices, np.full(m, k))


def _spacings():
    """The columns of the spacing: as it is measured, and evened out step by step."""
    return "spacing", *(f"even{n}" for n in range(CreaseLimits().evening_steps))


def flatness(known):
    """The noise of planes over their radius, by columns that are known."""
    return known["face_noise"] / np.maximum(known["face_radius"], np.finfo(float).tiny)


def are_faces(planes, usual):
    """Whether planes are those of faces: flat, or the flatter half of all, `usual` at most."""
    return are_flat(planes, max(FaceLimits().flat, usual))


def give_planes(queries, around, planes, usable):
    """Of the planes of its neighbors, the one that explains each query best: their rows. `usable`
    is True for all planes; an array, so that it is made once."""
    nearest = around.indices[:, 0]
    least = np.maximum(FaceLimits().least_noise * planes.spacing[nearest], np.finfo(float).tiny)
    owners = explain(queries, around, planes, usable, least, likely=True)[0]
    return np.where(owners < 0, nearest, owners)  # what no plane reaches has the nearest one's


def _compiled(name):
    return compiled_function("edges._crease_distance_numba", name)
