"""Are scanned scenes as hard as real scans, and what does each detector take from them?

"Likeness", with the folder of real clouds beside the checkout: quantiles (5, 50, 95 %) of the
distance to the nearest other point, of how much ten neighbors and their point lie on a line
(second over first principal axis), and of their roughness (standard deviation along the third axis
over their radius), for regular points of scenes and for real ones.

"Taken and found": of each scene, the regular points that a method flags by class, and the outliers
that it finds by kind, in percent, over the seeds. Methods are those of ``bench_real.py``.

    python benchmarks/bench_scenes.py --table scenes.md
    python benchmarks/bench_scenes.py --scenes make_mobile_scan --methods default "SOR 20"
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import simulators
from _real_clouds import evaluate, load_clouds
from _real_methods import FROM_ORIGIN, METHODS
from bench_real import write
from scipy.spatial import cKDTree

from sklearn_mcmd.datasets import make_lidar_turn

SCENES = ["make_mobile_scan", "make_airborne_scan", "make_lidar_turn", "make_depth_frame"]
N_NEIGHBORS, N_MEASURED = 10, 10_000

# Scene, its classes (None: all), and the real cloud and classes that it is compared with.
PAIRS = [
    ("make_mobile_scan", None, "jakarto_scanlines", None),
    ("make_mobile_scan", ["vehicle"], "pcl_cars_mincut", None),
    ("make_airborne_scan", ["ground"], "ahn3_amsterdam_2397", ["ground"]),
    ("make_airborne_scan", ["building"], "ahn3_amsterdam_2397", ["building"]),
    ("make_airborne_scan", ["vegetation"], "ign_village", ["vegetation"]),
    ("make_lidar_turn", None, "fast_gicp_velodyne", None),
    ("make_depth_frame", None, "pcl_office1", None),
]
COLUMNS = ["nearest (cm)", "second / first axis", "roughness / radius"]


def maker(scene):
    return getattr(simulators, scene, make_lidar_turn)


def measures(points, chosen):
    """Spacing in centimeters, second over first axis, and roughness: quantiles as text."""
    rows = np.flatnonzero(chosen)
    rows = np.random.default_rng(0).choice(rows, min(N_MEASURED, len(rows)), replace=False)
    distances, near = cKDTree(points).query(points[rows], N_NEIGHBORS + 1)
    spread = points[near] - points[near].mean(axis=1, keepdims=True)
    covariance = np.einsum("nki,nkj->nij", spread, spread) / (N_NEIGHBORS + 1)
    third, second, first = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0.0)).T
    values = [100 * distances[:, 1], second / first, third / distances[:, -1]]
    return [
        " / ".join(f"{q:.{digits}f}" for q in np.quantile(v, [0.05, 0.5, 0.95]))
        for v, digits in zip(values, (1, 2, 3), strict=True)
    ]


def likeness(data):
    """Markdown: each scene beside a real cloud."""
    clouds = {c.name: c for c in load_clouds(data, sorted({pair[2] for pair in PAIRS}))}
    lines = ["## Likeness", "", "| | " + " | ".join(COLUMNS) + " |", "|---|" + "---|" * 3]
    for scene, own, name, others in PAIRS:
        scan = maker(scene)(random_state=0)
        regular = scan.target == 1
        points = scan.data[regular]
        chosen = classes_of(scan)[regular]
        chosen = np.ones(len(points), bool) if own is None else np.isin(chosen, own)
        cloud = clouds[name]
        real = np.unique(cloud.points, axis=0) if others is None else cloud.points
        same = np.ones(len(real), bool) if others is None else np.isin(cloud.classes, others)
        for title, values in (
            (f"{scene}{'' if own is None else ': ' + ', '.join(own)}", measures(points, chosen)),
            (f"{name}{'' if others is None else ': ' + ', '.join(others)}", measures(real, same)),
        ):
            lines.append(f"| {title} | " + " | ".join(values) + " |")
    return "\n".join([*lines, ""])


def classes_of(scan):
    """Names of the classes; those of outliers are not read."""
    return np.array(scan.class_names)[scan.classification]


def taken_and_found(scene, n_samples, methods, seeds):
    """Markdown: a table of a scene, means over the seeds."""
    found = {method: [] for method in methods}
    counts = {}
    for seed in seeds:
        size = {} if n_samples is None else {"n_samples": n_samples}
        scan = maker(scene)(**size, random_state=seed)
        kind = np.array(["real", *scan.outlier_kind_names[1:]])[scan.outlier_kind]
        classes = classes_of(scan)
        for names, prefix in ((classes[kind == "real"], "flagged"), (kind[kind != "real"], "TPR")):
            for name, count in zip(*np.unique(names, return_counts=True), strict=True):
                counts[prefix, str(name)] = counts.get((prefix, str(name)), 0) + count
        for method in methods:
            result = METHODS[method](scan.data, (kind != "real").mean())
            found[method].append(evaluate(*result, kind, classes))
        print(f"{scene}, seed {seed}", file=sys.stderr, flush=True)
    title = {"flagged": "lost", "TPR": "found"}
    lines = [f"## {scene}", "", "| | points | " + " | ".join(methods) + " |"]
    lines += ["|---|---:|" + "---:|" * len(methods)]
    total = [("accuracy", "all"), ("average precision", "all")]
    for key in [*counts, ("flagged", "all"), ("TPR", "all"), *total]:
        mean = [np.mean([values[key] for values in found[method]]) for method in methods]
        points = f"{counts[key] // len(seeds):,}" if key in counts else ""
        name = f"{title.get(key[0], key[0])} {key[1]}" if key not in total else key[0]
        lines.append(f"| {name} | {points} | " + " | ".join(f"{m:.2f}" for m in mean) + " |")
    return "\n".join([*lines, ""])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=SCENES)
    free = [name for name in METHODS if name not in FROM_ORIGIN]
    parser.add_argument("--methods", nargs="+", choices=free, default=["default", "SOR 20"])
    parser.add_argument("--samples", type=int, help="points; by default those of each scene")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--table", help="Markdown file, instead of printing")
    options = parser.parse_args()
    text = likeness(options.data) if Path(options.data).is_dir() else ""
    for scene in options.scenes:
        text += "\n" + taken_and_found(scene, options.samples, options.methods, options.seeds)
    if options.table:
        write(options.table, text)
    else:
        print(text)


if __name__ == "__main__":
    main()
