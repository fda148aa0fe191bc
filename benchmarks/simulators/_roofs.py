"""Simulated roofs of 2 by 2 (hip roofs 2 by 3), in an oblique pose; noise is upright."""

import numpy as np

ROOFS = ("gable", "hip", "mansard", "barrel")


def make_roof(kind, n, crease, noise, seed=0):
    """Points (n, 3) and the surface of each.

    The normals of adjoining faces differ by `crease` degrees, but for a hip roof, whose faces all
    have half that slope. A barrel turns by twice `crease`. `noise` is its standard deviation over
    the spacing.
    """
    rng = np.random.default_rng([seed, n, round(crease), ROOFS.index(kind)])
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
    return X @ _pose().T, surface.astype(int)


def roof_edges(kind, n, crease, noise, seed=0):
    """Points of a roof (n, 3), distances from its ridges, hips and breaks, and the spacing."""
    X, _ = make_roof(kind, n, crease, noise, seed)
    length = 3.0 if kind == "hip" else 2.0
    x, y = (X @ _pose())[:, :2].T
    slope = np.tan(np.radians(crease if kind == "mansard" else crease / 2))
    if kind == "hip":
        # Lines from each end of the ridge to the corners.
        ends = np.array([[0.0, s * (length / 2 - 1), slope] for s in (-1, 1)])
        corners = [[side, np.sign(end[1]) * length / 2, 0] for end in ends for side in (-1, 1)]
        lines = [ends, *zip(ends[[0, 0, 1, 1]], np.array(corners), strict=True)]
        z = slope * np.min([1 - x, 1 + x, length / 2 - y, length / 2 + y], axis=0)
        on_faces = np.column_stack([x, y, z])
        distance = np.min([_from_segment(on_faces, *line) for line in lines], axis=0)
    else:
        beyond = np.abs(x) - (0.5 if kind == "mansard" else 0.0)
        distance = np.where(beyond > 0, beyond * np.sqrt(1 + slope**2), -beyond)
    return X, distance, np.sqrt(2 * length / n)


def _from_segment(points, begin, end):
    along = np.clip((points - begin) @ (end - begin) / np.sum((end - begin) ** 2), 0, 1)
    return np.linalg.norm(points - begin - along[:, None] * (end - begin), axis=1)


def _pose():
    return np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
