"""How large are errors of normals near edges, away from edges and on curved surfaces?

The tables have mean, median and 95 % of the angle to the true normal in degrees, and the share
within 10 degrees. They compare least squares (as in Open3D, PCL and pgeof), the paper's form, the
default without borrowed planes, and the default. "Near" is within four spacings of an edge. "True
planes" knows the plane of every face and gives each point the nearest one. With noise, no method
can do better next to an edge.

"curvatures" prints the median error of the mean curvature, as a share of the larger principal one,
and the shares of points whose curvatures are within three standard errors.

"errors" prints the shares in percent of points whose true normals are within 1.73 standard errors:
within 4 spacings of a crease, on a fillet or on a bend; and on flat ground beside these, and the
median error there over what would cover 95 %.

"halves" cuts each real cloud of 5,000 points and more in two at random. Both halves tell the
normals at the points of the first: shares in percent of angles that are within 1.73 times the root
of both squared errors, and the median of that root.

"pcpnet" follows PCPNet's benchmark: the root mean square of the angle over 5,000 points of each
shape, by kinds of noise and density. It takes a folder of NAME.xyz, NAME.normals and, if there are
any, NAME.pidx. "Best k" are oracles, which know the true normals and choose among 11 sizes.

    python benchmarks/bench_normals.py streets --seeds 3
    python benchmarks/bench_normals.py curved
    python benchmarks/bench_normals.py curvatures --n-neighbors 30 50
    python benchmarks/bench_normals.py errors
    python benchmarks/bench_normals.py halves
    python benchmarks/bench_normals.py clouds ../shared/data/cad_*/cloud.npz --n-neighbors 30 50
    python benchmarks/bench_normals.py clouds ../shared/data/cad_a*/cloud.npz --noise 0.2
    python benchmarks/bench_normals.py pcpnet ../shared/data/pcpnet_bunny
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _ablation_clouds import spacing_of
from _pcpnet import KINDS, benchmark_clouds
from _real_clouds import load_clouds
from _tables import print_table
from scipy.spatial import cKDTree

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle

FORMS = {
    "least squares": {"method": "pca"},
    "paper (literal)": {"reweight": False},
    "own planes": {"neighbor_planes": False},
    "default": {},
    "auto": {"n_neighbors": "auto"},
}
NEAR = 4.0  # spacings
WITHIN = 1.73  # standard errors that hold 95 %
# Degrees by which two faces turn, and radius of the fillet between them in spacings.
BENDS = ((90, 0), (60, 0), (30, 0), (15, 0), (5, 0), (90, 6), (45, 6), (30, 3), (90, 12), (120, 15))
PCA_NEIGHBORS = (8, 12, 18, 32, 50, 80, 112, 160, 250, 360, 500)


class Scene(NamedTuple):
    """Points, true normals, which count and which are near edges, and points without noise."""

    name: str
    data: np.ndarray
    normals: np.ndarray
    regular: np.ndarray
    near: np.ndarray
    faces: np.ndarray | None = None


def fitted(X, **form):
    return RobustNormalEstimator(**{"random_state": 0, "n_jobs": -1} | form).fit(X)


def streets(options):
    for seed in range(options.seeds):
        street = make_street(options.size, outlier_share=options.share, random_state=seed)
        name = f"street {seed}, {options.size:,} points, {100 * options.share:g} % outliers"
        near = street.edge_distance < NEAR * street.spacing
        yield Scene(name, street.data, street.normals, street.target == 1, near, street.true_points)


def clouds(options):
    for path in options.clouds:
        with np.load(path) as arrays:
            X, normals = arrays["xyz"].astype(np.float64), arrays["normals"]
            distance = arrays["edge_dist"]
        spacing = spacing_of(X)
        name = f"{Path(path).parent.name}, noise {options.noise:g} spacings"
        noise = np.random.default_rng(0).normal(0, options.noise * spacing, X.shape)
        everyone = np.ones(len(X), dtype=bool)
        yield Scene(name, X + noise, normals, everyone, distance < NEAR * spacing, X)


def curved(options):
    for noise in (0.0, 0.005):
        for make in (ball, pipe, ring):
            rng = np.random.default_rng(0)
            X, normals = make(options.size, rng)
            X = X + rng.normal(0, noise, X.shape)
            everyone = np.ones(len(X), dtype=bool)
            yield Scene(f"{make.__name__}, noise {noise:g}", X, normals, everyone, ~everyone)


def compare(options):
    """Print a table for each scene and size of neighborhoods."""
    for scene in options.scenes(options):
        for k in options.n_neighbors:
            found = {
                name: fitted(scene.data, **{"n_neighbors": k} | form).normals_
                for name, form in FORMS.items()
            }
            if scene.faces is not None:
                found["true planes"] = nearest_true_planes(scene, k)
            parts = [scene.regular & scene.near, scene.regular & ~scene.near]
            parts = [part for part in parts if part.any()]
            rows = []
            for name, normals in found.items():
                angle, row = bias_angle(normals, scene.normals), [name]
                for a in (angle[part] for part in parts):
                    row += [a.mean(), np.median(a), np.quantile(a, 0.95), 100 * np.mean(a < 10)]
                rows.append(row)
            places = ["near edges", "elsewhere"][-len(parts) :]
            head = [word for place in places for word in (place, "median", "95 %", "< 10, %")]
            print_table(f"{scene.name}, n_neighbors={k}", ["degrees", *head], rows, digits=2)


def nearest_true_planes(scene, n_neighbors):
    """Normals of the true planes around that are nearest to each point."""
    rows = np.flatnonzero(scene.regular)
    _, found = cKDTree(scene.data[rows]).query(scene.data, n_neighbors)
    found = rows[found]
    gaps = scene.data[:, None] - scene.faces[found]
    heights = np.abs(np.einsum("nkd,nkd->nk", gaps, scene.normals[found]))
    return scene.normals[found[np.arange(len(found)), heights.argmin(axis=1)]]


def curvatures(options):
    """Print a row for each shape, noise in spacings and size of neighborhoods."""
    names = [f"{name}_curvature{end}" for end in ("", "_error") for name in ("mean", "max", "min")]
    rows = []
    for make, area in ((ball, 4 * np.pi), (pipe, 12 * np.pi), (ring, 1.2 * np.pi**2)):
        for noise in (0.0, 0.1, 0.3):
            rng = np.random.default_rng(0)
            X, normals = make(options.size, rng)
            most, least = true_curvatures(make, X)
            inside = np.abs(X[:, 2] - 3) < 2.5 if make is pipe else np.ones(len(X), dtype=bool)
            X = X + rng.normal(0, noise * np.sqrt(area / len(X)), X.shape)
            for k in options.n_neighbors:
                estimator = fitted(X, n_neighbors=k, features=names)
                inward = (np.einsum("nd,nd->n", estimator.normals_, normals) < 0)[:, None]
                found, errors = np.hsplit(estimator.features_, 2)
                found = np.where(inward, found, -found[:, [0, 2, 1]])
                errors = np.where(inward, errors, errors[:, [0, 2, 1]])
                gaps = np.abs(found - np.column_stack([(most + least) / 2, most, least]))[inside]
                within = 100 * (gaps <= 3 * errors[inside]).mean(axis=0)
                median = 100 * np.median(gaps[:, 0] / most[inside])
                rows.append([f"{make.__name__}, {noise:g}, k = {k}", median, *within])
    print_table("percent", ["", "median error", "mean within 3", "larger", "smaller"], rows)


def true_curvatures(make, X):
    """Principal curvatures from within; of the ring 1 / 0.3 and cos v / (1 + 0.3 cos v)."""
    if make is not ring:
        return np.ones(len(X)), np.full(len(X), 1.0 if make is ball else 0.0)
    center_distance = np.linalg.norm(X[:, :2], axis=1)
    return np.full(len(X), 1 / 0.3), (center_distance - 1) / 0.3 / center_distance


def ball(n, rng):
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals.copy(), normals


def pipe(n, rng):
    angle = rng.uniform(0, 2 * np.pi, n)
    normals = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    return normals + np.column_stack([np.zeros((n, 2)), rng.uniform(0, 6, n)]), normals


def ring(n, rng):
    u, v = rng.uniform(0, 2 * np.pi, (2, n))
    normals = np.column_stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])
    return 0.3 * normals + np.column_stack([np.cos(u), np.sin(u), np.zeros(n)]), normals


def errors(options):
    """Print a row for each bend, noise in spacings and size of neighborhoods."""
    rows = []
    for angle, radius in BENDS:
        for noise in (0.05, 0.2):
            X, normals, away = two_faces(angle, radius, noise, options.size)
            for k in options.n_neighbors:
                found = fitted(X, n_neighbors=k)
                off, error = bias_angle(found.normals_, normals), found.normal_error_
                held, far = off <= WITHIN * error, away > 2 * NEAR
                near = away < (0 if radius else NEAR)
                name = f"{angle} degrees, radius {radius}, noise {noise:g}, k = {k}"
                ratio = np.median(error[far]) * WITHIN / np.quantile(off[far], 0.95)
                rows.append([name, 100 * held[near].mean(), 100 * held[far].mean(), ratio])
    print_table("percent", ["", "there", "flat ground", "error over right one"], rows, digits=2)


def halves(options):
    """Print a row for each real cloud; without what publishers call noise and rays that return
    nothing, which are at the origin."""
    rows = []
    for cloud in load_clouds(options.data, limit=60_000):
        X = cloud.points if cloud.noise is None else cloud.points[~cloud.noise]
        X = X[X.any(axis=1)]
        if len(X) < 5_000:
            continue
        first, row = np.random.default_rng(options.seed).random(len(X)) < 0.5, [cloud.name]
        for k in (16, 50, "auto"):
            here, there = (
                fitted(half, n_neighbors=k, features=["normal_error"])
                for half in (X[first], X[~first])
            )
            told = there.transform(X[first])
            error = np.hypot(here.normal_error_, told[:, -1])
            off = bias_angle(here.normals_, told[:, 3:6])
            held = off <= np.maximum(WITHIN * error, 1e-3)  # an error of 0 holds for equal numbers
            row += [100 * held.mean(), np.median(error)]
        rows.append(row)
    head = [f"{k}{word}" for k in (16, 50, "auto") for word in ("", ", error")]
    print_table("halves", ["percent, degrees", *head], rows, digits=1)


def two_faces(angle, radius, noise, n, half=15.0):
    """Faces that turn along an arc, one point on each unit of area: points, normals, and distances
    from the arc, NaN near the borders."""
    rng, end = np.random.default_rng(5), np.radians(angle) / 2
    most = half + radius * end
    section, along = rng.uniform(-most, most, n), rng.uniform(0, n / (2 * most), n)
    turn = np.clip(section / max(radius, 1e-9), -end, end)
    rest = np.sign(section) * np.maximum(np.abs(section) - radius * end, 0)
    normals = np.column_stack([np.sin(turn), np.zeros(n), np.cos(turn)])
    X = (
        radius * normals
        + rest[:, None] * normals[:, ::-1] * [1, 1, -1]
        + along[:, None] * [0, 1, 0]
    )
    inner = (along > 5) & (along < along.max() - 5) & (np.abs(section) < most - 5)
    away = np.where(inner, np.abs(section) - radius * end, np.nan)
    return X + noise * rng.normal(size=(n, 1)) * normals, normals, away


def pcpnet(options):
    """Print the RMSE of each method, averaged over the shapes, by kinds, and over the kinds."""
    squares = {}
    for cloud in benchmark_clouds(options.folder, KINDS, options.points):
        for name, angles in angles_of(cloud).items():
            rmse = np.sqrt(np.mean(np.square(angles)))
            squares.setdefault(name, {}).setdefault(cloud.kind, []).append(rmse)
    rows = []
    for name, by_kind in squares.items():
        means = [np.mean(of_shapes) for of_shapes in by_kind.values()]
        rows.append([name, *means, np.mean(means)])
    print_table("RMSE in degrees", ["", *by_kind, "average"], rows, digits=2)


def angles_of(cloud):
    """Angles at the rows of a cloud, by the name of the method."""
    truth, places = cloud.normals[cloud.rows], cloud.points[cloud.rows]
    _, near = cKDTree(cloud.points).query(places, min(PCA_NEIGHBORS[-1], len(cloud.points)))
    members = cloud.points[near] - places[:, None]
    by_size = {k: bias_angle(pca_normals(members[:, :k]), truth) for k in PCA_NEIGHBORS}
    best = min(by_size, key=lambda k: np.square(by_size[k]).mean())
    ours = {"default": {}, "default form, k = 112": {"n_neighbors": 112}, "auto": FORMS["auto"]}
    return {
        **{f"PCA, k = {k}": angles for k, angles in by_size.items()},
        "PCA, best k of the cloud": by_size[best],
        "PCA, best k of each point": np.min(list(by_size.values()), axis=0),
        **{
            name: bias_angle(fitted(cloud.points, **form).normals_[cloud.rows], truth)
            for name, form in ours.items()
        },
    }


def pca_normals(members):
    """Normals by least squares of neighborhoods (m, k, 3)."""
    centered = members - members.mean(axis=1, keepdims=True)
    return np.linalg.eigh(centered.transpose(0, 2, 1) @ centered)[1][:, :, 0]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    for make in (streets, curved, clouds, curvatures, errors):
        part = kinds.add_parser(make.__name__)
        part.set_defaults(run=make if make in (curvatures, errors) else compare, scenes=make)
        part.add_argument("--n-neighbors", type=int, nargs="+", default=[50])
        if make is clouds:
            part.add_argument("clouds", nargs="+", help="npz files with xyz, normals, edge_dist")
            part.add_argument("--noise", type=float, default=0.0, help="in spacings")
            continue
        part.add_argument("--size", type=int, default=100_000 if make is streets else 5000)
        if make is streets:
            part.add_argument("--share", type=float, default=0.1)
            part.add_argument("--seeds", type=int, default=3)
    part = kinds.add_parser("pcpnet")
    part.set_defaults(run=pcpnet)
    part.add_argument("folder", help="folder of NAME.xyz and NAME.normals, or of NAME.npz")
    part.add_argument("--points", type=int, default=5000, help="that are judged, per cloud")
    part = kinds.add_parser("halves")
    part.set_defaults(run=halves)
    part.add_argument("--data", default="../shared/data", help="folder of real clouds")
    part.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
