"""Clouds of PCPNet's benchmark of normals: files where there are any, and made ones elsewhere.

A shape has six kinds of clouds: without noise, with Gaussian noise of 0.12, 0.6 and 1.2 % of the
diagonal of its bounding box, and two of uneven density, which leave points out. Each kind is a pair
NAME.xyz and NAME.normals, with NAME.pidx for the rows that count, or a NAME.npz of one without
noise. A missing kind is made from the one without noise.
"""

import re
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

CLEAN = "none"
KINDS = (CLEAN, "0.12 %", "0.6 %", "1.2 %", "stripes", "gradient")
BY_SUFFIX = {
    "noise_white_1.00e-02": "0.12 %",
    "noise_white_5.00e-02": "0.6 %",
    "noise_white_1.00e-01": "1.2 %",
    "ddist_minmax_layers": "stripes",
    "ddist_minmax": "gradient",
}
# How likely a point is kept, by its place 0 ... 1 along the longest side of the bounding box.
DENSITIES = {
    "stripes": lambda place: np.where(np.sin(16 * np.pi * place) > 0, 1, 0.1),
    "gradient": lambda place: 0.1 + 0.9 * place,
}


class BenchmarkCloud(NamedTuple):
    """Points and unit normals (n, 3), and the rows on which normals are judged."""

    shape: str
    kind: str
    points: np.ndarray
    normals: np.ndarray
    rows: np.ndarray | None


def benchmark_clouds(folder, kinds=KINDS, n_points=5000):
    """Yield each shape of a folder in each of the kinds."""
    shapes = {}
    for path in sorted([*Path(folder).glob("*.xyz"), *Path(folder).glob("*.npz")]):
        name = Path(folder).resolve().name if path.name == "cloud.npz" else path.stem
        shape, suffix = re.fullmatch(r"(.+?)(?:_(noise_.+|ddist_.+))?", name).groups()
        if suffix is None or suffix in BY_SUFFIX:
            shapes.setdefault(shape, {}).setdefault(BY_SUFFIX.get(suffix, CLEAN), path)
    if not shapes:
        raise FileNotFoundError(f"{folder} has no pair NAME.xyz and NAME.normals, and no NAME.npz")
    for shape, paths in shapes.items():
        clean = read_cloud(paths[CLEAN], shape, CLEAN) if CLEAN in paths else None
        for kind in kinds:
            if kind in paths:
                yield with_rows(read_cloud(paths[kind], shape, kind), n_points)
            elif clean is not None:
                yield with_rows(made_cloud(clean, kind), n_points)


def read_cloud(path, shape, kind):
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            points, normals = (arrays[name].astype(np.float64) for name in ("xyz", "normals"))
    else:
        points, normals = (np.loadtxt(path.with_suffix(end)) for end in (".xyz", ".normals"))
    chosen = path.with_suffix(".pidx")
    rows = np.loadtxt(chosen, ndmin=1).astype(np.intp) if chosen.exists() else None
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return BenchmarkCloud(shape, kind, points, normals / lengths, rows)


def made_cloud(clean, kind):
    """A cloud of a kind that has no file, from the one without noise."""
    rng, sides = seeded(clean.shape, kind), np.ptp(clean.points, axis=0)
    if kind not in DENSITIES:
        deviation = float(kind.removesuffix(" %")) / 100 * np.linalg.norm(sides)
        points = clean.points + rng.normal(0, deviation, clean.points.shape)
        return clean._replace(kind=kind, points=points)
    heights = clean.points[:, sides.argmax()]
    kept = rng.random(len(heights)) < DENSITIES[kind]((heights - heights.min()) / sides.max())
    points, normals = clean.points[kept], clean.normals[kept]
    return BenchmarkCloud(clean.shape, kind, points, normals, None)


def with_rows(cloud, n_points):
    """The cloud with as many rows as asked for, or all if it has fewer."""
    if cloud.rows is not None:
        return cloud._replace(rows=cloud.rows[:n_points])
    n, rng = len(cloud.points), seeded(cloud.shape, cloud.kind, "rows")
    return cloud._replace(rows=rng.choice(n, min(n_points, n), replace=False))


def seeded(*names):
    """Random numbers that depend on names only, and not on the other shapes of a folder."""
    return np.random.default_rng([zlib.crc32(name.encode()) for name in names])
