"""Principal curvatures of the surface at points, by a quadric fitted to its members.

The quadric is the osculating jet of degree 2 of F. Cazals, M. Pouget, "Estimating differential
quantities using polynomial fitting of osculating jets", Computer Aided Geometric Design 22 (2005)
121-146. Its members are those of the neighborhood that belong to the surface: first those that the
point's plane explains, then those that the quadric does.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri, stdtrit

from sklearn_mcmd.planes._explaining import ExplainLimits
from sklearn_mcmd.planes._orientation import point_up
from sklearn_mcmd.planes._principal_planes import CONFIDENCE
from sklearn_mcmd.planes._quadrics import QuadricLimits, n_terms, tangents_of, work_arrays
from sklearn_mcmd.planes._record import Planes
from sklearn_mcmd.planes._rules import truncated_normal
from sklearn_mcmd.runtime._chunks import each_chunk, each_slice
from sklearn_mcmd.runtime._compiling import compiled_function

TERMS = n_terms(3)  # of a quadric


class Curvatures(NamedTuple):
    """Curvatures at m points, one row each, in one over units of the points.

    A curvature is positive where the surface bends to the side of its normal. If nothing determines
    the curvatures of a point, these and the directions are 0, and the errors are one over the
    radius of its neighborhood, which is the largest error. Errors are standard errors. Directions
    (m, 3) are unit vectors in the surface, whose last coordinate that is not zero is positive.
    """

    max_curvature: np.ndarray  # (m,)
    min_curvature: np.ndarray
    max_error: np.ndarray
    min_error: np.ndarray
    mean_error: np.ndarray  # of the mean of both curvatures
    max_direction: np.ndarray
    min_direction: np.ndarray

    @classmethod
    def empty(cls, m):
        """A record to be filled."""
        vectors = ("max_direction", "min_direction")
        shapes = {name: (m, 3) if name in vectors else (m,) for name in cls._fields}
        return cls(**{name: np.empty(shape) for name, shape in shapes.items()})

    put, take = Planes.put, Planes.take  # type: ignore[misc]


class JetLimits(NamedTuple):
    """What members a quadric has."""

    explained: float  # standard deviations within which the plane, then the quadric, has members
    truncation: float  # standard deviation of noise over that of its part within `explained`
    pivot: float  # as in `QuadricLimits`
    rounds: int = 2  # times that the members are chosen anew, by the quadric
    least_members: int = 8  # leaves two degrees of freedom for the noise


class Jets(NamedTuple):
    """Quadrics of m neighborhoods, one row each, in radii of the neighborhoods.

    Coordinates u and v along the tangents begin at the point, and the height is along the normal.
    The covariance of the bends is the noise's variance times the inverse of L L'.
    """

    slopes: np.ndarray  # (m, 2), coefficients of u and v
    bends: np.ndarray  # (m, 3), coefficients of uu, uv and vv
    factors: np.ndarray  # (m, 6), rows of the lower triangle L
    noise: np.ndarray  # (m,), standard deviation of the members from the quadric
    n_used: np.ndarray  # int (m,), members; 0 where they do not determine the quadric


def curvatures_of_fitted(model, planes, X, n_jobs=None):
    """The `Curvatures` at the points X (n, 3) that a model was fitted to.

    `planes` has the plane of each row of X; the signs of the curvatures follow from their normals.
    """
    index = model.index
    if index.n_neighbors is None:
        return curvatures_of_new(model, planes, X, n_jobs)
    distinct = Curvatures.empty(len(index.points))

    def task(rows):
        part_planes, around = planes.take(index.rows[rows]), index.query_own(rows, keep=False)
        points = index.points[rows]
        distinct.put(rows, _curvatures_of_each(model, part_planes, points, around))

    each_slice(len(index.points), model.chunk(), task, n_jobs)
    places, curvatures = index.places, distinct.take(index.places)
    # Copies of a point that a sensor measured from its other side have the opposite normal.
    turned = (planes.normals != planes.normals[index.rows[places]]).any(axis=1)
    rows = np.flatnonzero(turned)
    if len(rows):
        curvatures.put(rows, curvatures_of_new(model, planes.take(rows), X[rows]))
    return curvatures


def curvatures_of_new(model, planes, queries, n_jobs=None):
    """Curvatures at any queries (m, 3); `planes` are the queries' planes."""
    queries = np.ascontiguousarray(queries, dtype=np.float64)
    if model.index.n_neighbors is None:
        return _curvatures_of_one(model, planes, queries)
    curvatures = Curvatures.empty(len(queries))

    def task(rows):
        part = queries[rows]
        around = model.index.query(part)
        curvatures.put(rows, _curvatures_of_each(model, planes.take(rows), part, around))

    each_chunk(queries, model.chunk(), task, n_jobs)
    return curvatures


def _curvatures_of_each(model, planes, queries, around):
    """Curvatures where each query has its neighborhood."""
    tangents = tangents_of(planes.normals)
    jets = _fit_jets(model, planes, queries, around, tangents)
    return _derive(jets, tangents, planes.normals, planes.radius)


def _curvatures_of_one(model, planes, queries):
    """Curvatures where all queries share one neighborhood, and so one quadric.

    Their normals may differ in sign.
    """
    one, m = planes.take(slice(0, 1)), len(queries)
    tangents = tangents_of(one.normals)
    around = model.index.query(one.centroids)
    jets = _fit_jets(model, one, one.centroids, around, tangents)
    jets = Jets._make(np.broadcast_to(values, (m, *values.shape[1:])) for values in jets)
    radius = planes.radius[0] if planes.radius[0] > 0 else 1.0
    # The quadric begins at the centroid; its slopes at the queries are those there and its bends'.
    u, v = ((queries - one.centroids) / radius @ tangents[0].T).T
    uu, uv, vv = jets.bends.T
    slopes = jets.slopes + np.column_stack([2 * uu * u + uv * v, uv * u + 2 * vv * v])
    side = np.copysign(1.0, planes.normals @ one.normals[0])[:, None]
    jets = jets._replace(slopes=side * slopes, bends=side * jets.bends)
    return _derive(jets, np.broadcast_to(tangents, (m, 2, 3)), planes.normals, planes.radius)


def _fit_jets(model, planes, queries, around, tangents):
    """Quadrics over the planes (m) of queries (m, 3), along `tangents` (m, 2, 3)."""
    points, explained = model.index.points, ExplainLimits().explained
    truncation = truncated_normal(explained)[1] ** -0.5
    limits = JetLimits(explained, truncation, QuadricLimits().pivot)
    floor, k = model.least_scales(planes.centroids), around.indices.shape[1]
    m, (arrays, equations) = len(queries), work_arrays(8, k)
    jets = Jets(
        slopes=np.zeros((m, 2)),
        bends=np.zeros((m, 3)),
        factors=np.ones((m, 6)),
        noise=np.zeros(m),
        n_used=np.zeros(m, np.int64),
    )
    room = arrays[:3], arrays[3:6], arrays[6], arrays[7], np.empty(k, bool), *equations
    fit = compiled_function("planes._quadrics_numba", "fit_jets")
    fit(points, around, queries, tangents, planes, floor, limits, room, jets)
    return jets


def _derive(jets, tangents, normals, radius):
    """Curvatures from quadrics, by the Weingarten map at u = v = 0."""
    b, c = jets.slopes.T
    uu, uv, vv = jets.bends.T
    # Step 1: the Weingarten map. The metric of the tangent plane, [[1 + bb, bc], [bc, 1 + cc]], is
    # L L'. In the basis of the columns of the inverse of L', which are orthonormal on the surface,
    # the map is symmetric. The second derivatives of the height are 2 uu, uv and 2 vv.
    steep = np.sqrt(1 + b * b + c * c)
    i11 = 1 / np.sqrt(1 + b * b)
    i21, i22 = -b * c * i11 / steep, 1 / (steep * i11)
    first = i11 * i11 * 2 * uu / steep
    mixed = i11 * (2 * i21 * uu + i22 * uv) / steep
    second = 2 * (i21 * i21 * uu + i21 * i22 * uv + i22 * i22 * vv) / steep
    # Step 2: its eigenvalues, mean + half and mean - half, and the angle of the first direction.
    mean, half = (first + second) / 2, np.hypot((first - second) / 2, mixed)
    turn = np.arctan2(2 * mixed, first - second) / 2
    cosine, sine = np.cos(turn), np.sin(turn)
    # Step 3: directions in space; and derivatives of either curvature by the bends, for the errors.
    directions, gradients = [], []
    for x, y in ((cosine, sine), (-sine, cosine)):
        x, y = i11 * x + i21 * y, i22 * y
        flat = x[:, None] * tangents[:, 0] + y[:, None] * tangents[:, 1]
        directions.append(point_up(flat + (b * x + c * y)[:, None] * normals))
        gradients.append(2 * np.stack([x * x, x * y, y * y]) / steep)
    # Step 4: errors. The ratio of the quantiles of Student's and the normal distribution widens
    # those of few members.
    counts, inverse_counts = np.unique(jets.n_used, return_inverse=True)
    quantile = (1 + CONFIDENCE) / 2
    student = stdtrit(np.maximum(counts - TERMS, 1), quantile) / ndtri(quantile)
    unit = jets.noise * student[inverse_counts]
    errors = [unit * _length(jets.factors, gradient) for gradient in gradients]
    mean_error = unit * _length(jets.factors, (gradients[0] + gradients[1]) / 2)
    # From one over radii to one over units; zeros where the error exceeds one over the radius.
    inverse = np.divide(1.0, radius, out=np.zeros(len(radius)), where=radius > 0)
    determined = (jets.n_used > 0) & (np.maximum(errors[0], errors[1]) <= 1.0)
    return Curvatures(
        max_curvature=np.where(determined, mean + half, 0.0) * inverse,
        min_curvature=np.where(determined, mean - half, 0.0) * inverse,
        max_error=np.where(determined, errors[0], 1.0) * inverse,
        min_error=np.where(determined, errors[1], 1.0) * inverse,
        mean_error=np.where(determined, mean_error, 1.0) * inverse,
        max_direction=np.where(determined[:, None], directions[0], 0.0),
        min_direction=np.where(determined[:, None], directions[1], 0.0),
    )


def _length(factors, gradient):
    """Length of the inverse of L times the gradient (3, m)."""
    l11, l21, l22, l31, l32, l33 = factors.T
    x = gradient[0] / l11
    y = (gradient[1] - l21 * x) / l22
    z = (gradient[2] - l31 * x - l32 * y) / l33
    return np.sqrt(x * x + y * y + z * z)
