"""``doubted_errors`` of ``_plane_doubt``, compiled."""

import numpy as np

from sklearn_mcmd.normals._neighbor_planes_numba import cost_of_plane, height_over, localize
from sklearn_mcmd.runtime._kernels import kernel

__all__ = ["doubted_errors"]


@kernel(cache=True)
def doubted_errors(
    points, queries, around, planes, tangents, members, bends, limits, patches, found, errors
):
    """Fill `errors` as `doubted_errors` of ``_plane_doubt`` returns them; the arrays are scratch.

    Of the planes around, `found` has the heights of the query above them, what their angles have
    beyond chance, and along both tangents of the query where their points are and how much their
    normals lean.
    """
    d = queries.shape[1]
    patch, heights = patches[:d], patches[d]
    for i in range(len(queries)):
        row, size = around.indices[i], around.sizes[i]
        n = localize(points, queries[i], row, size, limits.patch, patch)
        n_planes = min(n + 1, size)
        reached = _lean_of_planes(
            points, queries[i], row, n_planes, planes.normals[i], tangents[i], members, found
        )
        if bends[i]:
            _take_trend(found, n_planes, d)
        own = planes.normal_error[i] * planes.normal_error[i]
        doubted = _beyond_chance(row, n_planes, members, own, found)
        between = 0.0
        if reached and doubted:
            between = _between(row, n_planes, members, limits, patch, n, heights, found)
        errors[i] = min(90.0, np.sqrt(own + between))


@kernel(inline="always")
def _lean_of_planes(points, query, row, n_planes, normal, tangents, members, found):
    """Fill the heights, places and leans of planes; whether any of these reaches the query. The
    others have no place and no lean."""
    d, reached = len(query), False
    for j in range(n_planes):
        found[0, j] = height_over(members, row[j], query)
        reaches = found[0, j] < np.inf
        reached |= reaches
        side = 0.0
        for axis in range(d):
            side += normal[axis] * members.normals[row[j], axis]
        for t in range(2):
            place = lean = 0.0
            if t < d - 1 and reaches:
                for axis in range(d):
                    place += tangents[t, axis] * (points[row[j], axis] - query[axis])
                    lean += tangents[t, axis] * members.normals[row[j], axis]
            found[2 + t, j] = place
            found[4 + t, j] = lean if side >= 0.0 else -lean
    return reached


@kernel(inline="always")
def _take_trend(found, n_planes, d):
    """Subtract from how normals lean what is linear in the places, by least squares, unless the
    places are too few or on one line, and do not determine it."""
    farthest = 0.0
    for j in range(n_planes):
        farthest = max(farthest, abs(found[2, j]), abs(found[3, j]))
    uu = uv = 0.0
    vv = 1.0 if d == 2 else 0.0  # there is no second tangent
    for j in range(n_planes):
        found[2, j] /= farthest  # so that no square is 0 or infinite, whatever the unit is
        found[3, j] /= farthest
        uu += found[2, j] * found[2, j]
        uv += found[2, j] * found[3, j]
        vv += found[3, j] * found[3, j]
    divisor = uu * vv - uv * uv
    if not divisor > 1e-12 * uu * vv:
        return
    for t in range(4, 6):
        along = across = 0.0
        for j in range(n_planes):
            along += found[2, j] * found[t, j]
            across += found[3, j] * found[t, j]
        slope = (vv * along - uv * across) / divisor
        other = (uu * across - uv * along) / divisor
        for j in range(n_planes):
            found[t, j] -= slope * found[2, j] + other * found[3, j]


@kernel(inline="always")
def _beyond_chance(row, n_planes, members, own, found):
    """Fill how much larger squared angles are than twice what is chance, in square degrees, or 0;
    whether any is."""
    doubted = False
    for j in range(n_planes):
        found[1, j], error = 0.0, members.normal_error[row[j]]
        chance = 2.0 * (own + error * error)
        square = found[4, j] * found[4, j] + found[5, j] * found[5, j]
        if 90.0 * 90.0 * square > chance:  # an angle is no larger than 90 degrees times its sine
            angle = np.degrees(np.arcsin(min(np.sqrt(square), 1.0)))
            found[1, j] = max(angle * angle - chance, 0.0)
            doubted |= found[1, j] > 0.0
    return doubted


@kernel(inline="always")
def _between(row, n_planes, members, limits, patch, n, heights, found):
    """The variance between the planes that reach the query, by their probabilities."""
    least = np.inf
    for j in range(n_planes):
        if found[0, j] < np.inf:
            cost = cost_of_plane(members, row[j], found[0, j], limits, patch, n, heights)
            found[0, j] = cost
            least = min(least, cost)
    total = between = 0.0
    for j in range(n_planes):
        if found[0, j] < np.inf:
            weight = np.exp(least - found[0, j])
            total += weight
            between += weight * found[1, j]
    return between / total if total > 0.0 else 0.0
