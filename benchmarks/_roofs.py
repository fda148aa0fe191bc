"""Simulated roofs of 2 by 2 (hip roofs 2 by 3), in an oblique pose; noise is upright."""

import numpy as np

KINDS = ("gable", "hip", "mansard", "barrel")


def make_roof(kind, n, crease, noise, seed=0):
    """Points (n, 3) and the surface of each.

    The normals of adjoining faces differ by `crease` degrees, but for a hip roof, whose faces all
    have half that slope. A barrel turns by twice `crease`. `noise` is its standard deviation over
    the spacing.
    """
    rng = np.random.default_rng([seed, n, round(crease), KINDS.index(kind)])
    half, whole = np.tan(np.radians(crease / 2)), np.tan(np.radians(crease))
    length = 3.0 if kind == "hip" else 2.0
    x, y = rng.uniform(-1, 1, n), rng.uniform(-length / 2, length / 2, n)
    if kind == "gable":
        z, surface = -half * np.abs(x), x > 0
    elif kind == "hip":
        gaps = np.stack([1 - x, 1 + x, length / 2 - y, length / 2 + y], axis=1)
        z, surface = half * gaps.min(axis=1), gaps.argmin(axis=1)
    elif kind == "mansard":
        z, surface = -whole * np.maximum(np.abs(x) - 0.5, 0), np.digitize(x, [-0.5, 0.5])
    else:
        z, surface = np.sqrt(1 / np.sin(np.radians(crease)) ** 2 - x * x), np.zeros(n)
    spacing = np.sqrt(2 * length / n)
    X = np.column_stack([x, y, z + rng.normal(0, noise * spacing, n)])
    pose = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    return X @ pose.T, surface.astype(int)
