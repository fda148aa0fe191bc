"""Adaptive trials in three dimensions, compiled: the same sets as ``_adaptive_trials``.

The trials up to each checkpoint and the rest are screened as blocks, each with its own
vectors; the best of all blocks so far is decided in float64 as in ``_consistent_set_numba``.
"""

import numpy as np
from numba import njit

from sklearn_mcmd.planes._adaptive_trials import COHERENCE, FLATNESS, INLIER_CUTOFF, PERFECT, REACH
from sklearn_mcmd.planes._consistent_set import EIGENVALUE_STEP
from sklearn_mcmd.planes._consistent_set_numba import (
    FAR,
    first_members,
    least_eigenvalue,
    screen,
    select_members,
    trial_planes,
    work_arrays,
)
from sklearn_mcmd.planes._plane_numba import FASTMATH, eigh_3d, weighted_covariance

__all__ = ["adaptive_set_3d", "adaptive_work_arrays"]


@njit(nogil=True, error_model="numpy")
def adaptive_set_3d(
    size, trials, n_support, arrays, blocks, checkpoints, least_inliers, scale_factor
):
    """Maximum consistent set of one neighborhood in as few trials as it needs.

    Parameters
    ----------
    size, trials, n_support, arrays : see ``consistent_set_3d``; of the arrays, `lanes` and
        `lanes32` are not used
    blocks : from `adaptive_work_arrays`
    checkpoints, least_inliers, scale_factor : see ``StopRule``

    Returns
    -------
    least_eigenvalue : float, negative where no set spans a plane
    n_used : int, trials made
    """
    local, local32, _, _, least, keys, member = arrays
    farthest = 0.0
    for axis in range(3):
        for j in range(size):
            local32[axis, j] = np.float32(local[axis, j])
            farthest = max(farthest, abs(local[axis, j]))
    best = np.inf
    start = 0
    for block in range(checkpoints.shape[0] + 1):
        is_last = block == checkpoints.shape[0]
        stop = trials.shape[0] if is_last else checkpoints[block]
        lanes, lanes32 = blocks[block]
        best = _try_block(
            size, trials[start:stop], n_support, local, local32, lanes, lanes32,
            farthest <= FAR, best, least[start:stop], keys, member,
        )  # fmt: skip
        start = stop
        if is_last or best == np.inf or least_inliers[block, size] > size:
            continue
        value = _take_first_best(size, stop, n_support, local, blocks, checkpoints, best, least,
                                 keys, member)  # fmt: skip
        if _settled(local, size, member, scale_factor[size], least_inliers[block, size]):
            return value, stop
    if best == np.inf:
        return first_members(size, n_support, member), start
    value = _take_first_best(
        size, start, n_support, local, blocks, checkpoints, best, least, keys, member
    )
    return value, start


@njit(nogil=True)
def adaptive_work_arrays(n_trials, k, checkpoints):
    """Vectors of each block of trials, as ``work_arrays`` makes them; a list for the kernel."""
    blocks = []
    start = 0
    for block in range(checkpoints.shape[0] + 1):
        stop = n_trials if block == checkpoints.shape[0] else checkpoints[block]
        arrays = work_arrays(stop - start, k)
        blocks.append((arrays[2], arrays[3]))
        start = stop
    return blocks


@njit(nogil=True, error_model="numpy")
def _try_block(
    size, trials, n_support, local, local32, lanes, lanes32, near, best, least, keys, member
):
    """Least eigenvalues of the trials that may be the best of all, into `least`."""
    n_trials = trials.shape[0]
    for t in range(n_trials):
        least[t] = np.inf
    first_plane = trial_planes(local, size, trials, lanes)
    if first_plane < 0:
        return best
    for t in range(lanes.shape[1]):
        if t >= n_trials or lanes[3, t] == np.inf:
            for axis in range(4):
                lanes[axis, t] = lanes[axis, first_plane]
    bound = lanes32[20]
    if near:
        screen(local32, size, n_support, lanes, lanes32)
    else:
        bound[:] = 0.0
    for _ in range(n_trials):
        t = 0
        for s in range(1, n_trials):
            if bound[s] < bound[t]:
                t = s
        if bound[t] > best + EIGENVALUE_STEP:
            break
        bound[t] = np.inf
        select_members(local, size, n_support, lanes, t, keys, member)
        least[t] = least_eigenvalue(local, size, member)
        best = min(best, least[t])
    return best


@njit(nogil=True, error_model="numpy")
def _take_first_best(
    size, n_trials, n_support, local, blocks, checkpoints, best, least, keys, member
):
    """Mark the set of the first trial among the best of `n_trials`; its least eigenvalue."""
    start = block = 0
    for t in range(n_trials):
        if block < checkpoints.shape[0] and t == checkpoints[block]:
            start, block = t, block + 1
        if least[t] <= best + EIGENVALUE_STEP:
            select_members(local, size, n_support, blocks[block][0], t - start, keys, member)
            return least[t]
    return best


@njit(nogil=True, error_model="numpy")
def _settled(local, size, member, scale_factor, least_inliers):
    """Whether the plane of the members needs no further trials, see the NumPy form."""
    mean, covariance = weighted_covariance(local, size, member)
    _, axes = eigh_3d(covariance)
    inlier, residual = np.empty(size), np.empty(size)
    _residuals(local, size, mean, axes[0], residual)
    total = variance = 0.0
    for j in range(size):
        total += member[j]
        variance += member[j] * residual[j] * residual[j]
    limit = max(INLIER_CUTOFF * scale_factor * np.sqrt(variance / total), PERFECT)
    n_inliers = 0.0
    for j in range(size):
        inlier[j] = 1.0 if abs(residual[j]) <= limit else 0.0
        n_inliers += inlier[j]
    if n_inliers < least_inliers:
        return False

    mean, covariance = weighted_covariance(local, size, inlier)
    values, axes = eigh_3d(covariance)
    _residuals(local, size, mean, axes[0], residual)
    variance = 0.0
    for j in range(size):
        variance += inlier[j] * residual[j] * residual[j]
    variance /= n_inliers
    if variance > FLATNESS**2 * values[1]:
        return False
    if variance <= PERFECT**2:
        return True
    projected = np.empty((4, size))
    n = 0
    for j in range(size):
        if inlier[j] == 1.0:
            for axis in range(3):
                projected[axis, n] = local[axis, j] - mean[axis] - residual[j] * axes[0][axis]
            projected[3, n] = residual[j]
            n += 1
    together, spread = _pair_sums(projected, n, REACH * 0.5 * (values[1] + values[2]))
    return spread > 0.0 and together <= COHERENCE * np.sqrt(spread)


@njit(nogil=True, fastmath=FASTMATH, error_model="numpy")
def _residuals(local, size, mean, normal, out):
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz = normal
    mx, my, mz = mean
    for j in range(size):
        out[j] = nx * (x[j] - mx) + ny * (y[j] - my) + nz * (z[j] - mz)


@njit(nogil=True, fastmath=FASTMATH, error_model="numpy")
def _pair_sums(projected, n, reach):
    """Sums over pairs of the weighted products of residuals, and of their squares."""
    x, y, z, r = projected[0], projected[1], projected[2], projected[3]
    together = spread = 0.0
    scale = 1.0 / reach
    for i in range(1, n):
        xi, yi, zi, ri = x[i], y[i], z[i], r[i]
        for j in range(i):
            dx, dy, dz = x[j] - xi, y[j] - yi, z[j] - zi
            weight = 1.0 - (dx * dx + dy * dy + dz * dz) * scale
            product = (weight if weight > 0.0 else 0.0) * ri * r[j]
            together += product
            spread += product * product
    return together, spread
