"""Algorithm 1 in three dimensions, compiled: the same answers as ``_consistent_set``, faster.

All trials of one neighborhood advance together, one trial in each vector lane. A screening in
float32 gives each trial a lower bound of its least eigenvalue. Float64 then decides among
the few trials whose bound does not exceed the best value found, in ascending order. So the
set is the one that float64 alone would find, in the time of float32.
"""

import numpy as np

from sklearn_mcmd.planes._kernels import kernel
from sklearn_mcmd.planes._moments_numba import (
    FASTMATH,
    eigh_3d,
    kth_smallest,
    variance_along,
    weighted_covariance,
)

__all__ = [
    "NO_FIT",
    "consistent_set_3d",
    "first_members",
    "least_eigenvalue",
    "screen",
    "select_members",
    "trial_planes",
    "work_arrays",
]

VECTOR = 8  # float32 lanes of the vectors that compilers prefer
LINE = 16  # float32 numbers of a cache line
COUNTING_PASSES = 7
ROWS = 4  # members that the counting loop takes at once
F0, F1, F2, HALF = np.float32(0), np.float32(1), np.float32(2), np.float32(0.5)
TINY = np.float32(1e-30)
ZEROS = 0.0, 0.0, 0.0
NO_FIT = ZEROS, ZEROS, (ZEROS, ZEROS, ZEROS)
F01, F09 = np.float32(0.1), np.float32(0.9)
# The median of half-normal distances is 0.845 of their mean; outliers raise the mean.
FIRST_GUESS = np.float32(0.7)
# Beyond this number of median radii float32 rounds too coarsely for a bound. Then float64 decides
# all trials.
FAR = 100.0
# Errors that the screening's least eigenvalue may have: rounding of the moments, a few float32
# steps of the trace, and rounding of the determinant, larger in flat and long neighborhoods.
SCREEN_RTOL = np.float32(1e-3)
SCREEN_STEP = np.float32(1e-6)


@kernel(error_model="numpy")
def consistent_set_3d(size, trials, arrays):
    """Maximum consistent set of one neighborhood (Algorithm 1).

    Parameters
    ----------
    size : members in use, whose coordinates (by `localize`) are in the first array
    trials : Trials
    arrays : from `work_arrays`; `member`, the last, receives 1 for members of the set and 0
        for the others

    Returns
    -------
    least : float
        Least eigenvalue of the set, in squared radii; negative where no set spans a plane.
    fit : tuple
        Mean, eigenvalues and axes of the set, without meaning where none spans a plane.
    """
    local, local32, lanes, lanes32, least, keys, member = arrays
    n_trials = trials.positions.shape[0]
    n_support = trials.n_support[size]
    farthest = 0.0
    for axis in range(3):
        for j in range(size):
            local32[axis, j] = np.float32(local[axis, j])
            farthest = max(farthest, abs(local[axis, j]))
    first_plane = trial_planes(local, size, trials, lanes)
    if first_plane < 0:
        return first_members(size, n_support, member), NO_FIT
    # Lanes without a plane, and lanes that pad the vectors, repeat the first plane.
    for t in range(lanes.shape[1]):
        if t >= n_trials or lanes[3, t] == np.inf:
            for axis in range(4):
                lanes[axis, t] = lanes[axis, first_plane]
    bound = lanes32[20]
    if farthest <= FAR:
        screen(local32, size, n_support, lanes, lanes32)
    else:
        bound[:] = F0

    best, selected, fit = np.inf, -1, NO_FIT
    for t in range(n_trials):
        least[t] = np.inf
    for _ in range(n_trials):
        t, lowest = np.int64(0), bound[0]  # with a plain 0, `select_members` is compiled twice
        for s in range(1, n_trials):
            if bound[s] < lowest:
                t, lowest = s, bound[s]
        if lowest > best + trials.eigenvalue_step:
            break
        bound[t] = np.inf
        select_members(local, size, trials, lanes, t, keys, member)
        selected = t
        least[t], fit = least_eigenvalue(local, size, member, trials.rank_tolerance)
        best = min(best, least[t])
    if best == np.inf:
        return first_members(size, n_support, member), NO_FIT
    first = 0
    while least[first] > best + trials.eigenvalue_step:
        first += 1
    if first != selected:
        select_members(local, size, trials, lanes, first, keys, member)
        _, fit = least_eigenvalue(local, size, member, trials.rank_tolerance)
    return least[first], fit


@kernel
def first_members(size, n_support, member):
    for j in range(size):
        member[j] = 1.0 if j < n_support else 0.0
    return -1.0


@kernel
def work_arrays(n_trials, k):
    """Arrays that one thread needs for neighborhoods of k members; all neighborhoods share them.

    The float32 arrays begin on a cache line, because vector loads across two lines take twice as
    long. They have room for the rows that pad unrolled loops.
    """
    n_lanes = (n_trials + VECTOR - 1) // VECTOR * VECTOR
    local = np.zeros((3, k))
    local32 = np.zeros((3, k + ROWS), dtype=np.float32)
    lanes = np.zeros((4, n_lanes))
    n_rows = 21 + k + ROWS
    buffer = np.zeros(n_rows * n_lanes + LINE, dtype=np.float32)
    start = (-buffer.ctypes.data % (4 * LINE)) // 4
    lanes32 = buffer[start : start + n_rows * n_lanes].reshape(n_rows, n_lanes)
    least, keys, member = np.empty(n_trials), np.empty(k, dtype=np.int64), np.zeros(k)
    return local, local32, lanes, lanes32, least, keys, member


@kernel(error_model="numpy")
def trial_planes(local, size, trials, lanes):
    """Planes of all trials (steps 1 and 2) into lanes; an infinite offset where there is none.

    Returns the first trial that has a plane, -1 if none has.
    """
    x, y, z = local[0], local[1], local[2]
    first_plane = -1
    n_failures = 0
    for t in range(trials.positions.shape[0]):
        row = trials.positions[t]
        # The first three positions inside the neighborhood.
        p = 0
        while row[p] >= size:
            p += 1
        a = row[p]
        p += 1
        while row[p] >= size:
            p += 1
        b = row[p]
        p += 1
        while row[p] >= size:
            p += 1
        c = row[p]
        ux, uy, uz = x[b] - x[a], y[b] - y[a], z[b] - z[a]
        vx, vy, vz = x[c] - x[a], y[c] - y[a], z[c] - z[a]
        wx, wy, wz = vx - ux, vy - uy, vz - uz
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area2 = nx * nx + ny * ny + nz * nz
        spread = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz
        spread = (spread + wx * wx + wy * wy + wz * wz) / 3.0
        if area2 / 3.0 > (trials.rank_tolerance * spread) ** 2:
            scale = 1.0 / np.sqrt(area2)
            lanes[0, t], lanes[1, t], lanes[2, t] = nx * scale, ny * scale, nz * scale
            lanes[3, t] = -(nx * x[a] + ny * y[a] + nz * z[a]) * scale
            found = True
        else:
            # Three failures are enough: a neighborhood without a plane is not read 69 times.
            found = n_failures < 3 and _complete_trial(local, size, trials, t, p, lanes)
            n_failures += not found
        if not found:
            lanes[3, t] = np.inf
        elif first_plane < 0:
            first_plane = t
    return first_plane


@kernel(error_model="numpy")
def _complete_trial(local, size, trials, t, p, lanes):
    """Read row t beyond position p until the subset spans a plane (step 1)."""
    row = trials.positions[t]
    member = np.zeros(size)
    for q in range(p + 1):
        if row[q] < size:
            member[row[q]] = 1.0
    n_members, wanted = 3, min(4, size)
    for q in range(p + 1, row.shape[0]):
        if row[q] >= size:
            continue
        member[row[q]] = 1.0
        n_members += 1
        if n_members < wanted:
            continue
        wanted = min(wanted + max(1, wanted // 2), size)
        mean, covariance = weighted_covariance(local, size, member)
        values, axes = eigh_3d(covariance)
        if values[1] > trials.rank_tolerance**2 * values[2]:
            normal = _refined_normal(local, size, member, mean, axes)
            for axis in range(3):
                lanes[axis, t] = normal[axis]
            lanes[3, t] = -(mean[0] * normal[0] + mean[1] * normal[1] + mean[2] * normal[2])
            return True
    return False


@kernel(error_model="numpy")
def _refined_normal(local, size, member, mean, axes):
    """Decompose once more in the axes found; this restores the digits lost in a thin subset."""
    rotated = np.empty((3, size))
    for j in range(size):
        dx, dy, dz = local[0, j] - mean[0], local[1, j] - mean[1], local[2, j] - mean[2]
        rotated[0, j] = axes[0][0] * dx + axes[0][1] * dy + axes[0][2] * dz
        rotated[1, j] = axes[1][0] * dx + axes[1][1] * dy + axes[1][2] * dz
        rotated[2, j] = axes[2][0] * dx + axes[2][1] * dy + axes[2][2] * dz
    _, covariance = weighted_covariance(rotated, size, member)
    _, turned = eigh_3d(covariance)
    a, b, c = turned[0]
    return (
        a * axes[0][0] + b * axes[1][0] + c * axes[2][0],
        a * axes[0][1] + b * axes[1][1] + c * axes[2][1],
        a * axes[0][2] + b * axes[1][2] + c * axes[2][2],
    )


@kernel(fastmath=FASTMATH, error_model="numpy")
def screen(local32, size, n_support, lanes, work):
    """Lower bounds of the trials' least eigenvalues (steps 2 and 3), in float32, to work[20].

    Counting finds the distance that h members do not exceed. It is a comparison and a sum, which
    run at full vector width; sorting would not. If the count is not exactly h after a few passes,
    a distance with fewer members is taken. Leaving points out can only lower the least eigenvalue
    of the scatter matrix, so the bound holds.
    """
    n_lanes = lanes.shape[1]
    nx, ny, nz, offset = work[0], work[1], work[2], work[3]
    limit, low, high, n_low, n_high, count = work[4], work[5], work[6], work[7], work[8], work[9]
    distances = work[21:]
    x, y, z = local32[0], local32[1], local32[2]
    for t in range(n_lanes):
        nx[t] = np.float32(lanes[0, t])
        ny[t] = np.float32(lanes[1, t])
        nz[t] = np.float32(lanes[2, t])
        offset[t] = np.float32(lanes[3, t])
        limit[t] = F0
    for j in range(size):
        xj, yj, zj = x[j], y[j], z[j]
        row = distances[j]
        for t in range(n_lanes):
            distance = abs(nx[t] * xj + ny[t] * yj + nz[t] * zj + offset[t])
            row[t] = distance
            limit[t] += distance
    # Rows that pad the unrolled loops are never counted.
    for j in range(size, (size + ROWS - 1) // ROWS * ROWS):
        for t in range(n_lanes):
            distances[j, t] = np.inf

    wanted = np.float32(n_support)
    guess = FIRST_GUESS / np.float32(size)
    for t in range(n_lanes):
        limit[t] *= guess
        low[t], n_low[t] = F0, F0
        high[t], n_high[t] = -F1, np.float32(size)  # not bracketed yet
    for i in range(COUNTING_PASSES):
        for t in range(n_lanes):
            count[t] = F0
        for j in range(0, size, ROWS):
            row0, row1 = distances[j], distances[j + 1]
            row2, row3 = distances[j + 2], distances[j + 3]
            for t in range(n_lanes):
                most = limit[t]
                n01 = (F1 if row0[t] <= most else F0) + (F1 if row1[t] <= most else F0)
                n23 = (F1 if row2[t] <= most else F0) + (F1 if row3[t] <= most else F0)
                count[t] += n01 + n23
        # Every third pass halves the bracket; the other passes interpolate in it.
        nearest, farthest = (HALF, HALF) if i % 3 == 2 else (F01, F09)
        for t in range(n_lanes):
            guess, n = limit[t], count[t]
            below = n <= wanted
            bottom, n_bottom = (guess, n) if below else (low[t], n_low[t])
            top, n_top = (high[t], n_high[t]) if below else (guess, n)
            low[t], n_low[t], high[t], n_high[t] = bottom, n_bottom, top, n_top
            share = (wanted + HALF - n_bottom) / (n_top - n_bottom)
            share = share if share > nearest else nearest
            share = share if share < farthest else farthest
            inner = bottom + share * (top - bottom)
            inner = inner if top >= F0 else F2 * guess
            limit[t] = guess if n == wanted else inner

    moments = work[10:20]
    s, sx, sy, sz = moments[0], moments[1], moments[2], moments[3]
    sxx, sxy, sxz, syy = moments[4], moments[5], moments[6], moments[7]
    syz, szz = moments[8], moments[9]
    for i in range(10):
        for t in range(n_lanes):
            moments[i, t] = F0
    for j in range(0, size, 2):
        row0, row1 = distances[j], distances[j + 1]
        x0, y0, z0, x1, y1, z1 = x[j], y[j], z[j], x[j + 1], y[j + 1], z[j + 1]
        xx0, xy0, xz0, yy0, yz0, zz0 = x0 * x0, x0 * y0, x0 * z0, y0 * y0, y0 * z0, z0 * z0
        xx1, xy1, xz1, yy1, yz1, zz1 = x1 * x1, x1 * y1, x1 * z1, y1 * y1, y1 * z1, z1 * z1
        for t in range(n_lanes):
            member0 = F1 if row0[t] <= low[t] else F0
            member1 = F1 if row1[t] <= low[t] else F0
            s[t] += member0 + member1
            sx[t] += member0 * x0 + member1 * x1
            sy[t] += member0 * y0 + member1 * y1
            sz[t] += member0 * z0 + member1 * z1
            sxx[t] += member0 * xx0 + member1 * xx1
            sxy[t] += member0 * xy0 + member1 * xy1
            sxz[t] += member0 * xz0 + member1 * xz1
            syy[t] += member0 * yy0 + member1 * yy1
            syz[t] += member0 * yz0 + member1 * yz1
            szz[t] += member0 * zz0 + member1 * zz1

    bound = work[20]
    for t in range(n_lanes):
        scale = F1 / (s[t] if s[t] > F1 else F1)
        mx, my, mz = sx[t] * scale, sy[t] * scale, sz[t] * scale
        cxx, cxy, cxz = sxx[t] * scale - mx * mx, sxy[t] * scale - mx * my, sxz[t] * scale - mx * mz
        cyy, cyz, czz = syy[t] * scale - my * my, syz[t] * scale - my * mz, szz[t] * scale - mz * mz
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
        bound[t] = (root * (F1 - SCREEN_RTOL) - error) * (s[t] / wanted)


@kernel(fastmath=FASTMATH, error_model="numpy")
def select_members(local, size, trials, lanes, t, keys, member):
    """Mark the h members nearest to plane t (step 2); ties go to the first."""
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz, offset = lanes[0, t], lanes[1, t], lanes[2, t], lanes[3, t]
    n_support = trials.n_support[size]
    steps = keys.view(np.float64)  # whose bits sort like the numbers
    for j in range(size):
        distance = abs(nx * x[j] + ny * y[j] + nz * z[j] + offset)
        steps[j] = np.rint(distance / trials.distance_step)
    limit = kth_smallest(keys, size, n_support)
    left = n_support
    for j in range(size):
        inside = keys[j] < limit
        member[j] = 1.0 if inside else 0.0
        left -= inside
    for j in range(size):
        if left == 0:
            break
        if keys[j] == limit:
            member[j] = 1.0
            left -= 1


@kernel(error_model="numpy")
def least_eigenvalue(local, size, member, rank_tolerance):
    """Least eigenvalue of the covariance of the members (step 3).

    It is the variance of the members along the axis, which can only be too large, and infinite
    where they span no plane: see the NumPy form. The fit, mean, eigenvalues and axes, comes too.
    """
    mean, covariance = weighted_covariance(local, size, member)
    values, axes = eigh_3d(covariance)
    least = np.inf
    if values[1] > rank_tolerance**2 * values[2]:
        least = variance_along(local, size, member, mean, axes[0])
    return least, (mean, values, axes)
