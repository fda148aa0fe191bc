"""Algorithm 1 in 2D and 3D, compiled: the same answers as ``_consistent_set``, faster.

In 2D the third coordinate is zero, and planes are upright ones.

All trials of one neighborhood advance together, one trial in each vector lane. A screening in
float32 gives each trial a lower bound of its least eigenvalue. Float64 then decides among
the few trials whose bound does not exceed the best value found, in ascending order. So the
set is the one that float64 alone would find, in the time of float32.

Lanes are the columns of C-contiguous arrays. Their number is a multiple of those of a vector.
"""

from typing import NamedTuple

import numpy as np

from sklearn_mcmd.planes._moments_numba import (
    FASTMATH,
    kth_smallest,
    principal_axes,
    variance_along,
    weighted_covariance,
)
from sklearn_mcmd.planes._vectors_numba import add, load, multiply_add, spread, store, where_below
from sklearn_mcmd.runtime._kernels import kernel

LINE = 16  # float32 lanes of a vector, which fill a cache line; twice as many of int16
FEATURES = 9  # x, y, z, xx, xy, xz, yy, yz, zz
# A level is a float32 number without its last bits: 512 levels to each power of two.
SHIFT = 14
STEPS = 13  # of the bisection of levels
MOST_LEVEL = 2**STEPS - 1  # the largest level
F0, F1, F2, I0, I1 = np.float32(0), np.float32(1), np.float32(2), np.int16(0), np.int16(1)
TINY = np.float32(1e-30)  # least divisor
ZEROS = 0.0, 0.0, 0.0  # of the types of a mean, of eigenvalues and of an axis
NO_FIT = ZEROS, ZEROS, (ZEROS, ZEROS, ZEROS)
SLACK = np.float32(1.001)  # for rounding of the sum
# Beyond this number of median radii float32 rounds too coarsely for a bound. Then float64 decides
# all trials.
FAR = 100.0
# Error of a distance in float32, as a share of the farthest coordinate: 14 roundings of 2**-24.
ROUNDING = 1e-6
MOST_ROWS = 2**15 - 1  # that int16 counts
# Errors that the screening's least eigenvalue may have: rounding of the moments,
SCREEN_RTOL = np.float32(1e-3)
# and a few float32 steps of the trace and of the determinant, more in flat and long neighborhoods.
SCREEN_STEP = np.float32(1e-6)
LEAST_MINORS = np.float32(1e-4)  # squared ratio of width to length below which all is rounding


class WorkArrays(NamedTuple):
    """Arrays that one thread needs for neighborhoods of k members; all neighborhoods share them.

    Python makes them, some as two types, since Numba takes long to compile what does.
    """

    local: np.ndarray  # float64 (3, k), coordinates
    rotated: np.ndarray  # float64 (3, k), coordinates in other axes
    local32: np.ndarray  # float32 (k, FEATURES), members and their products
    lanes: np.ndarray  # float64 (13, lanes), planes, and the corners of minimal subsets
    lanes32: np.ndarray  # float32 (21 + k, lanes)
    lane_bits: np.ndarray  # the same as int32
    levels: np.ndarray  # int16 (k + 2, wide lanes), and a row that pads and the limits
    least: np.ndarray  # float64 (n_trials,)
    keys: np.ndarray  # int64 (k,)
    key_numbers: np.ndarray  # the same as float64
    member: np.ndarray  # float64 (k,)
    numbers: np.ndarray  # float64 (k,), to sort
    bits: np.ndarray  # the same as int64
    query: np.ndarray  # float64 (3,)

    @classmethod
    def of(cls, n_trials, k):
        """float32 arrays begin on a cache line: vector loads across two take twice as long."""
        n_lanes = -(-n_trials // LINE) * LINE
        n_wide = -(-n_trials // (2 * LINE)) * 2 * LINE
        size = (21 + k) * n_lanes
        buffer = np.zeros(size + LINE, dtype=np.float32)
        start = -buffer.ctypes.data % (4 * LINE) // 4
        lanes32 = buffer[start : start + size].reshape(21 + k, n_lanes)
        keys, numbers = np.zeros(k, dtype=np.int64), np.zeros(k)
        return cls(
            local=np.zeros((3, k)),
            rotated=np.zeros((3, k)),
            local32=np.zeros((k, FEATURES), dtype=np.float32),
            lanes=np.zeros((4 + 9, n_lanes)),
            lanes32=lanes32,
            lane_bits=lanes32.view(np.int32),
            levels=np.zeros((k + 2, n_wide), dtype=np.int16),
            least=np.zeros(n_trials),
            keys=keys,
            key_numbers=keys.view(np.float64),
            member=np.zeros(k),
            numbers=numbers,
            bits=numbers.view(np.int64),
            query=np.zeros(3),
        )


@kernel
def consistent_set(size, trials, arrays):
    """Maximum consistent set of one neighborhood (Algorithm 1).

    The `WorkArrays` have the coordinates, by `localize`, of the `size` members in use as `local`;
    their `member` receives 1 for members of the set and 0 for the others. Returns the least
    eigenvalue of the set, in squared radii, and its mean, eigenvalues and axes. Where no set spans
    a plane, the eigenvalue is negative and the others have no meaning.
    """
    local, member, least, lanes32 = arrays.local, arrays.member, arrays.least, arrays.lanes32
    rotated, local32, lanes, bits = arrays.rotated, arrays.local32, arrays.lanes, arrays.lane_bits
    levels, keys, key_numbers = arrays.levels, arrays.keys, arrays.key_numbers
    n_trials = trials.positions.shape[0]
    n_support = trials.n_support[size]
    farthest = 0.0
    for axis in range(3):
        for j in range(size):
            local32[j, axis] = np.float32(local[axis, j])
            farthest = max(farthest, abs(local[axis, j]))
    # Steps 1 and 2: a plane through each minimal subset.
    first_plane = _trial_planes(local, size, trials, lanes, rotated, member)
    if first_plane < 0:
        return _first_members(size, n_support, member), NO_FIT
    # Lanes without a plane, and lanes that pad the vectors, repeat the first plane.
    for s in range(lanes.shape[1]):
        if s >= n_trials or lanes[3, s] == np.inf:
            for axis in range(4):
                lanes[axis, s] = lanes[axis, first_plane]
    # Steps 2 and 3 in float32: what the least eigenvalue of each trial is not below.
    bound = lanes32[20]
    if farthest <= FAR and size <= MOST_ROWS:
        rounding, upright = ROUNDING * farthest, F2 if trials.d == 2 else F0
        _screen(local32, size, n_support, lanes, lanes32, bits, levels, rounding, upright)
    else:
        bound[:] = F0

    # Step 4 in float64: from the least bound on, until all others are above the best.
    best, fit, selected, fitted = np.inf, NO_FIT, np.int64(-1), np.int64(-1)
    for s in range(n_trials):
        least[s] = np.inf
    for _ in range(n_trials):
        t, lowest = np.int64(0), bound[0]  # with a plain 0, `_select_members` is compiled twice
        for s in range(1, n_trials):
            if bound[s] < lowest:
                t, lowest = np.int64(s), bound[s]
        if lowest > best + trials.eigenvalue_step:
            break
        bound[t] = np.inf
        _select_members(local, size, trials, lanes, t, keys, key_numbers, member)
        selected = t
        least[t], its_fit = _least_eigenvalue(local, size, member, trials)
        if least[t] < best:
            best, fitted, fit = least[t], t, its_fit
    if best == np.inf:
        return _first_members(size, n_support, member), NO_FIT
    # Of trials that are equal but for rounding the first is taken.
    first = 0
    while least[first] > best + trials.eigenvalue_step:
        first += 1
    if first != selected:
        _select_members(local, size, trials, lanes, first, keys, key_numbers, member)
    if first != fitted:
        _, fit = _least_eigenvalue(local, size, member, trials)
    return least[first], fit


@kernel
def _first_members(size, n_support, member):
    for j in range(size):
        member[j] = 1.0 if j < n_support else 0.0
    return -1.0


@kernel
def _trial_planes(local, size, trials, lanes, rotated, member):
    """Planes of all trials (steps 1 and 2) into lanes; an infinite offset where there is none.

    Returns the first trial that has a plane, -1 if none has.
    """
    n_trials = trials.positions.shape[0]
    for t in range(n_trials):
        row = trials.positions[t]
        p = 0
        for corner in range(trials.d):  # the first positions inside the neighborhood
            while row[p] >= size:
                p += 1
            place = np.uintp(row[p])  # which is not asked whether it counts from the end
            for axis in range(3):
                lanes[4 + 3 * corner + axis, t] = local[axis, place]
            p += 1
        if trials.d == 2:  # a third corner above the first makes the plane upright
            length = abs(lanes[7, t] - lanes[4, t]) + abs(lanes[8, t] - lanes[5, t])
            lanes[10, t], lanes[11, t], lanes[12, t] = lanes[4, t], lanes[5, t], length
    _corner_planes(lanes, n_trials, trials.rank_tolerance)
    first_plane, n_failures = -1, 0
    for t in range(n_trials):
        has_plane = lanes[3, t] < np.inf
        if not has_plane:
            # Three failures are enough: a neighborhood without a plane is not read 69 times.
            has_plane = n_failures < 3 and _complete_trial(
                local, size, trials, t, lanes, rotated, member
            )
            n_failures += not has_plane
        if has_plane and first_plane < 0:
            first_plane = t
    return first_plane


@kernel
def _corner_planes(lanes, n_trials, rank_tolerance):
    """Planes through the corners a, b and c in rows 4 to 12 of lanes, for vectors of trials."""
    for t in range(n_trials):
        ax, ay, az = lanes[4, t], lanes[5, t], lanes[6, t]
        ux, uy, uz = lanes[7, t] - ax, lanes[8, t] - ay, lanes[9, t] - az
        vx, vy, vz = lanes[10, t] - ax, lanes[11, t] - ay, lanes[12, t] - az
        wx, wy, wz = vx - ux, vy - uy, vz - uz
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        # The squared singular values of three points have the sum `spread` and the product
        # `area2 / 3`: see `planes_through`.
        area2 = nx * nx + ny * ny + nz * nz
        spread = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz
        spread = (spread + wx * wx + wy * wy + wz * wz) / 3.0
        least = rank_tolerance * spread
        scale = 1.0 / np.sqrt(area2)
        offset = -(nx * ax + ny * ay + nz * az) * scale
        lanes[0, t], lanes[1, t], lanes[2, t] = nx * scale, ny * scale, nz * scale
        lanes[3, t] = offset if area2 / 3.0 > least * least else np.inf


@kernel
def _complete_trial(local, size, trials, t, lanes, rotated, member):
    """Read row t beyond its first members until the subset spans a plane (step 1)."""
    row = trials.positions[t]
    for j in range(size):
        member[j] = 0.0
    n_members, wanted = 0, trials.d + 1
    for q in range(row.shape[0]):
        if row[q] >= size:
            continue
        member[row[q]] = 1.0
        n_members += 1
        if n_members < wanted:
            continue
        wanted = min(wanted + max(1, wanted // 2), size)  # half as many again each time
        mean, covariance = weighted_covariance(local, size, member)
        values, axes = principal_axes(covariance, trials.d)
        if values[1] > trials.rank_tolerance**2 * values[trials.d - 1]:
            normal = _refined_normal(local, size, member, mean, axes, trials.d, rotated)
            for axis in range(3):
                lanes[axis, t] = normal[axis]
            lanes[3, t] = -(mean[0] * normal[0] + mean[1] * normal[1] + mean[2] * normal[2])
            return True
    return False


@kernel
def _refined_normal(local, size, member, mean, axes, d, rotated):
    """Decompose once more in the axes found; this restores the digits lost in a thin subset."""
    for j in range(size):
        dx, dy, dz = local[0, j] - mean[0], local[1, j] - mean[1], local[2, j] - mean[2]
        rotated[0, j] = axes[0][0] * dx + axes[0][1] * dy + axes[0][2] * dz
        rotated[1, j] = axes[1][0] * dx + axes[1][1] * dy + axes[1][2] * dz
        rotated[2, j] = axes[2][0] * dx + axes[2][1] * dy + axes[2][2] * dz
    _, covariance = weighted_covariance(rotated, size, member)
    _, turned = principal_axes(covariance, d)
    a, b, c = turned[0]
    return (
        a * axes[0][0] + b * axes[1][0] + c * axes[2][0],
        a * axes[0][1] + b * axes[1][1] + c * axes[2][1],
        a * axes[0][2] + b * axes[1][2] + c * axes[2][2],
    )


@kernel(fastmath=FASTMATH)
def _screen(local32, size, n_support, lanes, work, bits, levels, rounding, upright):
    """Lower bounds of the trials' least eigenvalues (steps 2 and 3), in float32, to work[20].

    Distances become levels in int16, whose vectors hold twice as many lanes. Bisection of the
    levels by counting finds the largest limit that no more than h members are below. It is a
    comparison and a sum, which run at full vector width; sorting would not. Ties may leave fewer
    than h members. Members nearer than the limit, by more than twice the `rounding` of distances,
    are surely of the set. `upright` is as of `principal_axes`, 0 in 3D.
    """
    n_lanes = lanes.shape[1]
    total, limit, moments, distances = work[4], work[5], work[10:20], work[21:]
    limit_bits, base = bits[5], bits[6]
    for i in range(4):
        for t in range(n_lanes):
            work[i, t] = np.float32(lanes[i, t])
    for j in range(size):
        x, y, z = local32[j, 0], local32[j, 1], local32[j, 2]
        local32[j, 3], local32[j, 4], local32[j, 5] = x * x, x * y, x * z
        local32[j, 6], local32[j, 7], local32[j, 8] = y * y, y * z, z * z
    _lane_distances(work, local32, size, distances, total)
    # The h-th distance is not larger than the mean of those that are as large.
    share = SLACK / np.float32(size - n_support + 1)
    for t in range(n_lanes):
        limit[t] = total[t] * share
    for t in range(n_lanes):
        base[t] = np.int32((limit_bits[t] >> SHIFT) - (MOST_LEVEL - 1))
    _lane_levels(bits[21:], base, size, levels)
    low = levels[levels.shape[0] - 1]
    levels[size] = MOST_LEVEL  # pads an odd number of rows, and is never counted
    _lane_limits(levels, (size + 1) // 2, n_support, low)
    # The limit as a distance; at level 0 it is 0, because members below the levels are there.
    margin = F2 * np.float32(rounding)
    for t in range(n_lanes):
        limit_bits[t] = np.int32((low[t] + base[t]) << SHIFT) if low[t] > 0 else np.int32(0)
    for t in range(n_lanes):
        limit[t] -= margin
    _lane_moments(distances, limit, local32, size, moments)
    _lower_bounds(moments, n_support, upright, work[20])


@kernel(fastmath=FASTMATH)
def _lower_bounds(moments, n_support, upright, bound):
    """Fill lower bounds of least eigenvalues from moments of members that are surely of the set.

    Leaving members out can only lower the least eigenvalue of the scatter matrix.
    """
    wanted = np.float32(n_support)
    s, sx, sy, sz = moments[0], moments[1], moments[2], moments[3]
    sxx, sxy, sxz, syy = moments[4], moments[5], moments[6], moments[7]
    syz, szz = moments[8], moments[9]
    for t in range(len(bound)):
        scale = F1 / (s[t] if s[t] > F1 else F1)
        mx, my, mz = sx[t] * scale, sy[t] * scale, sz[t] * scale
        cxx, cxy, cxz = sxx[t] * scale - mx * mx, sxy[t] * scale - mx * my, sxz[t] * scale - mx * mz
        cyy, cyz, czz = syy[t] * scale - my * my, syz[t] * scale - my * mz, szz[t] * scale - mz * mz
        czz += upright * (cxx + cyy)  # in 2D the third axis is to have the largest variance
        trace = cxx + cyy + czz
        minors = cxx * cyy - cxy * cxy + cxx * czz - cxz * cxz + cyy * czz - cyz * cyz
        determinant = cxx * (cyy * czz - cyz * cyz)
        determinant += -cxy * (cxy * czz - cyz * cxz) + cxz * (cxy * cyz - cyy * cxz)
        # Newton's method from zero climbs to the least root of the characteristic polynomial.
        root = F0
        for _ in range(5):
            value = ((root - trace) * root + minors) * root - determinant
            slope = (np.float32(3) * root - F2 * trace) * root + minors
            root = root - value / (slope if slope > TINY else TINY)
        # Rounding of the mean's square is a share of the second moments, not of the trace.
        size2 = (sxx[t] + syy[t] + szz[t]) * scale
        minors = minors if minors > TINY else TINY
        error = SCREEN_STEP * (size2 + size2 * trace * trace / minors)
        least = (root * (F1 - SCREEN_RTOL) - error) * (s[t] / wanted)
        # Members on a line, in float32, bound nothing; and no comparison would find a NaN.
        wide = minors > LEAST_MINORS * (trace * trace)
        bound[t] = least if wide and least > F0 else F0


@kernel(fastmath=FASTMATH)
def _select_members(local, size, trials, lanes, t, keys, key_numbers, member):
    """Mark the h members nearest to plane t (step 2); ties go to the first."""
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz, offset = lanes[0, t], lanes[1, t], lanes[2, t], lanes[3, t]
    n_support = trials.n_support[size]
    for j in range(size):
        distance = abs(nx * x[j] + ny * y[j] + nz * z[j] + offset)
        key_numbers[j] = np.rint(distance / trials.distance_step)  # bits sort like the numbers
    limit = kth_smallest(keys, size, n_support)
    left = n_support
    for j in range(size):
        inside = keys[j] < limit
        member[j] = 1.0 if inside else 0.0
        left -= inside
    # Those at the limit are tied, and fill up from the first on.
    for j in range(size):
        if left == 0:
            break
        if keys[j] == limit:
            member[j] = 1.0
            left -= 1


@kernel
def _least_eigenvalue(local, size, member, trials):
    """Least eigenvalue of the covariance of the members (step 3).

    It is the variance of the members along the axis, which can only be too large, and infinite
    where they span no plane: see the NumPy form. The fit, mean, eigenvalues and axes, comes too.
    """
    mean, covariance = weighted_covariance(local, size, member)
    values, axes = principal_axes(covariance, trials.d)
    least = np.inf
    if values[1] > trials.rank_tolerance**2 * values[trials.d - 1]:
        least = variance_along(local, size, member, mean, axes[0])
    return least, (mean, values, axes)


@kernel(fastmath=FASTMATH)
def _lane_distances(planes, features, n_rows, distances, total):
    """Absolute distances (rows, lanes) of members from planes (4, lanes), and their sums."""
    for t in range(0, len(total), LINE):
        nx, ny, nz = load(planes[0], t), load(planes[1], t), load(planes[2], t)
        offset, sums = load(planes[3], t), spread(F0)
        for j in range(n_rows):
            signed = multiply_add(nz, features[j, 2], offset)
            signed = multiply_add(ny, features[j, 1], signed)
            signed = multiply_add(nx, features[j, 0], signed)
            distance = where_below(signed, F0, multiply_add(signed, -F1, F0), signed)
            store(distance, distances[j], t)
            sums = add(sums, distance)
        store(sums, total, t)


@kernel
def _lane_levels(bits, base, n_rows, levels):
    """Levels int16 (rows, lanes): bits without the last, less a base, within 0 and MOST_LEVEL."""
    for j in range(n_rows):
        row, out = bits[j], levels[j]
        for t in range(len(base)):
            value = max(np.int32((row[t] >> SHIFT) - base[t]), np.int32(0))
            out[t] = np.int16(min(value, np.int32(MOST_LEVEL)))


@kernel(fastmath=FASTMATH)
def _lane_limits(levels, n_pairs, wanted, limits):
    """The largest level, of each lane, that no more than `wanted` rows are below, by bisection.

    Rows are counted in pairs, because each sum waits for the one before.
    """
    zero, one = spread(I0), spread(I1)
    for t in range(0, len(limits), 2 * LINE):
        limit = zero
        for power in range(STEPS - 1, -1, -1):
            guess = add(limit, np.int16(1 << power))
            even = odd = zero
            for j in range(n_pairs):
                even = add(even, where_below(load(levels[2 * j], t), guess, one, zero))
                odd = add(odd, where_below(load(levels[2 * j + 1], t), guess, one, zero))
            limit = where_below(add(even, odd), np.int16(wanted + 1), guess, limit)
        store(limit, limits, t)


@kernel(fastmath=FASTMATH)
def _lane_moments(distances, limits, features, n_rows, moments):
    """Number of rows nearer than each lane's limit, and sums of their features, (10, lanes)."""
    zero, one = spread(F0), spread(F1)
    for t in range(0, len(limits), LINE):
        limit = load(limits, t)
        n = sx = sy = sz = sxx = sxy = sxz = syy = syz = szz = zero
        for j in range(n_rows):
            member = where_below(load(distances[j], t), limit, one, zero)
            n = add(n, member)
            sx = multiply_add(member, features[j, 0], sx)
            sy = multiply_add(member, features[j, 1], sy)
            sz = multiply_add(member, features[j, 2], sz)
            sxx = multiply_add(member, features[j, 3], sxx)
            sxy = multiply_add(member, features[j, 4], sxy)
            sxz = multiply_add(member, features[j, 5], sxz)
            syy = multiply_add(member, features[j, 6], syy)
            syz = multiply_add(member, features[j, 7], syz)
            szz = multiply_add(member, features[j, 8], szz)
        sums = n, sx, sy, sz, sxx, sxy, sxz, syy, syz, szz
        for i in range(len(sums)):
            store(sums[i], moments[i], t)
