"""How accurate and how fast are the methods that the first paper compares with?

The first table has the mean angle to the true plane in degrees, then the percentage of outliers
found and of regular points kept. It is for samples of 50 points as in section 5.1. "uLSIF" and
"qSp" are given the share of outliers. The second table has processor time for each point of a
simulated street, with neighborhoods of 50 points, and its multiple of PCA's.

    python benchmarks/bench_comparators.py
    python benchmarks/bench_comparators.py --runs 100 --shares 0.2 --outliers uniform
"""

import argparse
from time import process_time

import numpy as np

N_POINTS = 50
NOISE = 0.1  # of the samples
STREET_NOISE = 0.005  # meters
SLOW = ("robpca", "ulsif")  # timed on fewer points
# Row of the table -> method and its parameters.
ROWS = {
    "PCA": ("pca", {}),
    "RANSAC": ("ransac", {}),
    "MSAC": ("msac", {}),
    "RANSAC, noise known": ("ransac", {"noise_scale": NOISE}),
    "MSAC, noise known": ("msac", {"noise_scale": NOISE}),
    "ROBPCA": ("robpca", {}),
    "ROBPCA, projection": ("robpca", {"projection": True}),
    "uLSIF": ("ulsif", {}),
    "qSp": ("qsp", {}),
}


def samples(runs, share, outliers):
    """Points (runs, 50, 3) and which of them are regular (runs, 50)."""
    from sklearn_mcmd.datasets import make_contaminated_plane

    drawn = [
        make_contaminated_plane(
            N_POINTS, outlier_share=share, outliers=outliers, shuffle=True, random_state=seed
        )
        for seed in range(runs)
    ]
    return np.stack([X for X, _ in drawn]), np.stack([y for _, y in drawn]) == 1


def accuracy(points, regular, share):
    """Rows of cells, by name."""
    from sklearn_mcmd import RobustNormalEstimator
    from sklearn_mcmd.baselines import fit_neighborhoods
    from sklearn_mcmd.metrics import bias_angle

    estimator = RobustNormalEstimator(None, random_state=0)
    normals = np.stack([estimator.fit(sample).normals_[0] for sample in points])
    cells = {"MCMD_Z, default": f"{bias_angle(normals, [0, 0, 1]).mean():.2f}"}
    for name, (method, params) in ROWS.items():
        if method in ("ulsif", "qsp"):
            params = {"contamination": min(share, 0.5), **params}
        found = fit_neighborhoods(method, points, random_state=0, **params)
        cell = f"{bias_angle(found.normals, [0, 0, 1]).mean():.2f}"
        if share > 0:
            hits = 100 * np.mean(~found.inliers[~regular])
            cell += f", {hits:.0f} / {100 * np.mean(found.inliers[regular]):.1f}"
        cells[name] = cell
    return cells


def microseconds(method, params, n_points):
    from sklearn_mcmd import RobustNormalEstimator
    from sklearn_mcmd.datasets import make_street

    X = make_street(n_points, random_state=0).data
    if "noise_scale" in params:
        params = {**params, "noise_scale": STREET_NOISE}
    if method in ("ulsif", "qsp"):
        params = {"contamination": 0.1, **params}
    estimator = RobustNormalEstimator(
        N_POINTS, method=method, method_params=params or None, random_state=0, n_jobs=1
    )
    estimator.fit(X[: max(n_points // 20, 100)])  # loads compiled code
    start = process_time()
    estimator.fit(X)
    return 1e6 * (process_time() - start) / n_points


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=400, help="samples")
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.2, 0.4, 0.6])
    parser.add_argument("--outliers", default="clustered", choices=["clustered", "uniform"])
    parser.add_argument("--points", type=int, default=100_000, help="points of the timed street")
    options = parser.parse_args()
    columns = {}
    for share in options.shares:
        points, regular = samples(options.runs, share, options.outliers)
        columns[share] = accuracy(points, regular, share)
    print(f"{'':20}" + "".join(f"{100 * share:>19g} %" for share in columns))
    for name in next(iter(columns.values())):
        print(f"{name:20}" + "".join(f"{cells[name]:>21}" for cells in columns.values()))
    if not options.points:
        return
    print(f"\n{'':20}{'microseconds':>13}{'PCA = 1':>9}")
    unit = None
    for name, (method, params) in {**ROWS, "MCMD_Z, default": ("mcmd_z", {})}.items():
        n_points = options.points // 100 if method in SLOW else options.points
        taken = microseconds(method, params, n_points)
        unit = unit or taken
        print(f"{name:20}{taken:13.1f}{taken / unit:9.1f}", flush=True)


if __name__ == "__main__":
    main()
