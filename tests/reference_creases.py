"""Literal forms of one bent surface and of two planes that meet in a line, by NumPy."""

import numpy as np


def over_mean_plane(points, one, other):
    """Coordinates (n, d) in and over the mean of two planes, from the mean of the points."""
    up = one + np.where(one @ other < 0, -1.0, 1.0) * other
    axes = np.linalg.svd(up[None])[2]
    return (points - points.mean(axis=0)) @ np.column_stack([*axes[1:], up / np.linalg.norm(up)])


def off_plane(points, weights):
    """Distances (n,) above the plane that is nearest to the weighted points."""
    gaps = points - weights @ points / weights.sum()
    normal = np.linalg.eigh((gaps * weights[:, None]).T @ gaps)[1][:, 0]
    return gaps @ normal * np.where(normal[-1] < 0, -1.0, 1.0)


def off_quadric(flat, heights, weights):
    """Distances (n,) above the quadric that fits heights best, by its slopes at their places."""
    n, d = flat.shape
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    terms = np.column_stack([np.ones(n), flat, *(flat[:, i] * flat[:, j] for i, j in pairs)])
    root = np.sqrt(weights)
    solution = np.linalg.lstsq(terms * root[:, None], heights * root)[0]
    slopes = np.tile(solution[1 : d + 1], (n, 1))
    for (i, j), bend in zip(pairs, solution[d + 1 :], strict=True):
        slopes[:, i] += bend * flat[:, j]
        slopes[:, j] += bend * flat[:, i]
    return (heights - terms @ solution) / np.sqrt(1 + np.square(slopes).sum(axis=1))


def fit_crease(flat, heights, weights, first):
    """Two planes that meet in a line: the least sum of squares, the side of each point, the
    distances above these, and those (2, n) above the planes that were fitted last."""
    points, side, best = np.column_stack([flat, heights]), first, (np.inf, first, heights)
    above = np.full((2, len(heights)), np.nan)
    for turn in range(9):
        if min(side.sum(), (~side).sum()) <= flat.shape[1] + 1:
            break
        above = np.stack([off_plane(points, weights * of) for of in (~side, side)])
        if turn == 0:
            upper = np.mean(side == (above[1] < above[0])) > 0.5
        before, side = side, (above[1] < above[0]) == upper
        rest = np.where(side, above[1], above[0])
        if turn and (left := weights @ rest**2) < best[0]:
            best = left, side, rest
        if turn and (side == before).all():
            break
    return *best, above
