"""How far points are from a crease: the line in which the planes of two faces meet.

Near an edge the neighborhood of a point holds two faces. The point is given the plane that
explains it best, its own or a neighbor's, and so are its neighbors; where two of these planes
meet is the edge, known to a fraction of the spacing of the points. Whether there is an edge is
decided between two models of the neighborhood: faces that meet in creases, or one smooth
surface. The verdict is pooled over the neighbors, as an edge is a line and not a point.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import gamma

from sklearn_mcmd.planes._chunks import run
from sklearn_mcmd.planes._explaining import ExplainLimits, explain
from sklearn_mcmd.planes._local_planes import COMPILE_FROM
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._progress import progress_part
from sklearn_mcmd.planes._record import Neighborhoods, Planes

__all__ = ["FAR", "CreaseModel"]

#: Distance, in spacings, of points without a crease in their neighborhood.
FAR = 20.0

# Entries of the largest array a task holds.
CHUNK = 1_500_000
# The spacing is told from this many neighbors, or all if fewer.
SPACING_NEIGHBORS = 8
# Noise is at least this share of the spacing: a point is not known better.
LEAST_NOISE = 0.05
# Standard deviations beyond which a residual tells no more.
OFF = 3.0
# A face is flat: its noise is at most this share of its radius, or this multiple of what is usual.
FLATNESS, FLATNESS_FACTOR = 0.2, 3.0
# Neighbors that must lie on another face, at least.
LEAST_COMPANY = 3
# A third face is seen where it takes this share off the squared residuals.
THIRD_FACE = 0.8
# Creases farther than this many spacings say nothing about the neighbors.
REACH = 3.0
# Shares of the time of the steps, for the display of progress.
SEARCHING, MEASURING, GIVING, MEETING, JUDGING = (
    (0.0, 0.1), (0.1, 0.15), (0.15, 0.3), (0.3, 0.9), (0.9, 1.0),
)  # fmt: skip
# How steeply a smooth surface, and a point off its plane, count as far.
STEEPNESS = 30
OFF_STEEPNESS = 2
SMOOTH_STEPS = 3


# The plane of a face is the one under which a point is most likely.
LIKELIEST = ExplainLimits(likely=True)


class Faces(NamedTuple):
    """The plane given to each of m points."""

    planes: Planes  # `spacing` is that of the point's neighbors
    levels: np.ndarray  # n . x of the plane's points
    height: np.ndarray  # of the point above its plane
    flat: np.ndarray  # whether the plane is that of a face, not of foliage or a cluster

    def take(self, rows):
        """The planes of some of the points."""
        return Faces(self.planes.take(rows), self.levels[rows], self.height[rows], self.flat[rows])


class CreaseModel:
    """A fitted cloud that tells the distance of any point to the nearest crease.

    Parameters
    ----------
    n_neighbors : int
    min_angle : float
        Degrees between the planes of two faces, at least.
    n_jobs : int or None

    Attributes
    ----------
    distances : ndarray of shape (n,)
        ``distance`` of the fitted points.
    """

    def __init__(self, n_neighbors, min_angle, n_jobs=None):
        self.n_neighbors = n_neighbors
        self.cosine = np.cos(np.radians(min_angle))
        self.n_jobs = n_jobs

    def fit(self, columns):
        """Find the creases of points with planes, the `Columns` of a transformer."""
        points = columns.coordinates.astype(np.float64)
        self.index = NeighborIndex(points, self.n_neighbors)
        # Heights are differences of coordinates, which may be large.
        self.origin = self.index.points.mean(axis=0)
        self.points = self.index.points - self.origin
        self.planes = columns.planes(self.index.rows)
        self.planes.centroids[:] -= self.origin
        with progress_part(*SEARCHING):
            around = self._search(len(self.points), self.index.query_own)
        with progress_part(*MEASURING):
            self._in_chunks(around, self._measure_spacing)
        self.usable = np.ones(len(self.points), dtype=bool)
        # Decided by the fitted cloud, so that any query is the same arithmetic.
        self.compiled = len(self.points) >= COMPILE_FROM
        flatness = self.planes.scale / np.maximum(self.planes.radius, np.finfo(float).tiny)
        self.flat = flatness <= max(FLATNESS, FLATNESS_FACTOR * np.median(flatness))
        with progress_part(*GIVING):
            self.faces = self._give_planes(self.points, around)
        with progress_part(*MEETING):
            distance, self.evidence = self._meet(self.points, self.faces, around)
        self.evidence[~(distance <= REACH)] = np.nan
        # Copies of a point are as far as the one that stands for them.
        with progress_part(*JUDGING):
            distance = self._judge(self.faces, distance, around)
        self.distances = distance[self.index.places]
        return self

    def distance(self, queries):
        """Distances of queries (m, d) to the nearest crease, in spacings, `FAR` at most.

        Where no crease is found it is between half of `FAR` and `FAR`, the less, the less flat
        the neighborhood.
        """
        with progress_part(*SEARCHING):
            around = self._search(len(queries), lambda part: self.index.query(queries[part]))
        queries = queries - self.origin
        with progress_part(*GIVING):
            faces = self._give_planes(queries, around)
        with progress_part(*MEETING):
            distance, _ = self._meet(queries, faces, around)
        with progress_part(*JUDGING):
            return self._judge(faces, distance, around)

    def _search(self, m, query):
        """The neighborhoods of m points, of slices by `query`: one search for all that follows."""
        k = self.index.n_neighbors
        indices = np.empty((m, k), dtype=np.int32)

        def task(part):
            indices[part] = query(part).indices

        step = max(1, CHUNK // (k * self.points.shape[1]))
        run([(slice(i, i + step),) for i in range(0, m, step)], task, self.n_jobs, told=True)
        return Neighborhoods(indices, np.full(m, k))

    def _judge(self, faces, distance, around):
        """Distances as told, from those to the crease and what the neighbors say of it."""
        pooled, flat = np.full(len(distance), np.nan), np.empty(len(distance))

        def pool(part, around, pooled, flat):
            indices = around.indices
            pooled[part] = _median(self.evidence[indices])
            flat[part] = 1.0 - 0.5 * _roundness(self.points[indices])

        self._in_chunks(around, pool, pooled, flat)
        # Continuous: as far as it is where an edge is the better model, farther where not.
        smooth = np.exp(np.minimum(STEEPNESS * np.maximum(pooled, 0.0), 50.0))
        off = np.maximum(np.abs(faces.height) / (OFF * faces.planes.scale), 1.0) ** OFF_STEEPNESS
        found = np.isfinite(distance) & np.isfinite(pooled)
        distance = np.where(found, distance * smooth * off, FAR)
        return np.minimum(distance, FAR * flat)

    def _in_chunks(self, around, work, *arrays, width=None):
        """Call `work` with rows of queries, their neighborhoods and the arrays to fill."""
        n, k = around.indices.shape
        step = max(1, CHUNK // (k * (self.points.shape[1] if width is None else width)))
        parts = [np.arange(start, min(start + step, n)) for start in range(0, n, step)]

        def task(part):
            work(part, around.take(part), *arrays)

        run([(part,) for part in parts], task, self.n_jobs, told=True)

    def _measure_spacing(self, part, around):
        """Spacing of the points around each one, and their reach; no plane is known better."""
        gaps = self.points[around.indices] - self.points[part][:, None]
        distances = np.sqrt(np.einsum("mkd,mkd->mk", gaps, gaps))
        spacing, planes = _spacing(distances, self.points.shape[1]), self.planes
        planes.spacing[part], planes.radius[part] = spacing, distances.max(axis=1)
        planes.scale[part] = np.maximum(planes.scale[part], LEAST_NOISE * spacing)

    def _give_planes(self, queries, around):
        """Of the planes of its neighbors, the one that explains each query best."""
        owners, spacing = np.empty(len(queries), dtype=np.intp), np.empty(len(queries))
        # What no plane reaches is given the likeliest as if all were boundless.
        boundless = self.planes._replace(radius=np.full_like(self.planes.radius, np.inf))

        def choose(part, around, owners, spacing):
            spacing[part] = np.median(self.planes.spacing[around.indices], axis=1)
            owners[part] = self._likeliest(queries, part, around, self.planes, spacing)
            far = owners[part] < 0
            if far.any():
                found = self._likeliest(queries, part[far], around.take(far), boundless, spacing)
                # Points in one place have no planes.
                owners[part[far]] = np.where(found < 0, around.indices[far, 0], found)

        self._in_chunks(around, choose, owners, spacing)
        given = self.planes.take(owners)
        levels = np.einsum("md,md->m", given.centroids, given.normals)
        height = np.einsum("md,md->m", queries, given.normals) - levels
        scale = np.maximum(given.scale, LEAST_NOISE * spacing)
        scale = np.maximum(scale, np.finfo(float).tiny)
        given = given._replace(scale=scale, spacing=spacing)
        return Faces(given, levels, height, self.flat[owners])

    def _likeliest(self, queries, part, around, planes, spacing):
        """Whose plane explains queries[part] best, -1 where none does."""
        most = np.full(len(part), np.inf)
        least = np.maximum(LEAST_NOISE * spacing[part], np.finfo(float).tiny)
        owners, _ = explain(
            queries[part], around, planes, LIKELIEST, self.usable, least, most, self.compiled
        )
        return owners

    def _meet(self, queries, faces, around):
        """Distance to the nearest crease in spacings, inf if none, and the evidence for it.

        The evidence is the logarithm of the residuals of the best two or three faces over those
        of the best smooth surface: negative where there is an edge.
        """
        distance = np.full(len(queries), np.inf)
        evidence = np.full(len(queries), np.nan)
        on_face = self.faces.flat & (np.abs(self.faces.height) <= OFF * self.faces.planes.scale)

        def meet(part, around, distance, evidence):
            indices = around.indices
            own = faces.take(part)
            normals = self.faces.planes.normals[indices]
            cosines = np.abs(np.einsum("md,mkd->mk", own.planes.normals, normals))
            other = (cosines < self.cosine) & on_face[indices]
            busy = np.flatnonzero(other.sum(axis=1) >= LEAST_COMPANY)
            busy = busy[own.flat[busy] & (own.planes.spacing[busy] > 0)]
            if busy.size:
                results = self._faces_or_smooth(
                    queries[part[busy]], own.take(busy), indices[busy], cosines[busy], other[busy]
                )
                distance[part[busy]], evidence[part[busy]] = results

        width = min(self.index.n_neighbors, 1_000)
        self._in_chunks(around, meet, distance, evidence, width=width)
        return distance, evidence

    def _faces_or_smooth(self, queries, own, indices, cosines, other):
        """Distance and evidence of queries (m, d) with other faces among their neighbors."""
        neighbors, normals = self.points[indices], self.faces.planes.normals[indices]
        levels = self.faces.levels[indices]
        # Heights (m, k, k) of each neighbor above the plane given to each other one.
        heights = np.matmul(neighbors, normals.swapaxes(1, 2)) - levels[:, None]
        surface = np.einsum("mkd,md->mk", neighbors, own.planes.normals) - own.levels[:, None]
        above = np.einsum("md,mkd->mk", queries, normals) - levels
        limit = OFF * own.planes.scale[:, None]
        each = np.arange(len(queries))

        second, squares, surface = _join(surface, heights, other, limit)
        distance = _to_line(above[each, second], cosines[each, second])
        between = np.abs(np.einsum("md,mkd->mk", normals[each, second], normals))
        third_faces = other & (between < self.cosine)
        third, fewer, corner = _join(surface, heights, third_faces, limit)
        meets = fewer < THIRD_FACE * squares
        to_third = _to_line(above[each, third], cosines[each, third])
        distance = np.where(meets, np.minimum(distance, to_third), distance)
        surface = np.where(meets[:, None], corner, surface)

        least = 1e-4 * own.planes.scale**2  # of exact faces
        sharp = np.mean(np.clip(surface, -limit, limit) ** 2, axis=1) + least
        smooth = _smooth_residuals(neighbors, own.planes.scale)
        if smooth is None:
            return distance / own.planes.spacing, np.full(len(queries), -1.0)
        smooth = np.mean(np.minimum(smooth, limit) ** 2, axis=1) + least
        return distance / own.planes.spacing, 0.5 * np.log(sharp / smooth)


def _join(surface, heights, allowed, limit):
    """The face that, joined to a surface in a crease, leaves the least squared residuals.

    Two planes that cross make four surfaces with a crease, each a half of one and a half of the
    other: the larger or the lesser of both heights, either side of the second plane up.

    Parameters
    ----------
    surface : (m, k), heights of neighbors above the surface so far
    heights : (m, k, k), above the plane of each neighbor
    allowed : (m, k), neighbors whose plane may be joined
    limit : (m, 1), largest residual that counts

    Returns
    -------
    best : (m,), position of the neighbor
    squares : (m,), inf where none is allowed
    joined : (m, k)
    """
    each = np.arange(len(surface))
    best, squares = np.zeros(len(surface), dtype=np.intp), np.full(len(surface), np.inf)
    joined = surface.copy()
    room = np.empty_like(heights)
    for side in (1.0, -1.0):
        for choose in (np.maximum, np.minimum):
            np.multiply(heights, side, out=room)
            choose(room, surface[:, :, None], out=room)
            np.clip(room, -limit[:, :, None], limit[:, :, None], out=room)
            sums = np.where(allowed, np.einsum("mqj,mqj->mj", room, room), np.inf)
            candidate = sums.argmin(axis=1)
            least = sums[each, candidate]
            better = np.flatnonzero(least < squares)
            best[better], squares[better] = candidate[better], least[better]
            plane = side * heights[better, :, candidate[better]]
            joined[better] = choose(plane, surface[better])
    return best, squares, joined


def _to_line(height, cosine):
    """Distance, along the own plane, to the line where it meets one this far below."""
    sine = np.sqrt(np.maximum(1.0 - cosine**2, np.finfo(float).tiny))
    return np.abs(height) / sine


def _smooth_residuals(neighbors, scale):
    """Residuals (m, k) to the best surface of second order, None if too many coefficients."""
    _, k, d = neighbors.shape
    pairs = [(a, b) for a in range(1, d) for b in range(a, d)]
    n_coefficients = d + len(pairs)
    if k <= n_coefficients + 1:
        return None
    centered = neighbors - neighbors.mean(axis=1, keepdims=True)
    size = np.sqrt(np.einsum("mkd,mkd->m", centered, centered) / k)
    size = np.maximum(size, np.finfo(float).tiny)
    centered /= size[:, None, None]
    _, axes = np.linalg.eigh(np.matmul(centered.swapaxes(1, 2), centered))
    local = np.matmul(centered, axes)
    heights, plane = local[..., 0], local[..., 1:]
    squares = [local[..., a] * local[..., b] for a, b in pairs]
    terms = np.stack([np.ones_like(heights), *np.moveaxis(plane, -1, 0), *squares], axis=-1)
    weights = np.ones_like(heights)
    # A few points off the surface must not bend it: Huber's weights.
    for _ in range(SMOOTH_STEPS):
        weighted = terms * weights[..., None]
        normal = np.matmul(weighted.swapaxes(1, 2), terms) + 1e-9 * np.eye(n_coefficients)
        right = np.einsum("mka,mk->ma", weighted, heights)
        solution = np.linalg.solve(normal, right[..., None])[..., 0]
        residuals = heights - np.einsum("mka,ma->mk", terms, solution)
        slope = np.repeat(solution[:, None, 1:d], k, axis=1)
        for (a, b), curvature in zip(pairs, solution[:, d:].T, strict=True):
            slope[..., a - 1] += curvature[:, None] * local[..., b]
            slope[..., b - 1] += curvature[:, None] * local[..., a]
        residuals = np.abs(residuals) / np.sqrt(1.0 + np.einsum("mka,mka->mk", slope, slope))
        residuals *= size[:, None]
        with np.errstate(divide="ignore"):
            weights = np.minimum(1.0, 1.5 * scale[:, None] / residuals)
    # Two planes have as many coefficients: nothing to allow for.
    return residuals


def _roundness(neighbors):
    """Surface variation (m,) of neighborhoods (m, k, d), from 0 on a plane to 1 in a ball."""
    centered = neighbors - neighbors.mean(axis=1, keepdims=True)
    values = np.linalg.eigvalsh(np.matmul(centered.swapaxes(1, 2), centered))
    total = np.maximum(values.sum(axis=1), np.finfo(float).tiny)
    return neighbors.shape[2] * np.clip(values[:, 0] / total, 0.0, 1.0 / neighbors.shape[2])


def _spacing(distances, d):
    """Side of the cell that one point of a (d - 1)-dimensional surface takes, from (m, k)."""
    n = min(SPACING_NEIGHBORS, distances.shape[1] - 1)
    radius = np.partition(distances, n, axis=1)[:, n]
    ball = np.pi ** (0.5 * (d - 1)) / gamma(0.5 * (d - 1) + 1.0)
    return radius * (ball / n) ** (1.0 / (d - 1))


def _median(values):
    """Medians of rows without their NaN, NaN where all are."""
    values = np.sort(values, axis=1)  # NaN last
    count = np.isfinite(values).sum(axis=1)
    each = np.arange(len(values))
    low = values[each, np.maximum(count - 1, 0) // 2]
    high = values[each, np.minimum(count // 2, values.shape[1] - 1)]
    return np.where(count > 0, 0.5 * (low + high), np.nan)
