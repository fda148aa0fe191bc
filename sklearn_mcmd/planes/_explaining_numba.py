"""``_explaining``, compiled; any dimension."""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel


@kernel(cache=True)
def explain_queries(queries, candidates, planes, usable, least, likely, tie, owners, distances):
    """Fill owners and distances as `explain` returns them; costs within `tie` are equal."""
    d = queries.shape[1]
    for i in range(len(queries)):
        owners[i], distances[i], least_cost = -1, np.inf, np.inf
        for j in range(candidates.sizes[i]):
            row = candidates.indices[i, j]
            if not usable[row] or (likely and not planes.scale[row] > 0.0):
                continue
            height = reach = 0.0
            for axis in range(d):
                deviation = queries[i, axis] - planes.centroids[row, axis]
                height += deviation * planes.normals[row, axis]
                reach += deviation * deviation
            if not np.sqrt(reach) <= planes.radius[row]:
                continue
            variance = planes.scale[row] * planes.scale[row] + least[i] * least[i]
            distance = abs(height) / np.sqrt(variance)
            cost = distance
            if likely:  # minus the logarithm of the density, but for a constant
                cost = 0.5 * (np.log(variance) + distance * distance)
            if cost < np.inf and cost < least_cost - tie * (1.0 + abs(cost)):
                owners[i], distances[i], least_cost = row, distance, cost


@kernel(cache=True)
def link_rows(points, around, planes, limits, usable, farthest, start, links):
    """Fill the links, int32 (m, width), of the points from row `start` on, which `around` has.

    `farthest` (n,) has the distances of the last neighbors, if both must be near. If `usable` is
    empty, all points are.
    """
    centroids, normals, scale = planes.centroids, planes.normals, planes.scale
    d, all_are = points.shape[1], len(usable) == 0
    for row in range(len(links)):
        i = start + row
        links[row] = -1
        n_near = around.sizes[row] if all_are or usable[i] else 0
        for a in range(n_near):
            j = around.indices[row, a]
            square = cosine = height = back = 0.0
            for axis in range(d):
                gap = points[j, axis] - points[i, axis]
                square += gap * gap
                cosine += normals[i, axis] * normals[j, axis]
                height += (points[j, axis] - centroids[i, axis]) * normals[i, axis]
                back += (points[i, axis] - centroids[j, axis]) * normals[j, axis]
            fits = j != i and (all_are or usable[j])
            fits &= abs(height) <= limits.explained * scale[i]
            fits &= abs(cosine) >= limits.min_cosine
            distance = np.sqrt(square)
            fits &= distance <= limits.max_gap
            if limits.mutual:
                fits &= abs(back) <= limits.explained * scale[j]
            if limits.both_near:
                fits &= distance <= farthest[j]
            if fits:
                links[row, a] = j


@kernel(cache=True)
def join(links, start, roots):
    """Join rows from `start` on to what they are linked to: `roots` lead to the first of a part."""
    n, width = links.shape
    for i in range(n):
        for a in range(width):
            if links[i, a] < 0:
                continue
            first, second = _root(roots, start + i), _root(roots, np.int64(links[i, a]))
            # The root is the first point of its part, in whatever order links are followed.
            if first < second:
                roots[second] = first
            else:
                roots[first] = second


@kernel(cache=True)
def number_parts(roots):
    """Numbers of the parts of all rows, in the order of their first points, in place."""
    n_parts = 0
    for i in range(len(roots)):
        if roots[i] == i:
            roots[i] = n_parts
            n_parts += 1
        else:  # what it points to comes before it and has its number
            roots[i] = roots[roots[i]]
    return roots


@kernel
def _root(roots, row):
    while roots[row] != row:
        roots[row] = roots[roots[row]]
        row = roots[row]
    return row
