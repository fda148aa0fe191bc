"""Data snooping of many small simulated planes, with noise 1 along z (a literal vertical form)."""

import numpy as np

from sklearn_mcmd.planes._moments_numba import kth_smallest
from sklearn_mcmd.runtime._kernels import kernel


@kernel(cache=True)
def snoop_planes(points, corners, start, limits, least_redundancy, found):
    """Verdicts of `BaardaPlaneDetector` with known sigma0, one plane at a time.

    They fill `found`, bool (m, n), for points (m, n, 3). The minimal subsets of the robust start
    are `corners`, int64 (m, n_trials, 3); with no trials there is no such start. `start` has the
    number of points that its plane fits, by how much points that belong to it deviate at most, and
    the rounds of concentration and of reweighting. `limits` (n + 2,) has the critical value of w by
    the number of retained points, and `least_redundancy` is that of a controlled point.
    """
    n = points.shape[1]
    sizes, member = np.empty(n), np.empty(n, dtype=np.bool_)
    for i in range(len(points)):
        X = points[i]
        member[:] = True
        if corners.shape[1] > 0:
            _start(X, corners[i], start, limits[n], sizes, member)
        plane, worst = _fit(X, member), 0
        while worst >= 0 and plane[0] > 4:
            worst, largest = -1, limits[int(plane[0])]
            for j in range(n):
                if member[j]:
                    residual, spread = _evaluate(plane, X[j])
                    w = residual / np.sqrt(1 - spread) if 1 - spread > least_redundancy else 0.0
                    if w > largest:
                        worst, largest = j, w
            if worst >= 0:
                member[worst] = False
                plane = _fit(X, member)
        for j in range(n):
            residual, spread = _evaluate(plane, X[j])
            found[i, j] = residual > limits[int(plane[0]) + 1] * np.sqrt(1 + spread)


@kernel
def _fit(X, member):
    """Number, center, slopes, and cofactors of the slopes, of the members' plane."""
    n, cx, cy, cz = 0.0, 0.0, 0.0, 0.0
    for j in range(len(X)):
        if member[j]:
            n, cx, cy, cz = n + 1, cx + X[j, 0], cy + X[j, 1], cz + X[j, 2]
    cx, cy, cz = cx / n, cy / n, cz / n
    xx, xy, yy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(len(X)):
        if member[j]:
            x, y, z = X[j, 0] - cx, X[j, 1] - cy, X[j, 2] - cz
            xx, xy, yy, xz, yz = xx + x * x, xy + x * y, yy + y * y, xz + x * z, yz + y * z
    det = xx * yy - xy * xy
    slopes = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
    return n, cx, cy, cz, slopes[0], slopes[1], yy / det, -xy / det, xx / det


@kernel
def _evaluate(plane, point):
    """Size of the residual, and cofactor of the plane, at a point."""
    n, cx, cy, cz, a, b, q_aa, q_ab, q_bb = plane
    x, y = point[0] - cx, point[1] - cy
    spread = 1 / n + q_aa * x * x + 2 * q_ab * x * y + q_bb * y * y
    return abs(point[2] - cz - a * x - b * y), spread


@kernel
def _start(X, corners, start, limit, sizes, member):
    """Leave out what is outside of the plane of the most coplanar half (`robust_start`)."""
    half, cut, max_rounds = start
    keys = sizes.view(np.int64)  # bits of positive numbers sort as the numbers do
    n, best = len(X), np.inf
    for t in range(len(corners)):
        a, b, c = corners[t]
        ux, uy, uz = X[b, 0] - X[a, 0], X[b, 1] - X[a, 1], X[b, 2] - X[a, 2]
        vx, vy, vz = X[c, 0] - X[a, 0], X[c, 1] - X[a, 1], X[c, 2] - X[a, 2]
        det = ux * vy - uy * vx
        if det == 0:
            continue
        p, q, total = (uz * vy - uy * vz) / det, (ux * vz - uz * vx) / det, 0.0
        for j in range(n):
            sizes[j] = abs(X[j, 2] - X[a, 2] - p * (X[j, 0] - X[a, 0]) - q * (X[j, 1] - X[a, 1]))
        nearest = kth_smallest(keys, n, half)
        for j in range(n):
            total += sizes[j] ** 2 if keys[j] <= nearest else 0.0
        if total < best:
            best = total
            for j in range(n):
                member[j] = keys[j] <= nearest
    # Concentration on the nearest half, reweighting, and the points to begin with.
    for turn in range(2 * max_rounds + 1):
        plane, n_members = _fit(X, member), 0
        for j in range(n):
            residual, spread = _evaluate(plane, X[j])
            sizes[j] = residual if turn < max_rounds else residual / np.sqrt(1 + spread)
        most = limit if turn == 2 * max_rounds else cut
        nearest = kth_smallest(keys, n, half)
        for j in range(n):
            n_members += sizes[j] <= most
        if turn < max_rounds or n_members > 3:
            for j in range(n):
                member[j] = keys[j] <= nearest if turn < max_rounds else sizes[j] <= most
