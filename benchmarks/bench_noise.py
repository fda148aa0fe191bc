"""How noisy may a cloud be, in spacings, until the detector finds no surfaces?

A square plane of spacing 1 has Gaussian noise and 5 % of outliers. These lie up to 20 spacings off
it, and farther than 5 standard deviations. Shares are in percent: the points of the plane that lie
on a surface, and for two strictnesses those that are lost and the outliers that are found.

    python benchmarks/bench_noise.py
"""

import argparse

import numpy as np

from sklearn_mcmd import MCMDOutlierDetector


def noisy_plane(n, noise, rng):
    """Points, and which of them are of the plane."""
    side = np.sqrt(n)
    plane = np.column_stack([rng.uniform(0, side, (n, 2)), rng.normal(0, noise, n)])
    heights = rng.uniform(5 * noise, 20, n // 20) * rng.choice([-1, 1], n // 20)
    outliers = np.column_stack([rng.uniform(0, side, (n // 20, 2)), heights])
    return np.vstack([plane, outliers]), np.arange(n + n // 20) < n


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--neighbors", type=int, nargs="+", default=[50, 100, 200])
    noises = [0.1, 0.3, 0.5, 0.6, 0.7, 0.8, 1.0, 1.5, 2.5]
    parser.add_argument("--noise", type=float, nargs="+", default=noises)
    parser.add_argument("--points", type=int, default=20_000)
    options = parser.parse_args()
    print("  k  noise  on surface     groups: lost    found   surfaces: lost    found")
    for k in options.neighbors:
        for noise in options.noise:
            X, real = noisy_plane(options.points, noise, np.random.default_rng(0))
            row = []
            for strictness in ("groups", "surfaces"):
                detector = MCMDOutlierDetector(k, strictness=strictness, random_state=0, n_jobs=-1)
                flagged = detector.fit_predict(X) == -1
                row += [100 * flagged[real].mean(), 100 * flagged[~real].mean()]
            on = 100 * detector.on_surface_[real].mean()
            print(
                f"{k:3}  {noise:5}  {on:10.1f}  {row[0]:15.1f}  {row[1]:7.1f}"
                f"  {row[2]:15.1f}  {row[3]:7.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
