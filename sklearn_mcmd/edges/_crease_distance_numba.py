"""Distances to creases and the evidence for them, compiled; see ``_crease_distance``.

Numba lets a function without `fastmath` inherit it from the caller for which it is first compiled.
So what solves equations is called by functions that say ``fastmath=False``.
"""

import numpy as np

from sklearn_mcmd.planes._creases_numba import (
    RIDGE,
    center,
    fit_quadric,
    half_bic,
)
from sklearn_mcmd.planes._moments_numba import FASTMATH, principal_axes, weighted_covariance
from sklearn_mcmd.planes._quadrics_numba import TINY, localize
from sklearn_mcmd.runtime._kernels import kernel

EPS = np.finfo(np.float64).eps  # least sine squared of two faces, and radius of an arc


@kernel(cache=True)
def average_around(values, around, means):
    """Fill the means of the neighbors' values."""
    for i in range(len(means)):
        total = 0.0
        for j in around.indices[i]:
            total += values[j]
        means[i] = total / around.sizes[i]


@kernel(cache=True)
def count_turned(around, normals, cosine, turned):
    """Fill the share of the neighbors whose planes turn from that of the first by an angle."""
    for i in range(len(turned)):
        first, n_turned = normals[around.indices[i, 0]], 0
        for j in around.indices[i]:
            n_turned += 1 if abs(_dot(first, normals[j])) < cosine else 0
        turned[i] = n_turned / around.sizes[i]


@kernel(cache=True)
def meet_faces(points, queries, around, planes, owners, faces, told, room, distance, evidence):
    """Fill distance and evidence of queries as `Creases._meet` says."""
    limits, cosine, explained = told
    normals = planes.normals
    local, rows, mean, other, equations = room
    surface = rows[3]
    k, d = around.indices.shape[1], queries.shape[1]
    for i in range(len(queries)):
        near, own = around.indices[i], owners[i]
        scale, spacing = planes.scale[own], planes.spacing[near[0]]
        other[:] = True
        # A face has as many points as determine a plane.
        n_others = _differ(normals[own], normals, faces, near, cosine, other)
        if n_others < d or not spacing > 0.0:
            continue
        localize(points, near, k, queries[i], local)
        center(local, k, d, mean)
        most = (explained * scale) ** 2
        to_query = _heights(local, queries[i], mean, planes, own, rows[0])
        off = max(abs(to_query) / (explained * scale), 1.0)
        for j in range(k):
            surface[j] = rows[0, j]
        squares = rounded = np.inf
        n_joined, second, side_of_second = 0, own, 1.0
        for turn in range(2):
            height = rows[turn + 1]
            found, form, left = _join(
                local, near, faces.owners, queries[i], planes, mean, other, most, surface, height
            )
            to_query = _heights(local, queries[i], mean, planes, found, height)
            side, up = 1.0 if form < 2 else -1.0, 1.0 if form % 2 == 0 else -1.0
            for j in range(k):
                height[j] *= side
            # An arc may join any two of the faces.
            cosine_own = _dot(normals[own], normals[found])
            arc = _rounded(rows[0], height, up, side * cosine_own, limits.radii, spacing, most)
            rounded = min(rounded, arc)
            if turn:
                turned = side * side_of_second * _dot(normals[second], normals[found])
                arc = _rounded(rows[1], height, up, turned, limits.radii, spacing, most)
                rounded = min(rounded, arc)
            # By BIC: a plane has d numbers.
            if turn and not left < k ** (-d / k) * squares:
                break
            n_joined, squares = n_joined + 1, left
            sine = np.sqrt(max(1.0 - cosine_own * cosine_own, TINY))
            distance[i] = min(distance[i], abs(to_query) / sine * off / spacing)
            for j in range(k):
                surface[j] = up * max(up * height[j], up * surface[j])
            second, side_of_second = found, side
            n_others = _differ(normals[found], normals, faces, near, cosine, other)
            if n_others == 0:
                break
        # Too few for a quadric; and such are made in two and three dimensions alone.
        evidence[i] = -1.0
        if d > 3 or k <= d * (d + 1) // 2 + 1:
            continue
        best = half_bic(rounded / k, k, d + 1)
        quadric = _off_quadric(local, k, d, scale, limits, most, rows, equations)
        best = min(best, half_bic(quadric / k, k, d * (d + 1) // 2))
        # The axes in which the normals vary most.
        _, (least, middle, most_varied) = principal_axes(_squares_of(normals, faces, near, d), d)
        axes = (least, middle) if d == 2 else (middle, most_varied)
        arc = _off_arc(local, k, axes, scale, limits, most, rows)
        best = min(best, half_bic(arc / k, k, 3))
        evidence[i] = half_bic(squares / k, k, n_joined * d) - best


@kernel(fastmath=FASTMATH)
def _differ(normal, normals, faces, near, cosine, other):
    """Of the neighbors that are `other`, leave those on faces at an angle; their number."""
    n_others = 0
    for j in range(len(near)):
        differs = abs(_dot(normal, normals[faces.owners[near[j]]])) < cosine
        other[j] &= differs and faces.on_face[near[j]]
        n_others += 1 if other[j] else 0
    return n_others


@kernel(fastmath=FASTMATH)
def _dot(first, second):
    total = 0.0
    for axis in range(len(first)):
        total += first[axis] * second[axis]
    return total


@kernel(fastmath=FASTMATH)
def _heights(local, query, mean, planes, row, heights):
    """Fill the heights of members, whose mean is from the query, above a plane, in any dimension;
    that of the query."""
    normal, centroid, level, of_query = planes.normals[row], planes.centroids[row], 0.0, 0.0
    for axis in range(len(normal)):
        gap = query[axis] - centroid[axis]
        of_query += normal[axis] * gap
        level += normal[axis] * (gap + mean[axis])
    heights[:] = level
    for axis in range(len(normal)):
        share = normal[axis]
        for j in range(len(heights)):
            heights[j] += share * local[axis, j]
    return of_query


@kernel(fastmath=FASTMATH)
def _join(local, near, owners, query, planes, mean, allowed, most, surface, height):
    """The face that, joined to a surface in a crease, leaves the least squared residuals.

    Two planes that cross make four surfaces with a crease, each a half of one and a half of the
    other: the second plane either side up, the larger or the lesser of both heights.

    `surface` has the heights of neighbors above the surface so far. The planes of those `allowed`
    are joined, of which one for each plane stays. Squares count as `most` at most. Returns the row
    of the best plane, which of the four it is, and the sum of squares.
    """
    best, form, least = near[0], 0, np.inf
    size = len(near)
    for f in range(size):
        if not allowed[f]:
            continue
        owner = owners[near[f]]
        for j in range(f + 1, size):  # neighbors share planes
            allowed[j] &= owners[near[j]] != owner
        _heights(local, query, mean, planes, owner, height)
        up_over = up_under = down_over = down_under = 0.0
        for j in range(size):
            so_far, up = surface[j], height[j]
            over, under = max(up, so_far), min(up, so_far)
            up_over += min(over * over, most)
            up_under += min(under * under, most)
            over, under = max(-up, so_far), min(-up, so_far)
            down_over += min(over * over, most)
            down_under += min(under * under, most)
        sums = up_over, up_under, down_over, down_under
        for which in range(4):
            if sums[which] < least:
                best, form, least = owner, which, sums[which]
    return best, form, least


@kernel(fastmath=FASTMATH)
def _rounded(one, two, up, cosine, radii, spacing, most):
    """Least sum of squares, by heights, to two faces that an arc joins: the larger height, with
    `up`, or the lesser one."""
    least = np.inf
    scale = 1.0 / max(1.0 - cosine * cosine, EPS)
    for r in radii:
        radius, total = r * spacing, 0.0
        for j in range(len(one)):
            # From the axis, which is a radius below both planes.
            a, b = up * one[j] + radius, up * two[j] + radius
            away = np.sqrt(max(a * a + b * b - 2.0 * a * b * cosine, 0.0) * scale)
            off = (away if (a > b * cosine) & (b > a * cosine) else max(a, b)) - radius
            total += min(off * off, most)
        least = min(least, total)
    return least


@kernel(fastmath=False)
def _off_quadric(local, size, d, scale, limits, most, rows, equations):
    """Sum of squares of the best surface of second order."""
    heights, weight = rows[1], rows[2]
    for j in range(size):
        weight[j] = 1.0
    _, covariance = weighted_covariance(local, size, weight)
    _, axes = principal_axes(covariance, d)
    extent = max(np.sqrt(covariance[0] + covariance[3] + covariance[5]), TINY)
    squares = 0.0
    for _ in range(limits.smooth_steps):
        fit_quadric(local, size, d, axes, extent, weight, heights, equations)
        squares = 0.0
        for j in range(size):
            off = abs(heights[j]) * extent
            squares += min(off * off, most)
            # A few points off the surface must not bend it: Huber's weights.
            weight[j] = min(1.0, limits.huber * scale / off)
    return squares


@kernel(fastmath=FASTMATH)
def _squares_of(normals, faces, near, d):
    """Sums of products of the coordinates of the normals of the neighbors' planes."""
    xx = xy = xz = yy = yz = zz = 0.0
    for j in near:
        own = faces.owners[j]
        x, y, z = normals[own, 0], normals[own, 1], normals[own, 2] if d > 2 else 0.0
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    return xx, xy, xz, yy, yz, zz


@kernel(fastmath=False)
def _off_arc(local, size, axes, scale, limits, most, rows):
    """Sum of squares of a cylinder whose axis the normals tell: a circle of three numbers."""
    x, y, weight, terms = rows[0], rows[1], rows[2], rows[3:]
    value, first, second = terms[0], terms[1], terms[2]
    (ax, ay, az), (bx, by, bz) = axes
    total = 0.0
    for j in range(size):
        x[j] = ax * local[0, j] + ay * local[1, j] + az * local[2, j]
        y[j] = bx * local[0, j] + by * local[1, j] + bz * local[2, j]
        total += x[j] * x[j] + y[j] * y[j]
    extent = max(np.sqrt(total / size), TINY)
    for j in range(size):
        x[j], y[j] = x[j] / extent, y[j] / extent
        first[j], second[j], weight[j] = 2.0 * x[j], 2.0 * y[j], 1.0
        value[j] = x[j] * x[j] + y[j] * y[j]
    radius = cx = cy = squares = 0.0
    for step in range(limits.smooth_steps + 1):
        more, move, across = _regress(terms, size, weight)
        radius, cx, cy = radius + more, cx + move, cy + across
        if step == 0:
            radius = np.sqrt(max(radius + cx * cx + cy * cy, 0.0))
        squares = 0.0
        for j in range(size):
            u, v = x[j] - cx, y[j] - cy
            away = max(np.sqrt(u * u + v * v), EPS)
            first[j], second[j], value[j] = u / away, v / away, away - radius
            off = abs(value[j]) * extent
            squares += min(off * off, most)
            weight[j] = min(1.0, limits.huber * scale / off)
    return squares


@kernel(fastmath=False)
def _regress(terms, size, weight):
    """The constant, and the shares of two terms, that explain a value best."""
    (value, first, second), covariance = weighted_covariance(terms, size, weight)
    _, one, two, ff, fs, ss = covariance
    ridge = RIDGE * (ff + ss) + TINY
    ff, ss = ff + ridge, ss + ridge
    scale = 1.0 / max(ff * ss - fs * fs, TINY)
    share, other = scale * (one * ss - two * fs), scale * (two * ff - one * fs)
    return value - share * first - other * second, share, other


@kernel(cache=True)
def judge_distances(around, evidence, certain, told, distance):
    """Enlarge distances as `Creases._judge` says; `told` has room for what the neighbors say."""
    for i in range(len(distance)):
        n_told = 0
        for j in around.indices[i]:
            if np.isfinite(evidence[j]):  # in order, as the median is asked for
                place = n_told
                while place > 0 and told[place - 1] > evidence[j]:
                    told[place] = told[place - 1]
                    place -= 1
                told[place] = evidence[j]
                n_told += 1
        pooled = 0.5 * (told[(n_told - 1) // 2] + told[n_told // 2]) if n_told else np.inf
        distance[i] *= np.exp(min(max(pooled, 0.0), certain))
