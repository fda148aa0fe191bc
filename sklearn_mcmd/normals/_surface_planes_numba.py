"""Which planes of neighbors explain a point, compiled."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel


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
def doubted_errors(
    points, queries, around, planes, tangents, members, bends, limits, patches, found, errors
):
    """Fill `errors` as `doubted_errors` of ``_surface_planes`` returns them, in work arrays.

    `found` has, of the planes around, the heights of the query above them, what their angles have
    beyond chance, and along two tangents the places of their points and the lean of their normals.
    """
    d = queries.shape[1]
    patch, heights = patches[:d], patches[d]
    for i in range(len(queries)):
        row, size = around.indices[i], around.sizes[i]
        n_planes = min(max(1, int(limits.patch * size)) + 1, size)
        own = planes.normal_error[i] * planes.normal_error[i]
        between = 0.0
        if bends[i] or _may_lean(row, n_planes, members, own, planes.normals[i]):
            reached = _lean_of_planes(
                points, queries[i], row, n_planes, planes.normals[i], tangents[i], members, found
            )
            if bends[i]:
                _take_trend(found, n_planes, d)
            if _beyond_chance(row, n_planes, members, own, found) and reached:
                n = _localize(points, queries[i], row, size, limits.patch, patch)
                between = _between(row, n_planes, members, limits, patch, n, heights, found)
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
def _lean_of_planes(points, query, row, n_planes, normal, tangents, members, found):
    """Fill the heights, places and leans of planes; whether any of these reaches the query. The
    others have no place and no lean."""
    d, reached = len(query), False
    for j in range(n_planes):
        found[0, j] = _height_over(members, row[j], query)
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
