"""Which points of a scan are outliers? Our forms against the usual detectors, with the truth.

On streets with four kinds of outliers in equal shares: area under the ROC curve, true positive
and true negative rates (also within one spacing of an edge), accuracy, and the rate found of
each kind, in percent, means over the seeds. The peers are told the true share of outliers, ours
are not; a peer that wins stays in the table.

    python benchmarks/bench_outliers.py --sizes 100000 --shares 0.05 0.1 0.2 0.3 --seeds 5
    python benchmarks/bench_outliers.py --kinds gaussian uniform ghost
    python benchmarks/bench_outliers.py --tree --noise-growth 10
    python benchmarks/bench_outliers.py --clouds ../shared/data/*/cloud.npz
"""

import argparse
import time
from pathlib import Path

import numpy as np
from sklearn.metrics import roc_auc_score

KINDS = ["gaussian", "uniform", "mixed_pixel", "ghost"]


def ours(X, options, **parameters):
    from sklearn_mcmd import MCMDOutlierDetector

    detector = MCMDOutlierDetector(
        options.n_neighbors, random_state=0, n_jobs=options.threads, **parameters
    ).fit(X)
    return -detector.scores_, detector.scores_ < detector.offset_


def top(scores, share):
    """The points of the highest scores, as many as the true share."""
    outlier = np.zeros(len(scores), dtype=bool)
    outlier[np.argsort(-scores, kind="stable")[: round(share * len(scores))]] = True
    return scores, outlier


def lof(X, options, share):
    from sklearn.neighbors import LocalOutlierFactor

    peer = LocalOutlierFactor(options.n_neighbors, n_jobs=options.threads).fit(X)
    return top(-peer.negative_outlier_factor_, share)


def isolation_forest(X, options, share):
    from sklearn.ensemble import IsolationForest

    peer = IsolationForest(random_state=0, n_jobs=options.threads).fit(X)
    return top(-peer.score_samples(X), share)


def mean_distance(X, options, share):
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(X).query(X, options.n_neighbors, workers=options.threads)
    return top(distances.mean(axis=1), share)


FORMS = {
    "paper (literal)": {"strictness": None, "reweight": False},
    "paper, reweighted": {"strictness": None},
    "isolated": {"strictness": "isolated"},
    "groups (default)": {},
    "surfaces": {"strictness": "surfaces"},
    "surfaces, noise given": {"strictness": "surfaces"},
}
PEERS = {
    "LOF, told": lof,
    "IsolationForest, told": isolation_forest,
    "mean kNN distance, told": mean_distance,
}


def figures(street, scores, outlier):
    truth = street.target == -1
    near = street.edge_distance < street.spacing
    rates = [outlier[truth].mean(), (~outlier[~truth]).mean(), (~outlier[near]).mean()]
    kinds = [street.outlier_kind == kind for kind in range(1, len(street.outlier_kind_names))]
    found = [outlier[kind].mean() if kind.any() else np.nan for kind in kinds]
    accuracy = (outlier == truth).mean()
    return 100 * np.array([roc_auc_score(truth, scores), *rates, accuracy, *found])


def compare_on_streets(options):
    from sklearn_mcmd.datasets import make_street

    head = ["AUC", "TPR", "TNR", "TNR edge", "accuracy", "gaussian", "uniform", "mixed", "ghost"]
    for n in options.sizes:
        for share in options.shares:
            table = {}
            for seed in range(options.seeds):
                street = make_street(
                    n,
                    noise=options.noise,
                    noise_growth=options.noise_growth,
                    tree=options.tree,
                    outlier_share=share,
                    outlier_kinds=options.kinds,
                    random_state=seed,
                )
                for name, form in FORMS.items():
                    given = {"noise_scale": options.noise} if name.endswith("given") else {}
                    start = time.perf_counter()
                    result = ours(street.data, options, **{**form, **given})
                    row = [*figures(street, *result), time.perf_counter() - start]
                    table.setdefault(name, []).append(row)
                for name, peer in PEERS.items():
                    start = time.perf_counter()
                    result = peer(street.data, options, share)
                    row = [*figures(street, *result), time.perf_counter() - start]
                    table.setdefault(name, []).append(row)
            print(
                f"\n{n:,} points, spacing {1000 * street.spacing:.0f} mm, noise "
                f"{1000 * options.noise:g} mm, growing {options.noise_growth:g} times, "
                f"{'a tree, ' * options.tree}{100 * share:g} % outliers, {options.seeds} seeds"
            )
            print(f"{'':28}" + "".join(f"{title:>10}" for title in [*head, "seconds"]))
            for name, rows in table.items():
                print(f"{name:28}" + "".join(f"{v:10.2f}" for v in np.mean(rows, axis=0)))


def compare_on_clean_clouds(options):
    print(f"\n{'flagged, percent':32}" + "".join(f"{name:>28}" for name in list(FORMS)[:-1]))
    for path in options.clouds:
        with np.load(path) as arrays:
            X = arrays["xyz"].astype(np.float64)
        forms = list(FORMS.items())[:-1]
        shares = [100 * ours(X, options, **form)[1].mean() for _, form in forms]
        print(f"{Path(path).parent.name:32}" + "".join(f"{v:28.2f}" for v in shares), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[100_000])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.05, 0.1, 0.2, 0.3])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--noise", type=float, default=0.005)
    parser.add_argument("--noise-growth", type=float, default=1.0)
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS, help="of outliers")
    parser.add_argument("--tree", action="store_true")
    parser.add_argument("--n-neighbors", type=int, default=50)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--clouds", nargs="+", help="npz files of clean clouds, instead of streets")
    options = parser.parse_args()
    if options.clouds:
        compare_on_clean_clouds(options)
    else:
        compare_on_streets(options)


if __name__ == "__main__":
    main()
