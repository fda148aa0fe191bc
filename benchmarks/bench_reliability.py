"""Do the error bars of planes hold, are detectable biases detected, and what does it cost?

"coverage" is the share of simulated planes of 5 x 5 m with 4 mm of noise whose true value is inside
the 95 % region a posteriori: of the normal (its ellipse), of the distance, the tilt and the slopes.
A fifth of the points stands ten standard deviations off on one side where the table says so; then
the start is robust. "detected" is the rate at which a minimal detectable bias of power 0.8 is
rejected. "cost" is the time of data snooping, standard errors, bands and reliability of a million
points over that of np.linalg.lstsq, and of plans of 10,000 repetitions. Seeds are fixed. The tables
are those of docs/reliability.rst.

    python benchmarks/bench_reliability.py coverage
    python benchmarks/bench_reliability.py detected cost
"""

import argparse
import time

import numpy as np

from sklearn_mcmd import BaardaPlaneDetector
from sklearn_mcmd.adjustment import plan_plane
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


def coverage(n_planes):
    print(f"{'points':>8} {'surface':<12}{'outliers':>9}{'normal':>9}{'distance':>10}{'tilt':>8}"
          f"{'slopes':>16}{'planes':>9}")  # fmt: skip
    for n in (10, 20, 100, 10_000):
        for surface in ("vertical", "orthogonal"):
            for share in (0, SHARE):
                rng = np.random.default_rng([n, len(surface), share > 0])
                detector = BaardaPlaneDetector(
                    sigma0=NOISE, surface=surface, robust_start=share > 0, random_state=0
                )
                size = min(n_planes, 20_000_000 // n)
                clouds = (cloud(rng, n, surface, int(share * n)) for _ in range(size))
                rates = np.mean([inside(detector.fit(X)) for X in clouds], axis=0)
                words = f"{rates[0]:>9.3f}{rates[1]:>10.3f}{rates[2]:>8.3f}"
                print(f"{n:>8} {surface:<12}{share:>9.0%}{words}{rates[3]:>8.3f}{rates[4]:>8.3f}"
                      f"{size:>9}", flush=True)  # fmt: skip


def detected(n_draws=200_000):
    print(f"{'points':>8} {'test':<6}{'detected':>10}{'±':>8}")
    for n in (10, 30, 100):
        for test in ("w", "tau"):
            rng = np.random.default_rng(n)
            X = cloud(rng, n, "vertical", 0)
            detector = BaardaPlaneDetector(0.001, sigma0=NOISE, correction="none", test=test)
            told = detector.fit(X).reliability(X)
            A = np.column_stack([X[:, :2], np.ones(n)])
            R = np.eye(n) - A @ np.linalg.pinv(A)
            rows, at = np.arange(n_draws), rng.integers(n, size=n_draws)
            noise = rng.normal(0, 1, (n_draws, n))
            noise[rows, at] += (
                told.minimal_bias[at]
                / detector.precision().scale
                * (1 if test == "tau" else detector.precision().scale / NOISE)
            )
            v = noise @ R
            statistic = np.abs(v[rows, at]) / np.sqrt(np.diag(R)[at])
            if test == "tau":
                statistic = statistic / np.sqrt((v**2).sum(axis=1) / (n - 3))
            rate = np.mean(statistic > detector.critical_value_)
            print(f"{n:>8} {test:<6}{rate:>10.4f}{np.sqrt(0.16 / n_draws):>8.4f}", flush=True)


def seconds(work, n=3):
    times = []
    for _ in range(n):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def cost(n=1_000_000):
    X = cloud(np.random.default_rng(0), n, "vertical", 0)
    A = np.column_stack([X[:, :2], np.ones(n)])
    unit = seconds(lambda: np.linalg.lstsq(A, X[:, 2], rcond=None))
    print(f"np.linalg.lstsq of {n:,} points: {unit:.3f} s")
    for surface in ("vertical", "orthogonal"):
        detector = BaardaPlaneDetector(sigma0=NOISE, surface=surface)
        fitting = seconds(lambda: detector.fit(X))  # noqa: B023
        rest = seconds(lambda: (detector.precision(), detector.band(X), detector.reliability(X)))  # noqa: B023
        print(f"{surface}: fit {fitting / unit:.1f}, the rest {rest / unit:.1f}, "
              f"together {(fitting + rest) / unit:.1f} times as long")  # fmt: skip
    for robust_start in (False, True):
        for rate in (0.0, 0.2):
            options = {"outlier_rate": rate, "robust_start": robust_start, "random_state": 0}
            told = seconds(lambda: plan_plane(100, **options), 1)  # noqa: B023
            start = "robust start" if robust_start else "least squares"
            print(f"plan of 100 points, {start}, outliers {rate:.0%}: {told:.1f} s", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=["coverage", "detected", "cost"])
    parser.add_argument(
        "--planes", type=int, default=10_000, help="of each size; at most 20,000,000 points"
    )
    arguments = parser.parse_args()
    for part in arguments.parts:
        {"coverage": lambda: coverage(arguments.planes), "detected": detected, "cost": cost}[part]()


if __name__ == "__main__":
    main()
