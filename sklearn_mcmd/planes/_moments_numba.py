"""Arithmetic of planes in three dimensions, compiled: moments, decomposition, selection.

Quantiles and radii of neighborhoods are those of any dimension.
"""

import numpy as np

from sklearn_mcmd.runtime._kernels import kernel

# No "nnan" or "ninf": a lane without a plane may hold NaN or infinity.
FASTMATH = {"reassoc", "contract", "nsz", "arcp"}
UPRIGHT = 2.0  # variance of the axis that comes last in 2D, as a share of all others
ROUNDED = 2.0**-106  # the square of what rounding leaves of numbers about 1


@kernel
def vector(values):
    """Coordinates as numbers; in 2D the third is zero."""
    return values[0], values[1], values[2] if len(values) > 2 else 0.0


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

    Jacobi's rotations, on numbers and not on arrays, are accurate for the least eigenvalue of a
    nearly flat neighborhood, where closed formulas lose digits. They begin at the axis that inverse
    iteration finds, so that mostly one or two are left to make. The eigenvalues are a tuple of 3,
    and the eigenvectors, in the same order, 3 tuples of 3.
    """
    trace = covariance[0] + covariance[3] + covariance[5]
    inverse = 1.0 / trace if trace > 0.0 else 0.0
    xx, xy, xz, yy, yz, zz = covariance
    # As shares of the trace, whose squares neither overflow nor vanish in any unit.
    shares = xx * inverse, xy * inverse, xz * inverse, yy * inverse, yz * inverse, zz * inverse
    a = _least_axis(shares)
    b, c = _complement(a)
    along_a, along_b, along_c = _times(shares, a), _times(shares, b), _times(shares, c)
    aa, ab, ac = dot(a, along_a), dot(b, along_a), dot(c, along_a)
    bb, bc, cc = dot(b, along_b), dot(c, along_b), dot(c, along_c)
    for _ in range(30):
        if ab * ab + ac * ac + bc * bc <= ROUNDED:
            break
        cosine, sine, move = _rotation(bb, cc, bc)
        bb, cc, bc = bb - move, cc + move, 0.0
        ab, ac = cosine * ab - sine * ac, sine * ab + cosine * ac
        b, c = _turned(b, c, cosine, sine)
        if ab * ab + ac * ac <= ROUNDED:
            break
        cosine, sine, move = _rotation(aa, bb, ab)
        aa, bb, ab = aa - move, bb + move, 0.0
        ac, bc = cosine * ac - sine * bc, sine * ac + cosine * bc
        a, b = _turned(a, b, cosine, sine)

        cosine, sine, move = _rotation(aa, cc, ac)
        aa, cc, ac = aa - move, cc + move, 0.0
        ab, bc = cosine * ab - sine * bc, sine * ab + cosine * bc
        a, c = _turned(a, c, cosine, sine)
    first, second, third = (aa, a), (bb, b), (cc, c)
    if second[0] < first[0]:
        first, second = second, first
    if third[0] < second[0]:
        second, third = third, second
        if second[0] < first[0]:
            first, second = second, first
    least, middle, most = max(first[0], 0.0), max(second[0], 0.0), max(third[0], 0.0)
    return (least * trace, middle * trace, most * trace), (first[1], second[1], third[1])


@kernel
def _least_axis(matrix):
    """About the eigenvector of the least eigenvalue, by inverse iteration with Rayleigh's shifts;
    any axis where rounding leaves none, as for points in a row."""
    xx, xy, xz, yy, yz, zz = matrix
    axis, shift = (0.0, 0.0, 1.0), 0.0
    for _ in range(3):  # each triples the digits, and the first has some where a cloud is flat
        x, y, z = xx - shift, yy - shift, zz - shift
        # The adjugate matrix, whose columns are all near the eigenvector: the longest is taken.
        ux, uy, uz = y * z - yz * yz, xz * yz - xy * z, xy * yz - y * xz
        vy, vz, wz = x * z - xz * xz, xy * xz - x * yz, x * y - xy * xy
        column = ux, uy, uz
        if abs(vy) > abs(ux) and abs(vy) > abs(wz):
            column = uy, vy, vz
        elif abs(wz) > abs(ux):
            column = uz, vz, wz
        square = dot(column, column)
        if not square > ROUNDED * ROUNDED:
            break
        scale = 1.0 / np.sqrt(square)
        axis = column[0] * scale, column[1] * scale, column[2] * scale
        shift = dot(axis, _times(matrix, axis))
    return axis


@kernel
def _complement(axis):
    """Two axes at right angles to a unit vector and to each other."""
    x, y, z = axis
    side = np.copysign(1.0, z)
    share = -1.0 / (side + z)  # never of a small number, as `side` has the sign of z
    return (
        (1.0 + side * share * x * x, side * share * x * y, -side * x),
        (share * x * y, side + share * y * y, -y),
    )


@kernel
def _times(matrix, vector):
    xx, xy, xz, yy, yz, zz = matrix
    x, y, z = vector
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _turned(a, b, cosine, sine):
    return (
        (cosine * a[0] - sine * b[0], cosine * a[1] - sine * b[1], cosine * a[2] - sine * b[2]),
        (sine * a[0] + cosine * b[0], sine * a[1] + cosine * b[1], sine * a[2] + cosine * b[2]),
    )


@kernel
def principal_axes(covariance, d):
    """As `eigh_3d`. In 2D the third coordinate is zero, and its axis comes last."""
    xx, xy, xz, yy, yz, zz = covariance
    if d == 2:
        zz = UPRIGHT * (xx + yy)
    return eigh_3d((xx, xy, xz, yy, yz, zz))


@kernel
def _rotation(p, q, off):
    """Cosine, sine and change of the diagonal that make the entry `off` between p and q zero."""
    if off == 0.0:
        return 1.0, 0.0, 0.0
    # The smaller root of t^2 + 2 theta t - 1, so that no axis turns by more than 45 degrees.
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
        elif turn % 3 == 0:  # by halves, whatever the keys are
            guess = low + (high - low) // 2
        else:  # as if they were spread evenly
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
def farthest_of_neighborhoods(points, queries, neighborhoods, radius):
    """Fill the distance of the last neighbor."""
    indices, sizes = neighborhoods.indices, neighborhoods.sizes
    for i in range(len(queries)):
        last = 0.0
        for j in range(sizes[i]):
            square = 0.0
            for axis in range(queries.shape[1]):
                gap = points[indices[i, j], axis] - queries[i, axis]
                square += gap * gap
            last = max(last, square)
        radius[i] = np.sqrt(last)
