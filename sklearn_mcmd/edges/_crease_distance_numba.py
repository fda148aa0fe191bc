"""Distances to creases and the evidence for them, compiled; see ``_crease_distance``.

Numba lets a function without `fastmath` inherit it from the caller for which it is first compiled.
So what solves equations is called by functions that say ``fastmath=False``.
"""

import numpy as np

from sklearn_mcmd.planes._creases_numba import (
    N_PLANE,
    center,
    fit_quadric,
    fit_surface,
    half_bic,
)
from sklearn_mcmd.planes._moments_numba import FASTMATH, principal_axes, weighted_covariance
from sklearn_mcmd.planes._quadrics_numba import TINY, localize
from sklearn_mcmd.runtime._kernels import kernel

EPS = np.finfo(np.float64).eps  # least sine squared of two faces, and radius of an arc
N_AXES = np.int64(3)  # what takes plain numbers is compiled for each
AXES = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)  # those of the coordinates


@kernel(cache=True)
def meet_faces(points, queries, origin, around, own, faces, told, room, distance, evidence):
    """Fill distance and evidence of queries as `Creases._meet` returns them."""
    limits, cosine, explained = told
    normals, levels, on_face = faces
    local, rows, mean, other, equations = room
    surface = rows[3]
    k, d = around.indices.shape[1], queries.shape[1]
    for i in range(len(queries)):
        distance[i], evidence[i] = np.inf, np.nan
        near, normal, level = around.indices[i], own.normals[i], own.levels[i]
        scale, spacing = own.scale[i], own.spacing[i]
        other[:] = True
        # A face has as many points as determine a plane.
        n_others = _differ(normal, normals, on_face, near, cosine, other)
        if n_others < d or not (own.flat[i] and spacing > 0.0):
            continue
        localize(points, near, k, origin, local)
        center(local, k, d, mean)
        most = (explained * scale) ** 2
        _heights(local, k, normal, level - _dot(normal, mean), rows[0])
        for j in range(k):
            surface[j] = rows[0, j]
        squares = rounded = np.inf
        n_joined = 0
        for turn in range(2):
            last, height = rows[turn], rows[turn + 1]
            place, form, left = _join(
                local, near, normals, levels, mean, other, most, surface, height
            )
            # By BIC: a plane has d numbers.
            if turn and not left < k ** (-d / k) * squares:
                break
            n_joined, squares, before = n_joined + 1, left, normal
            normal, level = normals[near[place]], levels[near[place]]
            off = _to_line(queries[i], origin, own.normals[i], normal, level) / spacing
            distance[i] = min(distance[i], off)
            _heights(local, k, normal, level - _dot(normal, mean), height)
            turned = _dot(before, normal)
            least = _rounded(last, height, turned, limits.radii, spacing, most, k)
            rounded = min(rounded, least)
            _join_one(surface, height, form)
            _differ(normal, normals, on_face, near, cosine, other)
        # Too few for a quadric; and such are made in two and three dimensions alone.
        evidence[i] = -1.0
        if d > 3 or k <= d * (d + 1) // 2 + 1:
            continue
        best = half_bic(rounded / k, k, d + 1)
        quadric = _off_quadric(local, k, d, scale, limits, most, rows, equations)
        best = min(best, half_bic(quadric / k, k, d * (d + 1) // 2))
        # The axes in which the normals vary most.
        _, (least, middle, most_varied) = principal_axes(_squares_of(normals, near, d), d)
        axes = (least, middle) if d == 2 else (middle, most_varied)
        arc = _off_arc(local, k, axes, scale, limits, most, rows, equations)
        best = min(best, half_bic(arc / k, k, 3))
        evidence[i] = half_bic(squares / k, k, n_joined * d) - best


@kernel(fastmath=FASTMATH)
def _differ(normal, normals, on_face, near, cosine, other):
    """Of the neighbors that are `other`, leave those on faces at an angle; their number."""
    n_others = 0
    for j in range(len(near)):
        differs = abs(_dot(normal, normals[near[j]])) < cosine
        other[j] &= differs and on_face[near[j]]
        n_others += 1 if other[j] else 0
    return n_others


@kernel(fastmath=FASTMATH)
def _dot(first, second):
    total = 0.0
    for axis in range(len(first)):
        total += first[axis] * second[axis]
    return total


@kernel(fastmath=FASTMATH)
def _heights(local, size, normal, level, heights):
    """Fill the heights of members above a plane, in any dimension."""
    for j in range(size):
        heights[j] = normal[0] * local[0, j] - level
    for axis in range(1, len(normal)):
        share = normal[axis]
        for j in range(size):
            heights[j] += share * local[axis, j]


@kernel(fastmath=FASTMATH)
def _join(local, near, normals, levels, mean, allowed, most, surface, height):
    """The face that, joined to a surface in a crease, leaves the least squared residuals.

    Two planes that cross make four surfaces with a crease, each a half of one and a half of the
    other: the second plane either side up, the larger or the lesser of both heights.

    `surface` has the heights of neighbors above the surface so far. The planes of those `allowed`
    are joined. Squares count as `most` at most. Returns the position of the best neighbor, which of
    the four it is, and the sum of squares.
    """
    place, form, least = 0, 0, np.inf
    size = len(near)
    for f in range(size):
        if not allowed[f]:
            continue
        normal = normals[near[f]]
        _heights(local, size, normal, levels[near[f]] - _dot(normal, mean), height)
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
                place, form, least = f, which, sums[which]
    return place, form, least


@kernel
def _join_one(surface, height, form):
    """Join a plane to the heights above a surface, in one of the four ways."""
    for j in range(len(surface)):
        other = height[j] if form < 2 else -height[j]
        surface[j] = max(other, surface[j]) if form % 2 == 0 else min(other, surface[j])


@kernel(fastmath=FASTMATH)
def _to_line(query, origin, normal, other, level):
    """Distance, along the own plane, to the line where it meets another one."""
    height = -level
    for axis in range(len(query)):
        height += other[axis] * (query[axis] - origin[axis])
    cosine = _dot(normal, other)
    return abs(height) / np.sqrt(max(1.0 - cosine * cosine, TINY))


@kernel(fastmath=FASTMATH)
def _rounded(one, two, cosine, radii, spacing, most, size):
    """Least sum of squares, by heights, to two faces that an arc joins in each way."""
    least = np.inf
    scale = 1.0 / max(1.0 - cosine * cosine, EPS)
    for up, side in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)):
        c = side * cosine
        for r in radii:
            radius, total = r * spacing, 0.0
            for j in range(size):
                # From the axis, which is a radius below both planes.
                a, b = up * one[j] + radius, up * side * two[j] + radius
                away = np.sqrt(max(a * a + b * b - 2.0 * a * b * c, 0.0) * scale)
                off = (away if (a > b * c) & (b > a * c) else max(a, b)) - radius
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
def _squares_of(normals, near, d):
    """Sums of products of the coordinates of the neighbors' normals."""
    xx = xy = xz = yy = yz = zz = 0.0
    for j in near:
        x, y, z = normals[j, 0], normals[j, 1], normals[j, 2] if d > 2 else 0.0
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    return xx, xy, xz, yy, yz, zz


@kernel(fastmath=False)
def _off_arc(local, size, axes, scale, limits, most, rows, equations):
    """Sum of squares of a cylinder whose axis the normals tell: a circle of three numbers."""
    x, y, weight, heights, solution = rows[0], rows[1], rows[2], rows[3], equations[2]
    terms = rows[4:]
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
        fit_surface(terms, size, N_AXES, AXES, 1.0, weight, N_PLANE, heights, equations)
        radius, cx, cy = radius + solution[0], cx + solution[1], cy + solution[2]
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


@kernel(cache=True)
def judge_distances(points, around, evidence, faces, limits, told, distance):
    """Change distances as `Creases._judge` does; `told` has room for what the neighbors say."""
    far, certain, explained = limits
    for i in range(len(distance)):
        near, n_told = around.indices[i], 0
        for j in near:
            if np.isfinite(evidence[j]):  # in order, as the median is asked for
                place = n_told
                while place > 0 and told[place - 1] > evidence[j]:
                    told[place] = told[place - 1]
                    place -= 1
                told[place] = evidence[j]
                n_told += 1
        most = far * (2.0 - _off_face(points, near, faces.normals[i]))
        if n_told > 0 and distance[i] < np.inf:
            pooled = 0.5 * (told[(n_told - 1) // 2] + told[n_told // 2])
            off = max(abs(faces.height[i]) / (explained * faces.scale[i]), 1.0)
            most = min(distance[i] * np.exp(min(max(pooled, 0.0), certain)) * off, most)
        distance[i] = most


@kernel
def _off_face(points, near, normal):
    """The neighbors' variance across a face over that of a ball: from 0 on the face to 1 in a ball,
    or where the face runs across them."""
    d, k = len(normal), len(near)
    total = height = along = 0.0
    for axis in range(d):
        mean = square = 0.0
        for j in near:
            gap = points[j, axis] - points[near[0], axis]
            mean += gap / k
            square += gap * gap
        total += square - k * mean * mean
        height += normal[axis] * mean
    for j in near:
        gap = -height
        for axis in range(d):
            gap += normal[axis] * (points[j, axis] - points[near[0], axis])
        along += gap * gap
    return min(d * along / max(total, TINY), 1.0)
