"""What do adaptive trials save, and do they cost accuracy or breakdown?

`outlier_rate="auto"` against all 69 trials, compiled, on the same neighborhoods: trials made
and CPU time a point; bias angles between twins (Table 1); labels (Table 4); and the share of
neighborhoods whose normal tilts by more than 5 degrees from 30 to 49 percent of outliers, for
five kinds of outliers. "lost" counts neighborhoods that only the adaptive form tilts, "gained"
those that only the full table tilts; "32 only" is what stopping always at 32 would do.

    python benchmarks/bench_adaptive_trials.py --runs 2000
"""

import argparse
import time

import numpy as np

from sklearn_mcmd import MCMDOutlierDetector, RobustNormalEstimator
from sklearn_mcmd.datasets import make_contaminated_plane, make_street
from sklearn_mcmd.metrics import bias_angle, outlier_scores
from sklearn_mcmd.planes._adaptive_trials import StopRule, adaptive_consistent_sets
from sklearn_mcmd.planes._consistent_set import draw_trials, n_support_points
from sklearn_mcmd.planes._local_planes import LocalPlaneModel
from sklearn_mcmd.planes._neighborhoods import NeighborIndex

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
    """Normals of given neighborhoods, by the compiled form with reweighting."""
    n, k, _ = points.shape
    index = NeighborIndex(points.reshape(-1, 3), k)
    model = LocalPlaneModel(
        index, trials, method="mcmd_z", precision=2e-16, cutoff=2.5, reweight=True, stop_rule=rule
    )
    place = np.empty(n * k, dtype=np.int64)
    place[index.rows] = np.arange(n * k)
    sizes = np.full(n, k)
    return model.evaluate_neighborhoods(points[:, 0], place.reshape(n, k), sizes).normals


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
    """CPU time of whole jobs, a point: least of the rounds, the two forms in turn."""
    print(f"\nCPU microseconds a point of RobustNormalEstimator, k = {k}")
    clouds = {
        f"plane, {share:.0%} outliers": plane_cloud(n, share) for share in (0.0, 0.1, 0.2)
    } | {"street, 10% outliers": street(0).data}
    for name, X in clouds.items():
        best = {}
        for _ in range(rounds):
            for label, parameters in {
                "all": {"outlier_rate": 0.5},
                "auto": {"outlier_rate": "auto"},
                "pca": {"method": "pca"},
            }.items():
                start = time.process_time()
                RobustNormalEstimator(k, random_state=0, n_jobs=1, **parameters).fit(X)
                elapsed = (time.process_time() - start) / len(X) * 1e6
                best[label] = min(best.get(label, np.inf), elapsed)
        index = NeighborIndex(X, k)
        rows, _ = index.query(X[:: len(X) // 400])
        used = trials_made(index.points[rows], draw_trials(69, k, 0)).mean()
        ratio = best["all"] / best["auto"]
        print(
            f"  {name:22s} all {best['all']:5.1f}  auto {best['auto']:5.1f}  ({ratio:.2f} times "
            f"faster; pca {best['pca']:.1f}; {used:.1f} trials)",
            flush=True,
        )


def plane_cloud(n, share):
    rng = np.random.default_rng(0)
    side = np.sqrt(n)
    X = rng.uniform(0, side, (n, 3)) * [1, 1, 0]
    X[:, 2] = rng.normal(0, 0.2, n)
    m = int(share * n)
    X[:m, 2] = rng.uniform(-6, 6, m)
    return X


def street(seed):
    """100,000 points every 2 cm with 5 mm of noise, the shortest there is."""
    return make_street(100_000, spacing=0.02, random_state=seed)


def show_street_accuracy(k):
    print(f"\nstreet, k = {k}: angle to the true normals of true points, degrees")
    scene = street(1)
    true = scene.target == 1
    for rate in (0.5, "auto"):
        found = RobustNormalEstimator(k, outlier_rate=rate, random_state=0).fit(scene.data)
        angle = bias_angle(found.normals_[true], scene.normals[true])
        within = 100 * np.mean(angle <= 10)
        print(
            f"  {rate!s:5s} mean {angle.mean():.3f} median {np.median(angle):.3f} "
            f"95% {np.percentile(angle, 95):.2f} within 10 degrees {within:.2f} %",
            flush=True,
        )


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


def show_table_4(runs):
    print(f"\nTable 4 (n = 100), {runs} runs: TPR / TNR in percent")
    for share in (0.05, 0.2, 0.4):
        for rate in (0.5, "auto"):
            totals = np.zeros(2)
            for run in range(runs):
                X, y = make_contaminated_plane(100, outlier_share=share, random_state=run)
                detector = MCMDOutlierDetector(None, outlier_rate=rate, random_state=run)
                scores = outlier_scores(y, detector.fit_predict(X))
                totals += scores.true_positive_rate, scores.true_negative_rate
            found, kept = 100 * totals / runs
            print(f"  {share:.2f} {rate!s:5s} {found:.3f} / {kept:.3f}", flush=True)


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
    parser.add_argument("--points", type=int, default=50_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--parts", nargs="+", default=["trials", "time", "accuracy", "breakdown"])
    options = parser.parse_args()
    for k in options.sizes:
        if "trials" in options.parts:
            show_trials(k)
        if "time" in options.parts:
            show_time(k, options.points, options.rounds)
        if "accuracy" in options.parts:
            show_street_accuracy(k)
    if "accuracy" in options.parts:
        show_table_1(options.runs)
        show_table_4(max(50, options.runs // 10))
    if "breakdown" in options.parts:
        for k in options.sizes:
            show_breakdown(k, options.runs)


if __name__ == "__main__":
    main()
