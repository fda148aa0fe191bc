"""Clouds of PCPNet's benchmark of normals: files where there are any, and made ones elsewhere.

A shape has six kinds of clouds: without noise, with Gaussian noise of 0.12, 0.6 and 1.2 % of the
diagonal of its bounding box, and two of uneven density. Each kind is a pair NAME.xyz and
NAME.normals; NAME.pidx holds the rows that count. A missing kind is made from the one without
noise. Density is then made by leaving points out, so such a cloud has fewer points.
"""

import re
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

CLEAN = "none"
# PCPNet's own names, and those of sets that write noise as a share of the diagonal.
KINDS_BY_SUFFIX = {
    "noise_white_1.00e-02": "0.12 %",
    "noise_white_5.00e-02": "0.6 %",
    "noise_white_1.00e-01": "1.2 %",
    "noise_white_1.20e-03": "0.12 %",
    "noise_white_6.00e-03": "0.6 %",
    "noise_white_1.20e-02": "1.2 %",
    "ddist_minmax_layers": "stripes",
    "ddist_minmax": "gradient",
}
N_STRIPES = 8
LEAST_SHARE = 0.1  # of the points, kept where stripes and gradient are thinnest
# How likely a point is kept, by its place 0 ... 1 along the longest side of the bounding box.
DENSITIES = {
    "stripes": lambda place: np.where(np.sin(2 * np.pi * N_STRIPES * place) > 0, 1, LEAST_SHARE),
    "gradient": lambda place: LEAST_SHARE + (1 - LEAST_SHARE) * place,
}


class BenchmarkError(ValueError):
    """A folder or a file that the benchmark cannot use; the message says why."""


class BenchmarkCloud(NamedTuple):
    """A cloud with its true normals, and the rows on which normals are judged.

    shape : name of the shape
    kind : "none", a noise such as "0.12 %", "stripes" or "gradient"
    points : float64 (n, 3)
    normals : float64 (n, 3), of unit length
    rows : int (m,)
    made : whether noise or density was made here
    """

    shape: str
    kind: str
    points: np.ndarray
    normals: np.ndarray
    rows: np.ndarray
    made: bool


def benchmark_clouds(folder, kinds, n_points=5000, names=None):
    """Yield each shape of a folder in each of the kinds.

    Parameters
    ----------
    folder : path
        With pairs NAME.xyz and NAME.normals, or with NAME.npz that holds ``xyz`` and ``normals``.
    kinds : list of str
        As `noise_kind` names them, "stripes" and "gradient".
    n_points : int
        Rows that count: the first ones of NAME.pidx, or random ones if there is no such file.
    names : list of str or None
        Names of the files to take, as in the benchmark's testset_all.txt. None means all.

    Yields
    ------
    BenchmarkCloud

    Raises
    ------
    BenchmarkError
        If the folder has no pair, if a name is missing, or if a file cannot be used.
    """
    for shape, paths in paths_by_shape(folder, names).items():
        clean = None
        for kind in kinds:
            if kind in paths:
                cloud = read_cloud(paths[kind], shape, kind)
                if kind == CLEAN:
                    clean = cloud
            elif CLEAN in paths:
                clean = clean or read_cloud(paths[CLEAN], shape, CLEAN)
                cloud = made_cloud(clean, kind)
            else:
                continue
            yield with_rows(cloud, n_points)


def noise_kind(level):
    """Name of a noise, given in percent of the diagonal."""
    return f"{level:g} %" if level else CLEAN


def paths_by_shape(folder, names=None):
    """Paths of the clouds in a folder: {shape: {kind: path}}.

    Files of noise and density that the benchmark's test set does not have are left out.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BenchmarkError(f"{folder} is no folder.")
    files = {path.stem: path for path in sorted(folder.glob("*.xyz")) if partner(path).exists()}
    for path in sorted(folder.glob("*.npz")):
        files.setdefault(folder.resolve().name if path.stem == "cloud" else path.stem, path)
    if not files:
        raise BenchmarkError(f"{folder} has no pair NAME.xyz and NAME.normals.")
    missing = [name for name in names or [] if name not in files]
    if missing:
        raise BenchmarkError(f"{folder} has no pair {missing[0]}.xyz and {missing[0]}.normals.")
    shapes = {}
    for name in files if names is None else names:
        shape, kind = shape_and_kind(name)
        if kind is not None:
            shapes.setdefault(shape, {})[kind] = files[name]
    if not shapes:
        raise BenchmarkError(f"{folder} has no kind of cloud that the benchmark has.")
    return shapes


def shape_and_kind(name):
    """Shape and kind that the name of a file says; the kind is None if the test set lacks it."""
    shape, suffix = re.fullmatch(r"(.+?)(?:_(noise_.+|ddist_.+))?", name).groups()
    return shape, CLEAN if suffix is None else KINDS_BY_SUFFIX.get(suffix)


def partner(path):
    return path.with_name(f"{path.stem}.normals")


def read_cloud(path, shape, kind):
    """The cloud of a file; `rows` are those of its .pidx, or None."""
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            if not {"xyz", "normals"} <= set(arrays):
                raise BenchmarkError(f"{path} has no arrays xyz and normals.")
            points, normals = (arrays[name].astype(np.float64) for name in ("xyz", "normals"))
        of_normals = path
    else:
        of_normals = partner(path)
        points, normals = read_triples(path), read_triples(of_normals)
    if len(points) != len(normals):
        raise BenchmarkError(f"{path} has {len(points)} points, but {len(normals)} normals.")
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    n_zero = np.count_nonzero(lengths == 0)
    if n_zero:
        raise BenchmarkError(f"{of_normals} has {n_zero} normals of length zero.")
    rows = read_rows(path.with_name(f"{path.stem}.pidx"), len(points))
    return BenchmarkCloud(shape, kind, points, normals / lengths, rows, False)


def read_triples(path):
    """Three finite numbers a line."""
    try:
        numbers = np.loadtxt(path, ndmin=2)
    except ValueError as error:
        raise BenchmarkError(f"{path} is no table of numbers: {error}") from error
    if numbers.shape[1] != 3 or not np.isfinite(numbers).all():
        raise BenchmarkError(f"{path} needs three finite numbers in each line.")
    return numbers


def read_rows(path, n):
    """Rows of a .pidx, counted from 0; None if there is no such file."""
    if not path.exists():
        return None
    rows = np.loadtxt(path, ndmin=1).astype(np.intp)
    if len(rows) == 0 or rows.min() < 0 or rows.max() >= n:
        raise BenchmarkError(f"{path} needs rows from 0 to {n - 1}.")
    return rows


def made_cloud(clean, kind):
    """A cloud of a kind that has no file, from the one without noise."""
    rng = seeded(clean.shape, kind)
    if kind not in DENSITIES:
        diagonal = np.linalg.norm(np.ptp(clean.points, axis=0))
        deviation = float(kind.removesuffix(" %")) / 100 * diagonal
        points = clean.points + rng.normal(0, deviation, clean.points.shape)
        return clean._replace(kind=kind, points=points, made=True)
    sides = np.ptp(clean.points, axis=0)
    heights = clean.points[:, sides.argmax()]
    place = (heights - heights.min()) / sides.max()
    kept = rng.random(len(place)) < DENSITIES[kind](place)
    points, normals = clean.points[kept], clean.normals[kept]
    return BenchmarkCloud(clean.shape, kind, points, normals, None, True)


def with_rows(cloud, n_points):
    """The cloud with as many rows as asked for, or all if it has fewer."""
    if cloud.rows is not None:
        return cloud._replace(rows=cloud.rows[:n_points])
    n = len(cloud.points)
    rng = seeded(cloud.shape, cloud.kind, "rows")
    return cloud._replace(rows=rng.choice(n, min(n_points, n), replace=False))


def seeded(*names):
    """Random numbers that depend on names only, and not on the other shapes of a folder."""
    return np.random.default_rng([zlib.crc32(name.encode()) for name in names])
