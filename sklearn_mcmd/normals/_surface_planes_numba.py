"""Which planes of neighbors explain a point, compiled."""

import numpy as np

from sklearn_mcmd.planes._quadrics_numba import (
    ORIGIN,
    back_substitute,
    decompose,
    frame,
    localize,
    quadric_moments,
)
from sklearn_mcmd.runtime._kernels import kernel

# The variance of how a quadric's normals turn, over that of its normal in the middle, is this times
# the squared distance over its mean: by least squares, of members that are even on a disk; or, in
# 2D, on a line.
TURN, TURN_2D = 6.0, 5.0


@kernel(cache=True)
def find_lenders(points, queries, around, planes, most, limits, arrays, lenders):
    """Fill `lenders` as `find_lenders` of ``_surface_planes`` returns them, in work arrays."""
    d = queries.shape[1]
    patch, heights = arrays[:d], arrays[d]
    for i in range(len(queries)):
        size = around.sizes[i]
        n = _localize(points, queries[i], around.indices[i], size, limits.patch, patch)
        lenders[i] = -1
        least_cost, best_first = np.inf, False
        for j in range(size):
            row = around.indices[i, j]
            height = _height_over(planes, row, queries[i])
            variance = planes.scale[row] * planes.scale[row]
            distance = height * height / variance
            first = (
                variance <= most[i] * most[i] and distance <= limits.explained * limits.explained
            )
            if not distance < np.inf or (best_first and not first):
                continue
            cost = _cost_of_plane(planes, row, height, limits, patch, n, heights)
            if cost < np.inf and ((first and not best_first) or cost < least_cost):
                lenders[i] = row
                least_cost, best_first = cost, first


@kernel(inline="always")
def _height_over(planes, row, query):
    """Height of a query above the plane of a row; inf where that is none, or does not reach it."""
    height = reach = 0.0
    for axis in range(len(query)):
        gap = query[axis] - planes.centroids[row, axis]
        height += gap * planes.normals[row, axis]
        reach += gap * gap
    reached = planes.scale[row] > 0.0 and np.sqrt(reach) <= planes.radius[row]
    return height if reached else np.inf


@kernel(inline="always")
def _cost_of_plane(planes, row, height, limits, patch, n, heights):
    """Minus the logarithm of how likely the plane of a row is that of a patch, whose query is at
    this height above it."""
    variance = planes.scale[row] * planes.scale[row]
    _others(patch, n, planes.normals[row], height, heights)
    cost = np.log(variance) - 2.0 * np.log(planes.kept[row])
    distances = height * height / variance + _weighted(heights, n, variance, limits.explained)
    return cost + 0.5 * distances


@kernel(inline="always")
def _localize(points, query, row, size, share, patch):
    """Fill the coordinates of the patch from the query, and return its number of points."""
    same = True
    for axis in range(len(query)):
        same &= points[row[0], axis] == query[axis]
    start = 1 if same else 0
    n = min(max(1, int(share * size)), size - start)
    for j in range(n):
        for axis in range(len(query)):
            patch[axis, j] = points[row[start + j], axis] - query[axis]
    return n


@kernel(inline="always")
def _others(patch, n, normal, height, heights):
    """Fill the heights of the patch above a plane."""
    for j in range(n):
        heights[j] = height
    for axis in range(len(normal)):
        for j in range(n):
            heights[j] += normal[axis] * patch[axis, j]


@kernel(inline="always")
def _weighted(heights, n, variance, explained):
    """Weighted mean of squared distances in standard deviations, each limited."""
    total, most = 0.0, explained * explained * variance
    for j in range(n):
        total += (n - j) * min(heights[j] * heights[j], most)
    return total / (max(0.5 * n * (n + 1), 1.0) * variance)


@kernel(cache=True)
def doubted_errors(points, queries, around, planes, members, smooth, limits, pivot, room, errors):
    """Fill `errors` as `doubted_errors` of ``_surface_planes`` returns them, in work arrays.

    `found` has, of the planes that are asked, the heights of the query above them, what their
    angles have beyond chance, and along two tangents the places of their points and the lean of
    their normals.
    """
    d, (tangents, patches, found, quadric) = queries.shape[1], room
    patch, heights = patches[:d], patches[d]
    for i in range(len(queries)):
        near, size = around.indices[i], around.sizes[i]
        n_planes = min(max(1, int(limits.patch * size)) + 1, size)
        row = near[size - n_planes :] if smooth[i] else near
        own = planes.normal_error[i] * planes.normal_error[i]
        between = 0.0
        if _may_lean(row, n_planes, members, own, planes.normals[i]):
            axes = frame(planes.normals[i], tangents[i])
            reached = _lean_of_planes(points, queries[i], row, n_planes, axes, members, found)
            doubted = reached and _beyond_chance(row, n_planes, members, own, 0.0, found)
            if doubted and smooth[i]:
                turn = _take_turn(
                    points, queries[i], near, size, n_planes, axes, pivot, quadric, found
                )
                doubted = _beyond_chance(row, n_planes, members, own, turn, found)
            if doubted:
                n = _localize(points, queries[i], near, size, limits.patch, patch)
                between = _between(row, n_planes, members, limits, patch, n, heights, found)
                if smooth[i]:
                    between *= d - 1  # a crease turns in one direction of the plane
        errors[i] = min(90.0, np.sqrt(own + between))


@kernel(inline="always")
def _may_lean(row, n_planes, members, own, normal):
    """Whether a squared angle can be larger than twice what is chance, from the cosines alone: an
    angle is at most its sine s and (pi / 2 - 1) s^3."""
    most = 0.0
    for j in range(n_planes):
        cosine, error = 0.0, members.normal_error[row[j]]
        for axis in range(len(normal)):
            cosine += normal[axis] * members.normals[row[j], axis]
        square = max(1.0 - cosine * cosine, 0.0) + 1e-14  # and what rounding may hide
        square *= ((1.0 + 0.571 * square) * 180.0 / np.pi) ** 2
        most = max(most, square - 2.0 * error * error)
    return most > 2.0 * own


@kernel(inline="always")
def _lean_of_planes(points, query, row, n_planes, axes, members, found):
    """Fill the heights, places and leans of planes; whether any of these reaches the query. The
    others have no place and no lean."""
    d, reached = len(query), False
    for j in range(n_planes):
        found[0, j] = _height_over(members, row[j], query)
        reaches = found[0, j] < np.inf
        reached |= reaches
        found[1, j] = np.inf
        side = 0.0
        for axis in range(d):
            side += axes[0][axis] * members.normals[row[j], axis]
        for t in range(2):
            place = lean = 0.0
            if t < d - 1 and reaches:
                for axis in range(d):
                    place += axes[1 + t][axis] * (points[row[j], axis] - query[axis])
                    lean += axes[1 + t][axis] * members.normals[row[j], axis]
            found[2 + t, j] = place
            found[4 + t, j] = lean if side >= 0.0 else -lean
    return reached


@kernel(inline="always")
def _take_turn(points, query, row, size, n_planes, axes, pivot, room, found):
    """Subtract from how normals lean what the quadric of the neighborhood turns by from the query
    to their places. Returns its variance at a distance of one over that of the query's normal, 0
    if the members determine no quadric.

    A cylinder's normals lean by what is linear in the place, as the slopes of a quadric do.
    """
    local, heights, lower, right, solution = room
    localize(points, row, size, query, local)
    square = 0.0
    for j in range(size):
        for axis in range(len(query)):
            square += local[axis, j] * local[axis, j]
    if square == 0.0:
        return 0.0
    square /= size
    extent = np.sqrt(square)
    quadric_moments(local, size, len(query), ORIGIN, axes, extent, lower, right, heights)
    _, determined = decompose(lower, right, solution, 0.0, pivot)
    if not determined:
        return 0.0
    back_substitute(lower, solution)
    uu, uv, vv = solution[3], solution[4], solution[5]
    for j in range(n_planes):
        u, v = found[2, j] / extent, found[3, j] / extent
        found[4, j] += 2.0 * uu * u + uv * v
        found[5, j] += uv * u + 2.0 * vv * v
    return (TURN if len(query) > 2 else TURN_2D) / square


@kernel(inline="always")
def _beyond_chance(row, n_planes, members, own, turn, found):
    """Lower to how much larger squared angles are than what is chance, in square degrees, or 0;
    whether any is. `turn` is what `_take_turn` returns, or 0."""
    doubted = False
    for j in range(n_planes):
        error, beyond = members.normal_error[row[j]], 0.0
        place = found[2, j] * found[2, j] + found[3, j] * found[3, j]
        chance = 2.0 * (own + error * error) + turn * own * place
        square = found[4, j] * found[4, j] + found[5, j] * found[5, j]
        if 90.0 * 90.0 * square > chance:  # an angle is no larger than 90 degrees times its sine
            angle = np.degrees(np.arcsin(min(np.sqrt(square), 1.0)))
            beyond = max(angle * angle - chance, 0.0)
        found[1, j] = min(found[1, j], beyond)
        doubted |= found[1, j] > 0.0
    return doubted


@kernel(inline="always")
def _between(row, n_planes, members, limits, patch, n, heights, found):
    """The variance between the planes that reach the query, by their probabilities."""
    least = np.inf
    for j in range(n_planes):
        if found[0, j] < np.inf:
            cost = _cost_of_plane(members, row[j], found[0, j], limits, patch, n, heights)
            found[0, j] = cost
            least = min(least, cost)
    total = between = 0.0
    for j in range(n_planes):
        if found[0, j] < np.inf:
            weight = np.exp(least - found[0, j])
            total += weight
            between += weight * found[1, j]
    return between / total if total > 0.0 else 0.0
