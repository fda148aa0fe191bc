"""RANSAC in three dimensions, compiled: the same answers as ``_ransac``, trial by trial."""

import numpy as np

from sklearn_mcmd.planes._moments_numba import FASTMATH
from sklearn_mcmd.runtime._kernels import kernel


def best_planes_3d(points, table, threshold, stops, truncated_loss, *, rank_tolerance):
    """As `_ransac.best_planes`, for points (B, n, 3)."""
    centers, normals = np.full((2, len(points), 3), np.nan)
    columns = np.ascontiguousarray(np.swapaxes(points, 1, 2))
    _best_planes(columns, table, rank_tolerance, threshold, stops, truncated_loss, centers, normals)
    return centers, normals


def least_medians_3d(points, table, *, rank_tolerance):
    """As `_ransac.least_medians`, for points (B, n, 3)."""
    least = np.full(len(points), np.inf)
    columns = np.ascontiguousarray(np.swapaxes(points, 1, 2))
    _least_medians(columns, table, rank_tolerance, least)
    return least


@kernel(cache=True)
def _best_planes(
    columns, table, rank_tolerance, threshold, stops, truncated_loss, centers, normals
):
    n_members = columns.shape[2]
    for i in range(columns.shape[0]):
        local = columns[i]
        best, stop = np.inf, stops[0]
        for t in range(table.shape[0]):
            if t >= stop:
                break
            spans, anchor, normal = _trial_plane(local, table[t], rank_tolerance)
            if not spans:
                continue
            if truncated_loss:
                loss, count = _truncated_loss(local, normal, anchor, 1.0 / threshold[i])
            else:
                count = _count(local, normal, anchor, threshold[i])
                loss = np.float64(n_members - count)
            if loss < best:
                best, stop = loss, stops[count]
                for axis in range(3):
                    centers[i, axis] = local[axis, anchor]
                    normals[i, axis] = normal[axis]


@kernel(cache=True)
def _least_medians(columns, table, rank_tolerance, least):
    n_members = columns.shape[2]
    distances = np.empty(n_members)
    for i in range(columns.shape[0]):
        local = columns[i]
        best = np.inf
        for t in range(table.shape[0]):
            spans, anchor, normal = _trial_plane(local, table[t], rank_tolerance)
            # For a lower median, half of the members must be nearer than the best median.
            if not spans or _count(local, normal, anchor, best) < (n_members + 1) // 2:
                continue
            _distances(local, normal, anchor, distances)
            best = min(best, np.median(distances))
        least[i] = best


@kernel
def _trial_plane(local, row, rank_tolerance):
    """Whether three members span a plane, the first of them and the unit normal."""
    a, b, c = row[0], row[1], row[2]
    x, y, z = local[0], local[1], local[2]
    ux, uy, uz = x[b] - x[a], y[b] - y[a], z[b] - z[a]
    vx, vy, vz = x[c] - x[a], y[c] - y[a], z[c] - z[a]
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    area2 = nx * nx + ny * ny + nz * nz
    spread = ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz
    spread = (spread + wx * wx + wy * wy + wz * wz) / 3.0
    if not area2 / 3.0 > (rank_tolerance * spread) ** 2:
        return False, a, (0.0, 0.0, 0.0)
    scale = 1.0 / np.sqrt(area2)
    return True, a, (nx * scale, ny * scale, nz * scale)


@kernel(fastmath=FASTMATH)
def _count(local, normal, anchor, threshold):
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz = normal
    offset = nx * x[anchor] + ny * y[anchor] + nz * z[anchor]
    count = 0
    for j in range(local.shape[1]):
        count += 1 if abs(nx * x[j] + ny * y[j] + nz * z[j] - offset) < threshold else 0
    return count


@kernel(fastmath=FASTMATH)
def _truncated_loss(local, normal, anchor, weight):
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz = normal[0] * weight, normal[1] * weight, normal[2] * weight
    offset = nx * x[anchor] + ny * y[anchor] + nz * z[anchor]
    loss, count = 0.0, 0
    for j in range(local.shape[1]):
        ratio = nx * x[j] + ny * y[j] + nz * z[j] - offset
        square = ratio * ratio
        loss += square if square < 1.0 else 1.0
        count += 1 if square < 1.0 else 0
    return loss, count


@kernel(fastmath=FASTMATH)
def _distances(local, normal, anchor, out):
    x, y, z = local[0], local[1], local[2]
    nx, ny, nz = normal
    offset = nx * x[anchor] + ny * y[anchor] + nz * z[anchor]
    for j in range(local.shape[1]):
        out[j] = abs(nx * x[j] + ny * y[j] + nz * z[j] - offset)
