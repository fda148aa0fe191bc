"""Arithmetic of planes in three dimensions, compiled: moments, decomposition, selection.

Quantiles and extents of neighborhoods are those of any dimension.
"""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

# No "nnan" or "ninf": a lane without a plane may hold NaN or infinity.
FASTMATH = {"reassoc", "contract", "nsz", "arcp"}


@kernel(fastmath=FASTMATH)
def weighted_covariance(local, size, weight):
    """Mean and covariance (divisor: sum of weights) of the weighted members."""
    x, y, z = local[0], local[1], local[2]
    total = mx = my = mz = 0.0
    for j in range(size):
        w = weight[j]
        total += w
        mx += w * x[j]
        my += w * y[j]
        mz += w * z[j]
    scale = 1.0 / max(total, 1.0)
    mx, my, mz = mx * scale, my * scale, mz * scale
    xx = xy = xz = yy = yz = zz = 0.0
    for j in range(size):
        w = weight[j]
        dx, dy, dz = x[j] - mx, y[j] - my, z[j] - mz
        xx += w * dx * dx
        xy += w * dx * dy
        xz += w * dx * dz
        yy += w * dy * dy
        yz += w * dy * dz
        zz += w * dz * dz
    covariance = (xx * scale, xy * scale, xz * scale, yy * scale, yz * scale, zz * scale)
    return (mx, my, mz), covariance


@kernel(fastmath=FASTMATH)
def variance_along(local, size, weight, mean, axis):
    """Variance of the weighted members along an axis."""
    x, y, z = local[0], local[1], local[2]
    ax, ay, az = axis
    mx, my, mz = mean
    total = variance = 0.0
    for j in range(size):
        distance = ax * (x[j] - mx) + ay * (y[j] - my) + az * (z[j] - mz)
        total += weight[j]
        variance += weight[j] * distance * distance
    return variance / max(total, 1.0)


@kernel
def eigh_3d(covariance):
    """Eigenvalues, ascending, and unit eigenvectors of a covariance matrix of order 3.

    It makes Jacobi's rotations, on numbers and not on arrays. They are accurate for the least
    eigenvalue of a nearly flat neighborhood, where closed formulas lose digits. The eigenvalues are
    a tuple of 3, and the eigenvectors, in the same order, 3 tuples of 3.
    """
    xx, xy, xz, yy, yz, zz = covariance
    ax, ay, az = 1.0, 0.0, 0.0
    bx, by, bz = 0.0, 1.0, 0.0
    cx, cy, cz = 0.0, 0.0, 1.0
    trace = xx + yy + zz
    inverse = 1.0 / trace if trace > 0.0 else 0.0
    for _ in range(30):
        # As shares of the trace, whose squares neither overflow nor vanish in any unit.
        p, q, r = xy * inverse, xz * inverse, yz * inverse
        u, v, w = xx * inverse, yy * inverse, zz * inverse
        if p * p + q * q + r * r <= 1e-34 * (u * u + v * v + w * w):
            break
        cosine, sine, move = _rotation(xx, yy, xy)
        xx, yy, xy = xx - move, yy + move, 0.0
        xz, yz = cosine * xz - sine * yz, sine * xz + cosine * yz
        ax, bx = cosine * ax - sine * bx, sine * ax + cosine * bx
        ay, by = cosine * ay - sine * by, sine * ay + cosine * by
        az, bz = cosine * az - sine * bz, sine * az + cosine * bz

        cosine, sine, move = _rotation(xx, zz, xz)
        xx, zz, xz = xx - move, zz + move, 0.0
        xy, yz = cosine * xy - sine * yz, sine * xy + cosine * yz
        ax, cx = cosine * ax - sine * cx, sine * ax + cosine * cx
        ay, cy = cosine * ay - sine * cy, sine * ay + cosine * cy
        az, cz = cosine * az - sine * cz, sine * az + cosine * cz

        cosine, sine, move = _rotation(yy, zz, yz)
        yy, zz, yz = yy - move, zz + move, 0.0
        xy, xz = cosine * xy - sine * xz, sine * xy + cosine * xz
        bx, cx = cosine * bx - sine * cx, sine * bx + cosine * cx
        by, cy = cosine * by - sine * cy, sine * by + cosine * cy
        bz, cz = cosine * bz - sine * cz, sine * bz + cosine * cz
    first, second, third = (xx, (ax, ay, az)), (yy, (bx, by, bz)), (zz, (cx, cy, cz))
    if second[0] < first[0]:
        first, second = second, first
    if third[0] < second[0]:
        second, third = third, second
        if second[0] < first[0]:
            first, second = second, first
    values = (max(first[0], 0.0), max(second[0], 0.0), max(third[0], 0.0))
    return values, (first[1], second[1], third[1])


@kernel
def principal_axes(covariance, d):
    """As `eigh_3d`. In 2D the third coordinate is zero, and its axis comes last."""
    xx, xy, xz, yy, yz, zz = covariance
    if d == 2:
        zz = 2.0 * (xx + yy)
    return eigh_3d((xx, xy, xz, yy, yz, zz))


@kernel
def _rotation(p, q, off):
    """Cosine, sine and change of the diagonal that make the entry `off` between p and q zero."""
    if off == 0.0:
        return 1.0, 0.0, 0.0
    theta = (q - p) / (2.0 * off)
    tangent = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
    if theta < 0.0:
        tangent = -tangent
    cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
    return cosine, tangent * cosine, tangent * off


@kernel
def kth_smallest(keys, size, rank):
    """The rank-th smallest (from 1) of the first `size` integers, by counting.

    Each pass counts the keys up to a guess, until the rank-th is next to it. The ends of the
    bracket are keys, so the loop always ends, also with ties.
    """
    low = high = keys[0]
    for j in range(size):
        low = min(low, keys[j])
        high = max(high, keys[j])
    n_below, n_high = 0, size  # keys < low, keys <= high
    turn = 0
    while low < high:
        turn += 1
        if low < 0 <= high:
            guess = np.int64(-1)  # the difference of the ends might not fit
        elif turn % 3 == 0:
            guess = low + (high - low) // 2
        else:
            share = (rank - n_below - 0.5) / (n_high - n_below)
            guess = low + np.int64(share * np.float64(high - low))
        guess = min(max(guess, low), high - 1)
        count = 0
        inner, outer = low, high  # the largest key <= guess, the smallest > guess
        for j in range(size):
            key = keys[j]
            inside = key <= guess
            count += 1 if inside else 0
            inner = max(inner, key) if inside else inner
            outer = outer if inside else min(outer, key)
        if count == rank:
            return inner
        if count == rank - 1:
            return outer
        if count > rank:
            high, n_high = inner, count
        else:
            low, n_below = outer, count
    return low


@kernel(cache=True)
def quantile_of_neighbors(all_values, neighborhoods, q, values, keys, out):
    """Fill `out` with the q-quantile of the neighbors' values; `keys` are the bits of `values`."""
    indices, sizes = neighborhoods.indices, neighborhoods.sizes
    for i in range(len(out)):
        for j in range(sizes[i]):
            values[j] = all_values[indices[i, j]]
        # The rank int(q * size), from 0, of numbers that sort like their bits.
        keys[0] = kth_smallest(keys, sizes[i], np.int64(q * sizes[i]) + 1)
        out[i] = values[0]


@kernel(cache=True)
def extents_of_neighborhoods(points, queries, neighborhoods, spacing, radius):
    """Fill the mean distance of the neighbors and the distance of the last one."""
    indices, sizes = neighborhoods.indices, neighborhoods.sizes
    for i in range(len(queries)):
        total = last = 0.0
        for j in range(sizes[i]):
            square = 0.0
            for axis in range(queries.shape[1]):
                gap = points[indices[i, j], axis] - queries[i, axis]
                square += gap * gap
            total += np.sqrt(square)
            last = max(last, square)
        spacing[i], radius[i] = total / sizes[i], np.sqrt(last)
