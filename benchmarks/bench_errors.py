"""Do the standard errors of normals hold? Shares of angles within 1.73 errors, in percent.

    python benchmarks/bench_errors.py --data ../shared/data

Each real cloud of 5,000 points and more is cut in two random halves. Both tell the normals at the
points of the first half, and the angle between them is compared with the root of the sum of the
squared errors: of all points, of those that borrow a plane, and of those whose plane is robust or a
quadric's. What both halves have in common, such as a quadric that spans an edge, shows only where
the true normals are known: these come last. 95 % is right.
"""

import argparse

import numpy as np
from _real_clouds import load_clouds

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.metrics import bias_angle

WITHIN = 1.73
N_MOST = 60_000


def fitted(X):
    return RobustNormalEstimator(features=["normal_error"], random_state=0, n_jobs=2).fit(X)


def covered(angles, errors):
    """The share in percent; an error of 0 holds for equal normals."""
    return 100 * np.mean(angles <= np.maximum(WITHIN * errors, 1e-3))


def of_halves(X, rng):
    """Coverage by the points' planes, and the median error, of two halves of a cloud."""
    first = rng.random(len(X)) < 0.5
    here, there = fitted(X[first]), fitted(X[~first])
    told = there.transform(X[first])
    angles = bias_angle(here.normals_, told[:, 3:6])
    errors = np.hypot(here.normal_error_, told[:, -1])
    borrowed = here.plane_index_ != np.arange(len(angles))
    removed = (here.removed_fraction_ > 0.1) & ~borrowed
    parts = np.ones(len(angles), bool), borrowed, removed
    return [covered(angles[p], errors[p]) for p in parts], np.median(here.normal_error_), borrowed


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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    options = parser.parse_args()
    print("cloud: all, borrowed, robust; share that borrows; median error in degrees")
    for cloud in load_clouds(options.data, limit=N_MOST):
        X = cloud.points if cloud.noise is None else cloud.points[~cloud.noise]
        if len(X) >= 5_000:
            shares, error, borrowed = of_halves(X, np.random.default_rng(0))
            told = " ".join(f"{share:6.1f}" for share in shares)
            print(f"{cloud.name:34}{told}  {100 * borrowed.mean():5.1f}  {error:.2f}", flush=True)
    for name, X, normals, counts in simulated():
        found = fitted(X)
        angles = bias_angle(found.normals_[counts], normals[counts])
        errors = found.normal_error_[counts]
        print(f"{name:34}{covered(angles, errors):6.1f}  {np.median(errors):.2f}", flush=True)


if __name__ == "__main__":
    main()
