"""Do the error bars of planes hold, and are detectable biases detected?

"coverage" is the share of simulated planes of 5 x 5 m with 4 mm of noise whose true value is inside
the 95 % region a posteriori: of the normal (its ellipse), of the distance, the tilt and the slopes.
A fifth of the points stands ten standard deviations off on one side where the table says so; then
the start is robust. "detected" is the rate at which a minimal detectable bias of power 0.8 is
rejected. Seeds are fixed.

    python benchmarks/bench_reliability.py coverage
    python benchmarks/bench_reliability.py detected
"""

import argparse
from itertools import product

import numpy as np
from _tables import print_table

from sklearn_mcmd import BaardaPlaneDetector
from sklearn_mcmd.adjustment._precision import quantile

NOISE, OFF, SHARE = 0.004, 10, 0.2
NORMAL = np.array([-0.3, 0.2, 1.0]) / np.linalg.norm([-0.3, 0.2, 1.0])
PLACE = np.array([3.0, 1.0, 2.0])


def cloud(rng, n, surface, n_off):
    X = rng.uniform(-2.5, 2.5, (n, 2)) @ np.linalg.svd(NORMAL[None])[2][1:] + PLACE
    across = np.array([0, 0, 1.0]) if surface == "vertical" else NORMAL
    X += rng.normal(0, NOISE, n)[:, None] * across if surface == "vertical" else 0
    X += rng.normal(0, NOISE, (n, 3)) if surface == "orthogonal" else 0
    X[:n_off] += OFF * NOISE * across
    return X


def inside(detector):
    """Whether the true normal, distance, tilt and both slopes are in their 95 % regions."""
    precision = detector.precision()
    error = np.degrees(precision.ellipse_axes.T @ (detector.normal_ - NORMAL))
    t = quantile(0.95, precision.dof)
    tilt = np.degrees(np.arccos(NORMAL[2]))
    slopes = np.abs(detector.coef_ + NORMAL[:2] / NORMAL[2])
    return (
        np.linalg.norm(error / precision.ellipse) <= precision.confidence_factor(0.95),
        abs(detector.distance_ - NORMAL @ PLACE) <= t * np.sqrt(precision.covariance[-1, -1]),
        abs(precision.tilt - tilt) <= t * precision.tilt_error,
        *(slopes <= t * np.sqrt(np.diag(precision.slopes_covariance)[:2])),
    )


def coverage(options):
    rows = []
    for n, surface, share in product(options.sizes, ("vertical", "orthogonal"), (0, SHARE)):
        rng = np.random.default_rng([n, len(surface), share > 0])
        detector = BaardaPlaneDetector(
            sigma0=NOISE, surface=surface, robust_start=share > 0, random_state=0
        )
        size = min(options.planes, 20_000_000 // n)
        clouds = (cloud(rng, n, surface, int(share * n)) for _ in range(size))
        rates = np.mean([inside(detector.fit(X)) for X in clouds], axis=0)
        rows.append([f"{n:,}, {surface}, {share:.0%} of outliers", *rates, size])
    head = ["points", "normal", "distance", "tilt", "slope x", "slope y", "planes"]
    print_table("coverage", head, rows, digits=3)


def detected(options):
    n_draws, rows = 20 * options.planes, []
    for n, test in product((10, 30, 100), ("w", "tau")):
        rng = np.random.default_rng(n)
        X = cloud(rng, n, "vertical", 0)
        detector = BaardaPlaneDetector(0.001, sigma0=NOISE, correction="none", test=test)
        told = detector.fit(X).reliability(X)
        A = np.column_stack([X[:, :2], np.ones(n)])
        R = np.eye(n) - A @ np.linalg.pinv(A)
        draws, at = np.arange(n_draws), rng.integers(n, size=n_draws)
        noise = rng.normal(0, 1, (n_draws, n))
        unit = detector.precision().scale if test == "tau" else NOISE
        noise[draws, at] += told.minimal_bias[at] / unit
        v = noise @ R
        statistic = np.abs(v[draws, at]) / np.sqrt(np.diag(R)[at])
        if test == "tau":
            statistic = statistic / np.sqrt((v**2).sum(axis=1) / (n - 3))
        rate = float(np.mean(statistic > detector.critical_value_))
        rows.append([f"{n}, {test}", rate, float(np.sqrt(0.16 / n_draws))])
    print_table("detected", ["points, test", "rate", "±"], rows, digits=4)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = {"coverage": coverage, "detected": detected}
    parser.add_argument("parts", nargs="*", default=list(parts), help=", ".join(parts))
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 20, 100, 10_000])
    parser.add_argument("--planes", type=int, default=10_000, help="of each size")
    options = parser.parse_args(arguments)
    for part in options.parts:
        parts[part](options)


if __name__ == "__main__":
    main()
