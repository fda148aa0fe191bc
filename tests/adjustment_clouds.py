"""Points of planes, with and without outliers, that several tests of adjustment take."""

import numpy as np


def random_case(seed):
    """A small contaminated cloud: scattered, gridded, heavy-tailed or far from the origin."""
    rng = np.random.default_rng(seed)
    q = int(rng.integers(1, 4))
    n = int(rng.integers(q + 4, 90))
    A = (
        rng.normal(size=(n, q)),
        rng.integers(0, 4, (n, q)).astype(float),
        rng.standard_cauchy((n, q)),
        np.round(rng.uniform(0, 10, (n, q))) + 5e5,
    )[seed % 4]
    z = A @ rng.normal(size=q) + rng.normal(size=n)
    k = int(rng.integers(0, n // 3 + 1))
    z[:k] += rng.uniform(3, 30) * (rng.choice([1, -1], k) if seed % 2 else 1)
    return np.column_stack([A, z]), rng.uniform(0.2, 5, n) if seed % 3 == 0 else None


def tilted_plane(tilt, noise, n=2000, size=(8, 3)):
    """A sheet, tilted in degrees about its first side, with equal noise in all directions."""
    rng, angle = np.random.default_rng(0), np.radians(tilt)
    along, across = rng.uniform(0, size, (n, 2)).T
    X = np.column_stack([along, across * np.cos(angle), across * np.sin(angle)])
    return X + rng.normal(0, noise, (n, 3))


def slope(n=40, noise=0.01, seed=0):
    """A plane that rises by .3 along x and falls by .2 along y."""
    rng = np.random.default_rng(seed)
    X = np.column_stack([rng.uniform(0, 5, (n, 2)), rng.normal(0, noise, n)])
    X[:, 2] += X[:, :2] @ [0.3, -0.2]
    return X


def plane_with_outliers(n=400, k=40, size=10.0, seed=0, sigma=1.0):
    rng = np.random.default_rng(seed)
    X = np.column_stack([rng.uniform(0, 10, (n, 2)), np.zeros(n)])
    X[:, 2] = X[:, :2] @ [0.5, -1] + 2 + rng.normal(scale=sigma, size=n)
    X[:k, 2] += size * sigma
    return X
