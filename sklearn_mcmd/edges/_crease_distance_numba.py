"""Distances to creases and the evidence for them, compiled; see ``_crease_distance``.

Numba lets a function without `fastmath` inherit it from the caller for which it is first compiled.
So what solves equations is called by functions that say ``fastmath=False``.
"""

import numpy as np

from sklearn_mcmd.planes._creases_numba import RIDGE, center, fit_quadric, half_bic
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
def meet_faces(
    points, queries, around, planes, spacings, owners, faces, limits, work, distance, evidence
):
    """Fill distance and evidence of queries as `MeetingPlanes._meet` says.

    Faces and spacings are those of all points, `owners` the rows of the queries' planes.
    """
    creases, cosine, explained = limits
    normals = planes.normals
    local, rows, mean, differs = work.local, work.rows, work.mean, work.differs
    surface = rows[3]
    k, d = around.indices.shape[1], queries.shape[1]
    for i in range(len(queries)):
        # Step 1: neighbors on faces that meet the query's at an angle. A face has as many points as
        # determine a plane.
        near, owner = around.indices[i], owners[i]
        scale, spacing = planes.scale[owner], spacings[near[0]]
        differs[:] = True
        n_differing = _differ(normals[owner], normals, faces, near, cosine, differs)
        if n_differing < d or not spacing > 0.0:
            continue
        # Step 2: heights above the query's plane. What is off it counts as farther from the crease.
        localize(points, near, k, queries[i], local)
        center(local, k, d, mean)
        most = (explained * scale) ** 2
        to_query = _heights(local, queries[i], mean, planes, owner, rows[0])
        off = max(abs(to_query) / (explained * scale), 1.0)
        for j in range(k):
            surface[j] = rows[0, j]
        # Step 3: join one face in a crease, and one more if that pays by BIC.
        squares = rounded = np.inf
        n_joined, second, side_of_second = 0, owner, 1.0
        for turn in range(2):
            height = rows[turn + 1]
            joined, form, left = _join(
                local, near, faces.owners, queries[i], planes, mean, differs, most, surface, height
            )
            to_query = _heights(local, queries[i], mean, planes, joined, height)
            # Of the four forms of `_join` the last two turn the plane over, and odd ones take the
            # lesser of both heights.
            side, up = 1.0 if form < 2 else -1.0, 1.0 if form % 2 == 0 else -1.0
            for j in range(k):
                height[j] *= side
            # An arc may join any two of the faces.
            cosine_of_joined = _dot(normals[owner], normals[joined])
            arc = _rounded(
                rows[0], height, up, side * cosine_of_joined, creases.radii, spacing, most
            )
            rounded = min(rounded, arc)
            if turn:
                turned = side * side_of_second * _dot(normals[second], normals[joined])
                arc = _rounded(rows[1], height, up, turned, creases.radii, spacing, most)
                rounded = min(rounded, arc)
            # By BIC: a plane has d numbers, and k log(squares) must fall by d log(k).
            if turn and not left < k ** (-d / k) * squares:
                break
            n_joined, squares = n_joined + 1, left
            # A point at a height h above a plane that meets its own at an angle is h / sin(angle)
            # from the line.
            sine = np.sqrt(max(1.0 - cosine_of_joined * cosine_of_joined, TINY))
            distance[i] = min(distance[i], abs(to_query) / sine * off / spacing)
            for j in range(k):
                surface[j] = up * max(up * height[j], up * surface[j])
            second, side_of_second = joined, side
            n_differing = _differ(normals[joined], normals, faces, near, cosine, differs)
            if n_differing == 0:
                break
        # Step 4: the best surface without a crease. Too few points leave a quadric nothing to be
        # judged by; and such are made in two and three dimensions alone.
        evidence[i] = -1.0
        if d > 3 or k <= d * (d + 1) // 2 + 1:
            continue
        best = half_bic(rounded / k, k, d + 1)  # a plane and a radius
        quadric = _off_quadric(local, k, d, scale, creases, most, rows, work.equations)
        best = min(best, half_bic(quadric / k, k, d * (d + 1) // 2))
        # The axes in which the normals vary most: across them a cylinder is a circle.
        _, (least, middle, most_varied) = principal_axes(_squares_of(normals, faces, near, d), d)
        axes = (least, middle) if d == 2 else (middle, most_varied)
        arc = _off_arc(local, k, axes, scale, creases, most, rows)
        best = min(best, half_bic(arc / k, k, 3))  # center and radius
        evidence[i] = half_bic(squares / k, k, n_joined * d) - best


@kernel(fastmath=FASTMATH)
def _differ(normal, normals, faces, near, cosine, differs):
    """Of the neighbors that differ so far, leave those on faces at an angle; their number."""
    n_differing = 0
    for j in range(len(near)):
        meets = abs(_dot(normal, normals[faces.owners[near[j]]])) < cosine
        differs[j] &= meets and faces.on_face[near[j]]
        n_differing += 1 if differs[j] else 0
    return n_differing


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
            # From the axis, which is a radius below both planes. Heights a and b over two lines
            # that cross at an angle are sqrt(a^2 + b^2 - 2 a b cos) / sin from the crossing. The
            # arc ends where the foot on either plane does.
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
        row = faces.owners[j]
        x, y, z = normals[row, 0], normals[row, 1], normals[row, 2] if d > 2 else 0.0
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
    # Step 0 fits the algebraic circle, x^2 + y^2 = 2 x cx + 2 y cy + (r^2 - cx^2 - cy^2), the
    # others are Gauss-Newton steps of the distances from it.
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
    # Cramer's rule for the covariances of both terms.
    of_first, of_second = scale * (one * ss - two * fs), scale * (two * ff - one * fs)
    return value - of_first * first - of_second * second, of_first, of_second


@kernel(cache=True)
def judge_distances(around, evidence, certain, told, distance):
    """Enlarge distances as `MeetingPlanes._judge` says; `told` has room for what the neighbors say.

    The median of the neighbors' evidence is the logarithm of how much better a surface without a
    crease is. Where it is, distances grow by that factor.
    """
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
