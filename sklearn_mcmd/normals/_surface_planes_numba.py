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

# How much better a quadric's normal is known in the middle than its turn from there to a place.
# By least squares, of n members that are even on a disk whose mean squared radius is 1, and in
# units of noise / n: u and v have a variance of 2, uu and vv of 4.5, uv of 6. The normal is (u, v),
# with a variance of 2 + 2. At a distance of 1 along u it turns by (2 uu, uv): 4 * 4.5 + 6, which is
# 6 times as much. On a line (2D) u has 1 and uu 1.25: 4 * 1.25 is 5 times as much.
TURN, TURN_2D = 6.0, 5.0


@kernel(cache=True)
def find_lenders(points, queries, around, planes, most, limits, patch, lenders):
    """Fill `lenders` as `find_lenders` of ``_surface_planes`` returns them; see `Patch`."""
    for i in range(len(queries)):
        size = around.sizes[i]
        n = _localize(points, queries[i], around.indices[i], size, limits.patch, patch.places)
        lenders[i] = -1
        least_cost, best_is_fit = np.inf, False
        for j in range(size):
            row = around.indices[i, j]
            height = _height_over(planes, row, queries[i])
            variance = planes.scale[row] * planes.scale[row]
            distance = height * height / variance
            # A plane is fit to be lent if it is quiet and explains the query. Others come last.
            is_fit = (
                variance <= most[i] * most[i] and distance <= limits.explained * limits.explained
            )
            if not distance < np.inf or (best_is_fit and not is_fit):
                continue
            cost = _cost_of_plane(planes, row, height, limits, patch, n)
            if cost < np.inf and ((is_fit and not best_is_fit) or cost < least_cost):
                lenders[i] = row
                least_cost, best_is_fit = cost, is_fit


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
def _cost_of_plane(planes, row, height, limits, patch, n):
    """Minus the logarithm of how likely the plane of a row is that of a patch of n points, whose
    query is at this height above it."""
    variance = planes.scale[row] * planes.scale[row]
    _fill_heights(patch.places, n, planes.normals[row], height, patch.heights)
    # The query has a weight of 1, and so have all points of the patch together: the terms that do
    # not depend on a point, log S and -log f, count twice.
    cost = np.log(variance) - 2.0 * np.log(planes.kept[row])
    of_patch = _weighted(patch.heights, n, variance, limits.explained)
    return cost + 0.5 * (height * height / variance + of_patch)


@kernel(inline="always")
def _localize(points, query, neighbors, size, share, places):
    """Fill the coordinates of the patch from the query, and return its number of points."""
    same = True
    for axis in range(len(query)):
        same &= points[neighbors[0], axis] == query[axis]
    start = 1 if same else 0  # a fitted point is no point of its own patch
    n = min(max(1, int(share * size)), size - start)
    for j in range(n):
        for axis in range(len(query)):
            places[axis, j] = points[neighbors[start + j], axis] - query[axis]
    return n


@kernel(inline="always")
def _fill_heights(places, n, normal, height, heights):
    """Fill the heights of the patch above a plane, from the query's height."""
    for j in range(n):
        heights[j] = height
    for axis in range(len(normal)):
        for j in range(n):
            heights[j] += normal[axis] * places[axis, j]


@kernel(inline="always")
def _weighted(heights, n, variance, explained):
    """Weighted mean of squared distances in standard deviations, each limited.

    Weights fall from n at the nearest point to 1 at the farthest: their sum is n (n + 1) / 2.
    """
    total, most = 0.0, explained * explained * variance
    for j in range(n):
        total += (n - j) * min(heights[j] * heights[j], most)
    return total / (max(0.5 * n * (n + 1), 1.0) * variance)


@kernel(cache=True)
def doubted_errors(points, queries, around, planes, members, smooth, limits, work, errors):
    """Fill `errors` as `doubted_errors` of ``_surface_planes`` returns them; see `DoubtArrays`.

    Two normals whose errors are E and E_j differ by an angle whose square is E^2 + E_j^2 on
    average, by chance. What is more than twice that is doubt.
    """
    d, near_planes = queries.shape[1], work.near_planes
    for i in range(len(queries)):
        # Step 1: the planes that are asked, of the nearest or the farthest third of the neighbors.
        neighbors, size = around.indices[i], around.sizes[i]
        n_planes = min(max(1, int(limits.patch * size)) + 1, size)
        asked = neighbors[size - n_planes :] if smooth[i] else neighbors
        asked = asked[:n_planes]
        variance, between = planes.normal_error[i] * planes.normal_error[i], 0.0
        # Step 2: most neighborhoods end here, without an arc sine or a fit.
        if _may_lean(asked, members, variance, planes.normals[i]):
            # Step 3: what angles have beyond chance.
            axes = frame(planes.normals[i], work.tangents[i])
            reached = _lean_of_planes(points, queries[i], asked, axes, members, near_planes)
            doubted = reached and _beyond_chance(asked, members, variance, 0.0, near_planes)
            if doubted and smooth[i]:
                # Step 4: a surface that bends explains a part. The lesser of both counts.
                turn = _subtract_turn(points, queries[i], neighbors[:size], n_planes, axes, work)
                doubted = _beyond_chance(asked, members, variance, turn, near_planes)
            if doubted:
                # Step 5: the mean by the planes' probabilities.
                places = work.patch.places
                n = _localize(points, queries[i], neighbors, size, limits.patch, places)
                between = _between(asked, members, limits, work.patch, n, near_planes)
                if smooth[i]:
                    between *= d - 1  # a crease turns in one direction of the plane
        errors[i] = min(90.0, np.sqrt(variance + between))


@kernel(inline="always")
def _may_lean(asked, members, variance, normal):
    """Whether a squared angle can be larger than twice what is chance, from the cosines alone: an
    angle is at most its sine s and (pi / 2 - 1) s^3."""
    most = 0.0
    for j in range(len(asked)):
        cosine, error = 0.0, members.normal_error[asked[j]]
        for axis in range(len(normal)):
            cosine += normal[axis] * members.normals[asked[j], axis]
        square = max(1.0 - cosine * cosine, 0.0) + 1e-14  # and what rounding may hide
        square *= ((1.0 + 0.571 * square) * 180.0 / np.pi) ** 2
        most = max(most, square - 2.0 * error * error)
    return most > 2.0 * variance


@kernel(inline="always")
def _lean_of_planes(points, query, asked, axes, members, near_planes):
    """Fill the heights, places and leans of planes; whether any of these reaches the query. The
    others have no place and no lean."""
    d, reached = len(query), False
    for j in range(len(asked)):
        height = _height_over(members, asked[j], query)
        near_planes.heights[j], near_planes.doubt[j] = height, np.inf
        reached |= height < np.inf
        side = 0.0
        for axis in range(d):
            side += axes[0][axis] * members.normals[asked[j], axis]
        for t in range(2):  # in 2D there is one tangent
            place = lean = 0.0
            if t < d - 1 and height < np.inf:
                for axis in range(d):
                    place += axes[1 + t][axis] * (points[asked[j], axis] - query[axis])
                    lean += axes[1 + t][axis] * members.normals[asked[j], axis]
            near_planes.places[t, j] = place
            near_planes.leans[t, j] = lean if side >= 0.0 else -lean  # normals have no sign
    return reached


@kernel(inline="always")
def _subtract_turn(points, query, neighbors, n_planes, axes, work):
    """Subtract from how normals lean what the quadric of the neighborhood turns by from the query
    to their places. Returns its variance at a distance of one over that of the query's normal, 0
    if the members determine no quadric.

    A cylinder's normals lean by what is linear in the place, as the slopes of a quadric do.
    """
    quadric, leans, places = work.quadric, work.near_planes.leans, work.near_planes.places
    size, d, lower, solution = len(neighbors), len(query), quadric.lower, quadric.solution
    localize(points, neighbors, size, query, quadric.local)
    square = 0.0
    for j in range(size):
        for axis in range(d):
            square += quadric.local[axis, j] * quadric.local[axis, j]
    if square == 0.0:
        return 0.0
    square /= size
    extent = np.sqrt(square)
    heights, right = quadric.heights, quadric.right
    quadric_moments(quadric.local, size, d, ORIGIN, axes, extent, lower, right, heights)
    _, determined = decompose(lower, right, solution, 0.0, quadric.pivot)
    if not determined:
        return 0.0
    back_substitute(lower, solution)
    uu, uv, vv = solution[3], solution[4], solution[5]
    for j in range(n_planes):
        u, v = places[0, j] / extent, places[1, j] / extent
        leans[0, j] += 2.0 * uu * u + uv * v  # slopes are minus the normal's coordinates
        leans[1, j] += uv * u + 2.0 * vv * v
    return (TURN if d > 2 else TURN_2D) / square


@kernel(inline="always")
def _beyond_chance(asked, members, variance, turn, near_planes):
    """Lower the doubt to how much larger squared angles are than what is chance, in square degrees,
    or 0; whether any is. `turn` is what `_subtract_turn` returns, or 0."""
    doubted, places, leans = False, near_planes.places, near_planes.leans
    for j in range(len(asked)):
        error, beyond = members.normal_error[asked[j]], 0.0
        distance = places[0, j] * places[0, j] + places[1, j] * places[1, j]  # squared
        chance = 2.0 * (variance + error * error) + turn * variance * distance
        square = leans[0, j] * leans[0, j] + leans[1, j] * leans[1, j]  # of the sine
        if 90.0 * 90.0 * square > chance:  # an angle is no larger than 90 degrees times its sine
            angle = np.degrees(np.arcsin(min(np.sqrt(square), 1.0)))
            beyond = max(angle * angle - chance, 0.0)
        near_planes.doubt[j] = min(near_planes.doubt[j], beyond)
        doubted |= near_planes.doubt[j] > 0.0
    return doubted


@kernel(inline="always")
def _between(asked, members, limits, patch, n, near_planes):
    """The variance between the planes that reach the query: the mean of their doubts by their
    probabilities, which are exp(-cost). Heights become costs."""
    costs, least = near_planes.heights, np.inf
    for j in range(len(asked)):
        if costs[j] < np.inf:
            costs[j] = _cost_of_plane(members, asked[j], costs[j], limits, patch, n)
            least = min(least, costs[j])
    total = between = 0.0
    for j in range(len(asked)):
        if costs[j] < np.inf:
            weight = np.exp(least - costs[j])  # the largest is 1, so that none overflows
            total += weight
            between += weight * near_planes.doubt[j]
    return between / total if total > 0.0 else 0.0
