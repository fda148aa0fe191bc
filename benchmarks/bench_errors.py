"""Do the standard errors hold? Shares of differences within 95 % regions, in percent.

    python benchmarks/bench_errors.py --data ../shared/data
    python benchmarks/bench_errors.py regions --data ../shared/data

Each real cloud of 5,000 points and more is cut in two random halves. Both tell their numbers at the
points of the first half, and the difference is compared with the root of the sum of the squared
errors. What both halves have in common, such as a quadric that spans an edge, shows only where the
truth is known: these scenes come last. 95 % is right.

"normals" are within 1.73 errors: of all points, of those that borrow a plane, and of those whose
plane is robust or a quadric's. "regions" finds flat regions of RegionGrowing that are in both
halves, by an overlap of 80 %, and compares their heights, and their normals along the narrower
axis, which are within 1.96 errors.
"""

import argparse

import numpy as np
from _real_clouds import load_clouds
from _tables import print_table
from scipy.spatial import cKDTree

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle

WITHIN, WITHIN_1D = 1.73, 1.96
N_MOST = 60_000
OVERLAP = 0.8


def fitted(X):
    features = ["normal_error", "removed_fraction"]
    return RobustNormalEstimator(features=features, random_state=0, n_jobs=-1).fit(X)


def covered(differences, errors, within=WITHIN):
    """The share in percent, if there are any; an error of 0 holds for equal numbers."""
    held = differences <= np.maximum(within * errors, 1e-3)
    return 100 * np.mean(held) if len(held) else np.nan


def halves(X):
    first = np.random.default_rng(0).random(len(X)) < 0.5
    return X[first], X[~first]


def normals_of_halves(X):
    """Coverage by the points' planes, the share that borrows, and the median error."""
    X, Y = halves(X)
    here, there = fitted(X), fitted(Y)
    told = there.transform(X)
    angles = bias_angle(here.normals_, told[:, 3:6])
    errors = np.hypot(here.normal_error_, told[:, -2])
    borrowed = here.plane_index_ != np.arange(len(angles))
    removed = (here.removed_fraction_ > 0.1) & ~borrowed
    parts = np.ones(len(angles), bool), borrowed, removed
    shares = [covered(angles[p], errors[p]) for p in parts]
    return [*shares, 100 * borrowed.mean(), np.median(here.normal_error_)]


def normals(options):
    rows = [[name, *normals_of_halves(X)] for name, X in real(options)]
    head = ["cloud", "all", "borrowed", "robust", "share that borrows", "median error"]
    print_table("halves of clouds", head, rows)
    rows = []
    for name, X, true, counts in simulated():
        found = fitted(X)
        errors = found.normal_error_[counts]
        share = covered(bias_angle(found.normals_[counts], true[counts]), errors)
        rows.append([name, share, np.median(errors)])
    print_table("known normals", ["cloud", "all", "median error"], rows)


def regions(options):
    clouds = [*real(options), *((name, X) for name, X, *_ in simulated() if "near" not in name)]
    pairs = {name: [differences(*pair) for pair in region_pairs(*halves(X))] for name, X in clouds}
    pairs["all"] = [pair for of_cloud in pairs.values() for pair in of_cloud]
    rng, planes = np.random.default_rng(0), []
    for n in np.repeat([300, 1000, 3000], 100):
        side = rng.uniform(0.3, 1) * np.sqrt(n)
        X = rng.random((n, 3)) * [side, n / side, 0] + 0.3 * rng.normal(size=(n, 1)) * [0, 0, 1]
        growing = RegionGrowing(random_state=0).fit(X)
        largest = growing.regions_["points"].argmax()
        row = growing.regions_[largest]
        truth = {"centroid": row["centroid"] * [1, 1, 0], "normal": [0, 0, 1]}
        truth |= {"height_error": 0, "normal_error": 0}
        planes.append(differences(row, truth, X[growing.labels_ == largest]))
    pairs["simulated planes"] = planes
    rows = [[n, *100 * np.mean(found, axis=0), len(found)] for n, found in pairs.items() if found]
    print_table("flat regions in both halves", ["cloud", "heights", "normals", "regions"], rows)


def region_pairs(X, Y):
    """Rows of both tables that are of one flat region, and the points of the first."""
    here, there = (RegionGrowing(random_state=0, n_jobs=2).fit(half) for half in (X, Y))
    labels = there.labels_[cKDTree(Y).query(X)[1]]
    for region, row in enumerate(here.regions_):
        own = here.labels_ == region
        same = np.bincount(labels[own & (labels >= 0)], minlength=len(there.regions_))
        sizes = np.bincount(labels[labels >= 0], minlength=len(there.regions_))
        overlap = same / (own.sum() + sizes - same)
        if len(overlap) and overlap.max() >= OVERLAP:
            other = there.regions_[overlap.argmax()]
            if row["kind"] == other["kind"] == "plane":
                yield row, other, X[own]


def differences(row, other, own):
    """Whether height and normal of two regions agree within their errors."""
    normal, there = row["normal"], np.asarray(other["normal"])
    there = there * np.sign(normal @ there)
    gap = row["centroid"] - other["centroid"]
    height = abs(gap @ (normal + there) / 2)  # midway
    narrow = np.linalg.svd(own - own.mean(axis=0), full_matrices=False)[2][1]
    turn = np.degrees(np.arcsin(min(abs(there @ narrow), 1.0)))
    limits = [WITHIN_1D * np.hypot(row[k], other[k]) for k in ("height_error", "normal_error")]
    size = np.abs(own - own.mean(axis=0)).max()
    return height <= limits[0] + 1e-9 * size, turn <= limits[1] + 1e-6


def real(options, limit=N_MOST):
    """Names and points of the real clouds, without what the publishers call noise, and without
    points at the origin, which are rays without a return."""
    for cloud in load_clouds(options.data, limit=limit):
        X = cloud.points if cloud.noise is None else cloud.points[~cloud.noise]
        X = X[X.any(axis=1)]
        if len(X) >= 5_000:
            yield cloud.name, X


def simulated():
    """Name, points, true normals, and which points count."""
    rng = np.random.default_rng(0)
    n = 20_000
    for noise in (0.2, 0.5):
        xy = rng.random((n, 2)) * np.sqrt(n)
        X = np.column_stack([xy, noise * rng.normal(size=n)])
        yield f"plane, noise {noise}", X, np.tile([0, 0, 1.0], (n, 1)), np.ones(n, bool)
    X = X.copy()
    X[: n // 5, 2] += rng.uniform(2, 20, n // 5)
    good = np.arange(n) >= n // 5
    yield "the same, 20 % of outliers", X, np.tile([0, 0, 1.0], (n, 1)), good
    turn, along = rng.uniform(-1.2, 1.2, n), rng.random(n) * n / 144
    across = np.column_stack([np.sin(turn), np.zeros(n), np.cos(turn)])
    X = 60 * across + along[:, None] * [0, 1, 0] + 0.2 * rng.normal(size=(n, 1)) * across
    yield "half pipe, radius 60 spacings", X, across, np.abs(turn) < 1.1
    street = make_street(60_000, outlier_share=0.1, random_state=0)
    good = (street.target == 1) & np.isfinite(street.normals).all(axis=1)
    away = good & (street.edge_distance > 0.3)
    yield "street, away from edges", street.data, street.normals, away
    near = good & (street.edge_distance < 0.08)
    yield "street, near edges", street.data, street.normals, near


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = {"normals": normals, "regions": regions}
    parser.add_argument("parts", nargs="*", default=list(parts), help=", ".join(parts))
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    options = parser.parse_args(arguments)
    for part in options.parts:
        parts[part](options)


if __name__ == "__main__":
    main()
