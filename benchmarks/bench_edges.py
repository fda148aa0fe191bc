"""Which points belong to edges? Our forms and the paper's are compared with the truth.

The clouds are the box, the crown roof and the street, whose edges are known, or clouds with the
true distance to the edge (`edge_dist` in an npz file), or with the plane of each point (`plane`),
or simulated roofs, without outliers. A point belongs to an edge if its true
distance is at most two spacings. Precision, recall, F1, area under the ROC curve and average
precision are in percent of the regular points. "P all" is the precision if outliers labelled as
edges count as errors too. All forms have their default parameters.

    python benchmarks/bench_edges.py
    python benchmarks/bench_edges.py --street 100000 --shares 0 0.1 0.2 --forms crease
    python benchmarks/bench_edges.py --clouds ../shared/data/cad_*/cloud.npz --most 30000
    python benchmarks/bench_edges.py --shares 0 --forms crease --roofs 30 45
    python benchmarks/bench_edges.py --panel

The panel is of the default alone: what it finds and what it labels beside, on few clouds of each
kind, in less than a minute of processor time, beside the stored figures. ``--panel street`` shows
the rows that begin so, ``--panel --output docs/benchmarks`` stores all.
"""

import argparse
import time
from itertools import product
from pathlib import Path

import numpy as np
from _edge_panel import show_panel
from _tables import print_table
from scipy.spatial import cKDTree
from simulators import roof_edges
from sklearn.metrics import average_precision_score, roc_auc_score

from sklearn_mcmd import RobustNormalEstimator, SharpFeatureDetector
from sklearn_mcmd.datasets import make_box, make_crown_roof, make_street

HEAD = ["P", "R", "F1", "AUC", "AP", "P all", "seconds"]
LITERAL = {"criterion": "eigenvalue", "threshold": "mean", "outlier_detector": "passthrough"}
FORMS = {
    "Eq. 25, PCA": {"normal_estimator": RobustNormalEstimator(30, method="pca"), **LITERAL},
    "Eq. 25, MCMD_Z": {"normal_estimator": RobustNormalEstimator(30, reweight=False), **LITERAL},
    "eigenvalue": {"criterion": "eigenvalue"},
    "surface_variation": {"criterion": "surface_variation"},
    "removed_fraction": {"criterion": "removed_fraction"},
    "crease (default)": {"n_neighbors": 40},
}


def spacing_of(X):
    """Side of the square that the median point takes, from its 8 neighbors."""
    distances, _ = cKDTree(X).query(X, k=9)
    return np.median(distances[:, -1]) * np.sqrt(np.pi / 8)


def from_planes(arrays):
    """Distances to the edge, which is half a spacing before the next point of another plane."""
    X, plane = arrays["xyz"], arrays["plane"]
    distance = np.full(len(X), np.nan)
    for number in range(1, plane.max() + 1):
        others = cKDTree(X[(plane > 0) & (plane != number)])
        distance[plane == number] = others.query(X[plane == number])[0]
    return distance - 0.5 * spacing_of(X)


def clouds(options, share, seed=0):
    """Name, points, distance to the edge (NaN: outlier) and spacing."""
    for path in options.clouds:
        rng = np.random.default_rng(seed)
        with np.load(path) as arrays:
            X = arrays["xyz"].astype(np.float64)
            distance = arrays["edge_dist"] if "edge_dist" in arrays else from_planes(arrays)
        if len(X) > options.most:
            rows = rng.permutation(len(X))[: options.most]
            X, distance = X[rows], distance[rows]
        spacing = spacing_of(X)
        n = round(len(X) * share / (1 - share))
        displaced = X[rng.permutation(len(X))[:n]] + rng.normal(0, 5 * spacing, (n, 3))
        points = np.vstack([X, displaced])
        name = Path(path).parent.name if Path(path).stem == "cloud" else Path(path).stem
        yield name, points, np.r_[distance, np.full(n, np.nan)], spacing
    for kind, n, crease, noise in product(
        ("gable", "hip", "mansard"), (500, 2_000, 8_000), options.roofs, (0.1, 0.3)
    ):
        yield f"{kind}, {crease:g} degrees, noise {noise}", *roof_edges(kind, n, crease, noise)
    if options.clouds or options.roofs:
        return
    for make in (make_box, make_crown_roof):
        cloud = make(outlier_share=share, random_state=seed)
        yield make.__name__, cloud.data, cloud.edge_distance, cloud.spacing
    street = make_street(options.street, outlier_share=share, random_state=seed)
    yield f"make_street({options.street})", street.data, street.edge_distance, street.spacing


def figures(distance, spacing, scores, found):
    regular = np.isfinite(distance)
    edge = distance[regular] <= 2 * spacing
    hits = np.count_nonzero(found[regular] & edge)
    precision, recall = hits / max(found[regular].sum(), 1), hits / edge.sum()
    f1 = 2 * hits / (found[regular].sum() + edge.sum())
    area = roc_auc_score(edge, -scores[regular])
    average = average_precision_score(edge, -scores[regular])
    return 100 * np.array([precision, recall, f1, area, average, hits / max(found.sum(), 1)])


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.1, 0.2])
    parser.add_argument("--street", type=int, default=20_000, help="points of the street")
    parser.add_argument("--clouds", nargs="+", default=[], help="npz files, instead of scenes")
    parser.add_argument(
        "--roofs", type=float, nargs="+", default=[], help="angles of roofs, instead of scenes"
    )
    parser.add_argument("--most", type=int, default=30_000, help="points of a cloud at most")
    parser.add_argument("--forms", nargs="+", default=[""], help="parts of the forms' names")
    parser.add_argument(
        "--panel", nargs="*", metavar="ROW", help="of the default, beside the stored"
    )
    parser.add_argument(
        "--data", default="../shared/data", help="folder of real clouds, of --panel"
    )
    parser.add_argument("--output", help="folder for the panel")
    options = parser.parse_args(arguments)
    if options.panel and options.output:
        parser.error("--output stores the whole panel: name no rows")
    if options.panel is not None:
        return show_panel(clouds, options.data, options.panel, options.output)
    of_kind = {}
    for share in options.shares:
        for name, X, distance, spacing in clouds(options, share):
            rows = []
            for form, parameters in FORMS.items():
                if not any(part in form for part in options.forms):
                    continue
                start = time.perf_counter()
                detector = SharpFeatureDetector(
                    **{"n_neighbors": 30, "random_state": 0, "n_jobs": -1} | parameters
                )
                scores = detector.fit(X).scores_
                seconds = time.perf_counter() - start
                row = [*figures(distance, spacing, scores, scores < detector.offset_), seconds]
                rows.append([form, *row])
                of_kind.setdefault(f"{name.partition(',')[0]}, {form}", []).append(row)
            title = f"{name}, {len(X):,} points, {100 * share:g} % outliers"
            print_table(title, ["", *HEAD], rows)
    if options.roofs:
        rows = [[name, *np.mean(found, axis=0)] for name, found in of_kind.items()]
        print_table("means", ["", *HEAD], rows)


if __name__ == "__main__":
    main()
