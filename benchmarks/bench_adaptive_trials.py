"""How much time do adaptive trials save, and do they cost accuracy or breakdown?

`outlier_rate="auto"` is compared with all trials. In three dimensions estimators make all 69
trials, so the NumPy form is run on the same neighborhoods. The tables have the number of trials,
the bias angles between twins (Table 1), and the share of neighborhoods whose normal tilts by more
than 5 degrees, with 30 to 49 % of outliers of five kinds. "lost" counts neighborhoods that only the
adaptive form tilts, "gained" those that only the full table tilts. "32 only" always stops at 32
trials. In four dimensions the CPU time of a whole estimator is measured.

    python benchmarks/bench_adaptive_trials.py --runs 2000
"""

import argparse
import time

import numpy as np

from sklearn_mcmd import RobustNormalEstimator
from sklearn_mcmd.datasets import make_contaminated_plane
from sklearn_mcmd.metrics import bias_angle
from sklearn_mcmd.planes._adaptive_trials import StopRule, adaptive_consistent_sets
from sklearn_mcmd.planes._consistent_set import draw_trials, n_support_points
from sklearn_mcmd.planes._local_planes import LocalPlaneModel, PlaneSettings
from sklearn_mcmd.planes._neighborhoods import NeighborIndex
from sklearn_mcmd.planes._record import Neighborhoods

KINDS = "clustered", "uniform", "any cluster", "crease", "step"


def neighborhoods(kind, n, k, share, noise, seed=0):
    """Planes z = 0 of deviation 1 with outliers, each in its own order: (n, k, 3)."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(n, k, 3)) * [1, 1, noise]
    m = int(share * k + 1e-9)
    out = points[:, k - m :]
    if kind == "clustered":  # Section 5.1, in units of its deviation
        out[:] = [2.04, 1.63, 2.45] + rng.normal(size=out.shape) * [0.58, 0.58, 0.5]
    elif kind == "uniform":
        out[:] = rng.uniform(-3.7, 3.7, out.shape)
    elif kind == "any cluster":
        center = rng.normal(size=(n, 1, 3))
        center *= rng.uniform(0.5, 2.5, (n, 1, 1)) / np.linalg.norm(center, axis=2, keepdims=True)
        out[:] = center + rng.normal(size=out.shape) * rng.uniform(0.05, 0.6, (n, 1, 1))
    elif kind == "crease":  # a second half-plane at 20 to 160 degrees
        points[..., 0] = abs(points[..., 0])
        angle = np.deg2rad(rng.uniform(20, 160, (n, 1)))
        along, across = out[..., 0].copy(), out[..., 2].copy()
        out[..., 0] = along * np.cos(angle) - across * np.sin(angle)
        out[..., 2] = along * np.sin(angle) + across * np.cos(angle)
    elif kind == "step":  # a parallel half-plane at 6 to 20 deviations of the noise
        points[..., 0] = abs(points[..., 0])
        out[..., 0] *= -1
        out[..., 2] += rng.uniform(6, 20, (n, 1)) * noise
    order = rng.random((n, k)).argsort(axis=1)
    return np.take_along_axis(points, order[..., None], axis=1)


def rule_of(k):
    return StopRule.of(69, n_support_points(0.5, np.arange(k + 1), 3), 0.9999, 3)


def normals_of(points, trials, rule=None):
    """Normals of given neighborhoods, by the NumPy form with reweighting."""
    n, k, _ = points.shape
    index = NeighborIndex(points.reshape(-1, 3), k)
    stop_rule = StopRule.never() if rule is None else rule
    settings = PlaneSettings("mcmd_z", 2e-16, cutoff=2.5, reweight=True, stop_rule=stop_rule)
    model = LocalPlaneModel(index, trials, settings)
    model.compiled = False
    place = np.empty(n * k, dtype=np.int32)
    place[index.rows] = np.arange(n * k)
    around = Neighborhoods(place.reshape(n, k), np.full(n, k))
    return model.evaluate_neighborhoods(points[:, 0], around)[0].normals


def trials_made(points, trials):
    return adaptive_consistent_sets(points, trials, points.shape[1] // 2, rule_of(points.shape[1]))[
        3
    ]


def show_trials(k):
    """Mean trials on 500 neighborhoods of each kind."""
    print(f"\ntrials made, k = {k}: mean of 69 (share that stops at 32)")
    trials = draw_trials(69, k, 0)
    cases = [("uniform", share, noise) for noise in (0.04, 0.125) for share in (0, 0.1, 0.2, 0.3)]
    cases += [("crease", 0.2, 0.04), ("crease", 0.4, 0.04), ("step", 0.2, 0.04)]
    for kind, share, noise in cases:
        used = trials_made(neighborhoods(kind, 500, k, share, noise), trials)
        print(
            f"  {kind:10s} share {share:.2f} noise {noise:.3f}: {used.mean():5.1f} "
            f"({(used == 32).mean():.2f})"
        )


def show_time(k, n, rounds):
    """CPU time of whole jobs in 4D, a point: least of the rounds, the two forms in turn."""
    print(f"\nCPU microseconds a point of RobustNormalEstimator in 4D, k = {k}, {n} points")
    for share in (0.0, 0.1, 0.2):
        X, best = flat_cloud(n, share), {}
        for _ in range(rounds):
            for rate in (0.5, "auto"):
                estimator = RobustNormalEstimator(
                    k, outlier_rate=rate, borrow=False, random_state=0, n_jobs=1
                )
                start = time.process_time()
                estimator.fit(X)
                elapsed = (time.process_time() - start) / n * 1e6
                best[rate] = min(best.get(rate, np.inf), elapsed)
        print(
            f"  {share:4.0%} outliers: all {best[0.5]:6.0f}  auto {best['auto']:6.0f}  "
            f"ratio {best['auto'] / best[0.5]:.2f}",
            flush=True,
        )


def flat_cloud(n, share, d=4):
    """A hyperplane with noise and uniform outliers around it."""
    rng = np.random.default_rng(0)
    side = n ** (1 / (d - 1))
    X = rng.uniform(0, side, (n, d))
    X[:, -1] = rng.normal(0, 0.05, n)
    m = int(share * n)
    X[:m, -1] = rng.uniform(-2, 2, m)
    return X


def show_table_1(runs):
    print(f"\nTable 1 (n = 50, 20 % outliers, clean twins), {runs} runs: mean / median angle")
    trials = draw_trials(69, 50, 0)
    for outliers in ("clustered", "uniform"):
        clouds = [
            make_contaminated_plane(50, outliers=outliers, return_X_y=False, random_state=run)
            for run in range(runs)
        ]
        rng = np.random.default_rng(0)
        orders = [rng.permutation(50) for _ in clouds]
        dirty = np.array([c.data[o] for c, o in zip(clouds, orders, strict=True)])
        clean = np.array([c.clean[o] for c, o in zip(clouds, orders, strict=True)])
        for label, rule in (("all", None), ("auto", rule_of(50))):
            angle = bias_angle(normals_of(dirty, trials, rule), normals_of(clean, trials, rule))
            tilt = bias_angle(normals_of(dirty, trials, rule), [0, 0, 1])
            print(
                f"  {outliers:9s} {label:4s} twins {angle.mean():.4f} / {np.median(angle):.4f}  "
                f"to the true plane {tilt.mean():.4f}",
                flush=True,
            )


def show_breakdown(k, runs):
    print(f"\nbreakdown, k = {k}, {runs} neighborhoods each: percent tilted by more than 5 degrees")
    print("  kind        noise share |    all   auto  32 only | lost gained")
    trials = draw_trials(69, k, 0)
    for kind in KINDS:
        for noise in (0.01, 0.04, 0.125):
            for share in (0.3, 0.4, 0.44, 0.46, 0.48, 0.49):
                points = neighborhoods(kind, runs, k, share, noise, seed=3)
                full, auto, short = (
                    bias_angle(normals, [0, 0, 1]) > 5
                    for normals in (
                        normals_of(points, trials),
                        normals_of(points, trials, rule_of(k)),
                        normals_of(points, trials[:32]),
                    )
                )
                print(
                    f"  {kind:11s} {noise:.3f}  {share:.2f} | {100 * full.mean():6.2f} "
                    f"{100 * auto.mean():6.2f} {100 * short.mean():6.2f}   | "
                    f"{(auto & ~full).sum():3d} {(full & ~auto).sum():3d}",
                    flush=True,
                )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--sizes", type=int, nargs="+", default=[30, 50], help="neighbors")
    parser.add_argument("--points", type=int, default=3_000, help="of clouds in 4D")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--parts", nargs="+", default=["trials", "time", "accuracy", "breakdown"])
    options = parser.parse_args()
    for k in options.sizes:
        if "trials" in options.parts:
            show_trials(k)
        if "time" in options.parts:
            show_time(k, options.points, options.rounds)
    if "accuracy" in options.parts:
        show_table_1(options.runs)
    if "breakdown" in options.parts:
        for k in options.sizes:
            show_breakdown(k, options.runs)


if __name__ == "__main__":
    main()
