"""How large are errors of normals near edges and away from them, and do normals know them?

The tables have mean, median and 95 % of the angle to the true normal in degrees, and the share
within 10 degrees. They compare least squares (as in Open3D, PCL and pgeof), the paper's form, the
default without borrowed planes, and the default. "Near" is within four spacings of an edge. "True
planes" knows the plane of every face and gives each point the nearest one. With noise, no method
can do better next to an edge.

"halves" cuts each real cloud of 5,000 points and more in two at random. Both halves tell the
normals at the points of the first: shares in percent of angles that are within 1.73 times the root
of both squared errors, and the median of that root.

    python benchmarks/bench_normals.py streets --seeds 3
    python benchmarks/bench_normals.py halves
    python benchmarks/bench_normals.py clouds ../shared/data/cad_*/cloud.npz --n-neighbors 30 50
    python benchmarks/bench_normals.py clouds ../shared/data/cad_a*/cloud.npz --noise 0.2
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _real_clouds import load_clouds, spacing_of
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


def compare(options):
    """Print a table for each scene and size of neighborhoods."""
    for scene in options.scenes(options):
        for k in options.n_neighbors:
            by_form = {
                name: fitted(scene.data, **{"n_neighbors": k} | form).normals_
                for name, form in FORMS.items()
            }
            if scene.faces is not None:
                by_form["true planes"] = nearest_true_planes(scene, k)
            parts = [scene.regular & scene.near, scene.regular & ~scene.near]
            parts = [part for part in parts if part.any()]
            rows = []
            for name, normals in by_form.items():
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
    _, nearest = cKDTree(scene.data[rows]).query(scene.data, n_neighbors)
    nearest = rows[nearest]
    gaps = scene.data[:, None] - scene.faces[nearest]
    heights = np.abs(np.einsum("nkd,nkd->nk", gaps, scene.normals[nearest]))
    return scene.normals[nearest[np.arange(len(nearest)), heights.argmin(axis=1)]]


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


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    for scenes in (streets, clouds):
        part = kinds.add_parser(scenes.__name__)
        part.set_defaults(run=compare, scenes=scenes)
        part.add_argument("--n-neighbors", type=int, nargs="+", default=[50])
        if scenes is clouds:
            part.add_argument("clouds", nargs="+", help="npz files with xyz, normals, edge_dist")
            part.add_argument("--noise", type=float, default=0.0, help="in spacings")
        else:
            part.add_argument("--size", type=int, default=100_000)
            part.add_argument("--share", type=float, default=0.1)
            part.add_argument("--seeds", type=int, default=3)
    part = kinds.add_parser("halves")
    part.set_defaults(run=halves)
    part.add_argument("--data", default="../shared/data", help="folder of real clouds")
    part.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
