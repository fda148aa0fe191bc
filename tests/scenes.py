"""Clouds and scenes that several test modules build, with their truth."""

import numpy as np

from sklearn_mcmd.planes._record import Neighborhoods, Planes

# Folders of shared/data.
REAL_CLOUDS = [
    "ahn3_amsterdam_2397",
    "autzen_trim",
    "cad_angle_block",
    "cad_cube_pointfilter",
    "cad_featuretype",
    "fast_gicp_velodyne",
    "jakarto_scanlines",
    "jakarto_street_thinned",
    "laspy_plane_patch",
    "open3d_redwood_fragment",
    "pcl_building_region_growing",
    "pcl_cars_mincut",
    "pcl_lamppost",
]


def near_the_first(shared_data, name, n):
    """Of a real cloud the n points nearest to its first."""
    with np.load(shared_data / name / "cloud.npz") as arrays:
        X = arrays["xyz"]
    return X[np.argsort(np.linalg.norm(X - X[0], axis=1), kind="stable")[:n]]


def corner(n, noise=0.002):
    """Two square faces of 1 m at a right angle: points, normals, distance to the edge."""
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 1, (n, 3))
    face = np.arange(n) % 2
    X[face == 0, 2] = 0
    X[face == 1, 0] = 0
    normals = np.where(face[:, None] == 0, [0.0, 0, 1], [1.0, 0, 0])
    distance = np.where(face == 0, X[:, 0], X[:, 2])
    return X + rng.normal(0, noise, X.shape), normals, distance


def sphere(n, noise=0.0, seed=0):
    """A sphere of radius 1: points and normals."""
    rng = np.random.default_rng(seed)
    N = rng.normal(size=(n, 3))
    N /= np.linalg.norm(N, axis=1, keepdims=True)
    return N + rng.normal(0, noise, (n, 3)), N


def ball(n, center, radius, rng):
    """Points spread evenly in a ball."""
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return np.asarray(center) + radius * np.cbrt(rng.random((n, 1))) * directions


def cylinder(n, noise):
    """A pipe of radius 1 and length 6: points and normals."""
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 2 * np.pi, n)
    N = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    X = N + np.column_stack([np.zeros((n, 2)), rng.uniform(0, 6, n)])
    return X + rng.normal(0, noise, (n, 3)), N


def torus(n, noise):
    """A ring of radius 1 whose tube has radius 0.3: points and normals."""
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0, 2 * np.pi, (2, n))
    N = np.column_stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])
    X = 0.3 * N + np.column_stack([np.cos(u), np.sin(u), np.zeros(n)])
    return X + rng.normal(0, noise, (n, 3)), N


def planes_around(kind, d, n=120, m=200, k=18):
    """Points with a plane near each, queries, every second of which is a point, and their nearest.

    Returns points, queries, neighborhoods and planes, which break careless code in some kinds.
    """
    rng = np.random.default_rng(0)
    points, planes = rng.uniform(size=(n, d)), Planes.empty(n, d)
    planes.centroids[:] = points + rng.normal(0, 0.05, (n, d))
    normals = rng.normal(size=(n, d))
    planes.normals[:] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    planes.scale[:] = rng.uniform(0.01, 0.1, n)
    planes.kept[:] = rng.integers(5, 11, n) / 10
    planes.radius[:] = rng.uniform(0.2, 0.6, n)
    queries, sizes = rng.uniform(-0.1, 1.1, (m, d)), np.full(m, k)
    queries[::2] = points[rng.integers(0, n, len(queries[::2]))]
    indices = np.argsort(np.linalg.norm(queries[:, None] - points, axis=2), axis=1)[:, :k]
    if kind == "ties":  # of two copies of a plane the first neighbor's is taken
        planes = planes.take(np.arange(n) // 2)
    elif kind == "sizes":
        sizes = rng.integers(1, k + 1, m)
        indices = np.where(np.arange(k) < sizes[:, None], indices, indices[:, :1])
    elif kind == "zero scales":
        planes.scale[::2] = 0.0
    elif kind == "no planes":
        planes.scale[::3] = -1.0
    elif kind == "far away":
        queries += 10.0
    return points, queries, Neighborhoods(indices.astype(np.int32), sizes), planes
