"""Neighborhoods that break careless code, in batches (B, k, 3)."""

import numpy as np


def neighborhoods(kind, n, k, seed=0):
    rng = np.random.default_rng(seed)
    return np.ascontiguousarray(KINDS[kind](rng, n, k))


def _noisy_plane(rng, n, k):
    points = rng.normal(size=(n, k, 3)) * [1, 1, 0.01]
    outliers = rng.random((n, k)) < rng.uniform(0, 0.45, (n, 1))
    points[outliers] += rng.normal(0, 1, (outliers.sum(), 3))
    return _rotate(rng, points)


def _rotate(rng, points):
    matrices, _ = np.linalg.qr(rng.normal(size=(len(points), 3, 3)))
    return points @ matrices


def _perfect_plane(rng, n, k):
    points = rng.normal(size=(n, k, 3)) * [1, 1, 0]
    points[:, : k // 5, 2] = rng.normal(size=(n, k // 5))
    return _rotate(rng, points)


def _far_away(rng, n, k):
    return _noisy_plane(rng, n, k) * 0.05 + [5e6, -3e6, 5e6]


def _duplicates(rng, n, k):
    points = _noisy_plane(rng, n, k)
    copies = rng.integers(0, k // 4, (n, k))
    return np.take_along_axis(points, copies[..., None], axis=1)


def _ties(rng, n, k):
    """A rounded plane, as files in centimeters hold it."""
    return np.round(rng.uniform(0, 1, (n, k, 3)) * [1, 1, 0.04] + [0, 0, 5], 2)


def _grid(rng, n, k):
    """Integers: exactly equal distances everywhere."""
    return rng.integers(0, 5, (n, k, 3)).astype(float) * [1, 1, 0.5]


def _two_faces(rng, n, k):
    """An edge with equally many points on both faces."""
    points = rng.uniform(0, 1, (n, k, 3))
    points[:, ::2, 0] = 0
    points[:, 1::2, 2] = 0
    return points + rng.normal(0, 1e-3, points.shape)


def _thin(rng, n, k):
    """A scan line with a few points beside it."""
    points = rng.normal(size=(n, k, 3)) * [1, 3e-3, 1e-5]
    points[:, :4] += rng.normal(0, 0.1, (n, 4, 3))
    return _rotate(rng, points)


def _one_gross_outlier(rng, n, k):
    points = _noisy_plane(rng, n, k)
    points[:, -1] *= 1e4
    return points


KINDS = {
    "noisy plane": _noisy_plane,
    "perfect plane": _perfect_plane,
    "far away": _far_away,
    "duplicates": _duplicates,
    "ties": _ties,
    "grid": _grid,
    "two faces": _two_faces,
    "thin": _thin,
    "one gross outlier": _one_gross_outlier,
}
