"""Literal forms of one bent surface and of two planes that meet in a line, by NumPy."""

import numpy as np


def over_mean_plane(points, one, other):
    """Coordinates (n, d) in and over the mean of two planes, from the mean of the points."""
    up = one + np.where(one @ other < 0, -1.0, 1.0) * other
    axes = np.linalg.svd(up[None])[2]
    return (points - points.mean(axis=0)) @ np.column_stack([*axes[1:], up / np.linalg.norm(up)])


def fit(terms, heights, weights):
    """What the best sum of terms is at all points; weights are inverse variances, 0 for none."""
    root = np.sqrt(weights)
    return terms @ np.linalg.lstsq(terms * root[:, None], heights * root)[0]


def plane_terms(flat):
    return np.column_stack([np.ones(len(flat)), flat])


def quadric_terms(flat):
    """The terms of a quadric over places (n, d - 1)."""
    d = flat.shape[1]
    pairs = [(i, j) for i in range(d) for j in range(i, d)]
    return np.column_stack([plane_terms(flat), *(flat[:, i] * flat[:, j] for i, j in pairs)])


def fit_crease(flat, heights, weights, first, rounds):
    """Two planes that meet in a line: the least sum of squares, the side of each point, the heights
    above these, and the heights (2, n) above the planes that were fitted last."""
    terms, side, best = plane_terms(flat), first, (np.inf, first, heights)
    above = np.full((2, len(heights)), np.nan)
    for turn in range(rounds + 1):
        if min(side.sum(), (~side).sum()) <= flat.shape[1] + 1:
            break
        above = np.stack([heights - fit(terms, heights, weights * of) for of in (~side, side)])
        if turn == 0:
            upper = np.mean(side == (above[1] < above[0])) > 0.5
        before, side = side, (above[1] < above[0]) == upper
        rest = np.where(side, above[1], above[0])
        if turn and (left := weights @ rest**2) < best[0]:
            best = left, side, rest
        if turn and (side == before).all():
            break
    return *best, above
