"""How good are regions? Scores on roofs and on clouds whose surfaces are known, beside peers.

    python benchmarks/bench_segmentation.py roofs --noises 0.1 0.2 0.33
    python benchmarks/bench_segmentation.py peers --data ../shared/data

"peers" compares with other libraries (`pip install cgal open3d`) and writes the tables that the
docs show. What is not installed keeps its stored results. `--methods sklearn_mcmd` measures our
default alone anew.
"""

import argparse

import numpy as np
from _region_methods import MEASURED
from _region_peers import peers
from _tables import print_table
from simulators import ROOFS, make_roof
from sklearn.metrics import adjusted_rand_score

from sklearn_mcmd import RegionGrowing


def roofs(options):
    """Rand index, or of barrels the share of the largest region, by crease and points."""
    for kind in ROOFS:
        rows = []
        for n in options.sizes:
            for noise in options.noises:
                scores = [
                    [roof_score(kind, n, crease, noise, seed) for seed in range(options.seeds)]
                    for crease in options.creases
                ]
                rows.append([f"{n:,}, noise {noise:g}", *np.mean(scores, axis=1)])
        print_table(kind, ["points", *(f"{crease:g}" for crease in options.creases)], rows, 2)
        print(f"mean {np.mean([row[1:] for row in rows]):.3f}")


def roof_score(kind, n, crease, noise, seed):
    X, surface = make_roof(kind, n, crease, noise, seed)
    labels = RegionGrowing(random_state=0).fit_predict(X)
    if kind == "barrel":
        return np.bincount(labels[labels >= 0]).max() / n
    return adjusted_rand_score(surface, labels)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tasks = parser.add_subparsers(dest="task", required=True)
    part = tasks.add_parser("roofs")
    part.set_defaults(run=roofs)
    part.add_argument("--seeds", type=int, default=2)
    part.add_argument("--sizes", type=int, nargs="+", default=[200, 1000, 5000, 20_000])
    part.add_argument("--creases", type=float, nargs="+", default=[5, 10, 15, 20, 35, 50])
    part.add_argument("--noises", type=float, nargs="+", default=[0.1, 0.33])
    part = tasks.add_parser("peers")
    part.set_defaults(run=peers)
    part.add_argument("--data", default="../shared/data", help="folder of real clouds")
    part.add_argument("--methods", nargs="*", default=MEASURED, choices=MEASURED)
    part.add_argument("--clouds", nargs="+", help="those that begin with one of these")
    part.add_argument("--limit", type=float, default=180.0, help="seconds for a cloud")
    part.add_argument("--output", default="docs/benchmarks/segmentation.json")
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
