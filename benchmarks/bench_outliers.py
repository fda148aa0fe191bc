"""Which points of a scan are outliers? Our forms against the usual detectors, with the truth.

On streets with four kinds of outliers in equal shares: area under the ROC curve, true positive
and true negative rates (also within one spacing of an edge), accuracy, and the rate found of
each kind, in percent, means over the seeds. The peers are told the true share of outliers, ours
are not; a peer that wins stays in the table.

    python benchmarks/bench_outliers.py --sizes 100000 --shares 0.05 0.1 0.2 0.3 --seeds 5
    python benchmarks/bench_outliers.py --kinds gaussian uniform ghost
    python benchmarks/bench_outliers.py --tree --noise-growth 10
"""

import argparse
import time
from itertools import product

import numpy as np
from _tables import print_table
from scipy.spatial import cKDTree
from sklearn.ensemble import IsolationForest
from sklearn.metrics import roc_auc_score
from sklearn.neighbors import LocalOutlierFactor

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street

KINDS = ["gaussian", "uniform", "mixed_pixel", "ghost"]
HEAD = ["AUC", "TPR", "TNR", "TNR edge", "accuracy", "gaussian", "uniform", "mixed", "ghost"]
N_NEIGHBORS = 50


def ours(**parameters):
    def method(X, share):
        detector = MCMDOutlierDetector(N_NEIGHBORS, random_state=0, n_jobs=-1, **parameters).fit(X)
        return -detector.scores_, detector.scores_ < detector.offset_

    return method


def told(outlyingness):
    """The points of the highest scores, as many as the true share."""

    def method(X, share):
        scores = outlyingness(X)
        outlier = np.zeros(len(scores), dtype=bool)
        outlier[np.argsort(-scores, kind="stable")[: round(share * len(scores))]] = True
        return scores, outlier

    return method


METHODS = {
    "paper (literal)": ours(strictness=None, reweight=False),
    "isolated": ours(strictness="isolated"),
    "groups (default)": ours(),
    "surfaces": ours(strictness="surfaces"),
    "LOF, told": told(
        lambda X: -LocalOutlierFactor(N_NEIGHBORS, n_jobs=-1).fit(X).negative_outlier_factor_
    ),
    "IsolationForest, told": told(
        lambda X: -IsolationForest(random_state=0, n_jobs=-1).fit(X).score_samples(X)
    ),
    "mean kNN distance, told": told(
        lambda X: cKDTree(X).query(X, N_NEIGHBORS, workers=-1)[0].mean(axis=1)
    ),
}


def figures(street, scores, outlier):
    truth = street.target == -1
    near = street.edge_distance < street.spacing
    rates = [outlier[truth].mean(), (~outlier[~truth]).mean(), (~outlier[near]).mean()]
    kinds = [street.outlier_kind == kind for kind in range(1, len(street.outlier_kind_names))]
    of_kinds = [outlier[kind].mean() if kind.any() else np.nan for kind in kinds]
    accuracy = (outlier == truth).mean()
    return 100 * np.array([roc_auc_score(truth, scores), *rates, accuracy, *of_kinds])


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[100_000])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.05, 0.1, 0.2, 0.3])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--noise-growth", type=float, default=1.0)
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS, help="of outliers")
    parser.add_argument("--tree", action="store_true")
    options = parser.parse_args(arguments)
    scan = {"noise_growth": options.noise_growth, "tree": options.tree}
    for n, share in product(options.sizes, options.shares):
        table = {name: [] for name in METHODS}
        for seed in range(options.seeds):
            street = make_street(
                n, outlier_share=share, outlier_kinds=options.kinds, random_state=seed, **scan
            )
            for name, method in METHODS.items():
                start = time.perf_counter()
                result = method(street.data, share)
                seconds = time.perf_counter() - start
                table[name].append([*figures(street, *result), seconds])
        title = f"{n:,} points, {100 * share:g} % outliers, {options.seeds} seeds, {scan}"
        rows = [[name, *np.mean(rows, axis=0)] for name, rows in table.items()]
        print_table(title, ["", *HEAD, "seconds"], rows, digits=2)


if __name__ == "__main__":
    main()
