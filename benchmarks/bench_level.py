"""How often do plane tests flag a point of a clean plane, and how many outliers do they find?

The program fits simulated planes of 4 x 4 m with 4 mm of noise at alpha = 0.05. "level" is the
share of clean planes with a flagged point, which shall be 0.05. "found" is the share of outliers
that are flagged, if a tenth of the points (at least one) stands 20 standard deviations off. Seeds
are fixed. The table is that of docs/guide_planes.rst.

    python benchmarks/bench_level.py
    python benchmarks/bench_level.py --sizes 8 20 --planes 500
"""

import argparse

import numpy as np

from sklearn_mcmd import BaardaPlaneDetector

NOISE, OFF = 0.004, 20
TESTS = {
    "estimated, robust start": {"sigma0": "auto", "robust_start": True},
    "estimated": {"sigma0": "auto"},
}


def cloud(rng, n, n_outliers=0):
    """A plane with noise along z. The first points are off, all on one side."""
    X = np.column_stack([rng.uniform(0, 4, (n, 2)), rng.normal(0, NOISE, n)])
    X[:n_outliers, 2] += OFF * NOISE
    return X


def flagged(parameters, n, n_planes, n_outliers=0, surface="orthogonal"):
    """Verdicts on the points of some planes, of shape (n_planes, n)."""
    rng = np.random.default_rng([n, n_outliers])
    detector = BaardaPlaneDetector(surface=surface, random_state=0, **parameters)
    clouds = (cloud(rng, n, n_outliers) for _ in range(n_planes))
    return np.array([detector.fit_predict(X) == -1 for X in clouds])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[8, 12, 20, 50, 100, 1000, 10_000])
    parser.add_argument(
        "--planes", type=int, default=1000,
        help="of each size, a fifth of them with outliers; at most 4,000,000 points together",
    )  # fmt: skip
    parser.add_argument("--surface", choices=["orthogonal", "vertical"], default="orthogonal")
    parser.add_argument("--tests", nargs="+", choices=TESTS, default=list(TESTS))
    arguments = parser.parse_args()
    print(f"{'sigma0':<26}{'points':>8}{'level':>8}{'found':>8}")
    for name in arguments.tests:
        for n in arguments.sizes:
            task = TESTS[name], n
            n_planes = min(arguments.planes, 4_000_000 // n)
            clean = flagged(*task, n_planes, 0, arguments.surface)
            n_outliers = max(n // 10, 1)
            bad = flagged(*task, max(n_planes // 5, 1), n_outliers, arguments.surface)
            level, found = clean.any(axis=1).mean(), bad[:, :n_outliers].mean()
            print(f"{name:<26}{n:>8}{level:>8.3f}{found:>8.3f}", flush=True)


if __name__ == "__main__":
    main()
