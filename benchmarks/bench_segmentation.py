"""How good are regions? Scores on scenes, roofs and clouds whose surfaces are known, beside peers.

    python benchmarks/bench_segmentation.py scenes
    python benchmarks/bench_segmentation.py roofs --noises 0.1 0.2 0.33
    python benchmarks/bench_segmentation.py labelled --data ../shared/data
    python benchmarks/bench_segmentation.py peers --data ../shared/data

"scenes" grows regions by the paper's rules alone and by ours, on normals of several methods.
"peers" compares with other libraries (`pip install cgal open3d`; `apt-get install g++ pkg-config
libpcl-dev` for PCL) and with other settings, and writes the tables that the docs show. What is not
installed keeps its stored results. `--methods sklearn_mcmd` measures our default alone anew.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
from _ablation_changes import without_steps
from _ablation_clouds import labelled as labelled_clouds
from _region_clouds import agreement
from _region_methods import METHODS
from _region_peers import peers
from _tables import print_table
from simulators import ROOFS, make_bus_stop, make_roof, make_traffic_furniture
from sklearn.metrics import adjusted_rand_score

from sklearn_mcmd import RegionGrowing, RobustNormalEstimator
from sklearn_mcmd.datasets import make_crown_roof
from sklearn_mcmd.metrics import segmentation_scores
from sklearn_mcmd.segmentation._estimator import GrowthSteps

FORMS = {  # steps of growth that are left out
    "paper's rules": GrowthSteps._fields,
    "and mutual": GrowthSteps._fields[1:],
    "and coplanar joined": ("find_narrow_faces", "divide_at_creases", "join_curved"),
    "and curved joined": ("find_narrow_faces", "divide_at_creases"),
    "and narrow faces": ("divide_at_creases",),
    "default": (),
}
HEAD = ["PS", "OS", "US", "missed", "F %", "Rand", "mean IoU", "segments"]
SMALLEST = 100  # points of a surface whose overlap counts


def figures(truth, labels):
    """The values of a row: see `HEAD`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # undefined ratios print as nan
        scores = segmentation_scores(truth, labels)
    counts = [scores.proper, scores.over, scores.under, scores.missed]
    overlap = scores.surface_iou[scores.surface_sizes >= SMALLEST].mean()
    measures = [100 * scores.f_score, scores.adjusted_rand, overlap]
    return [float(value) for value in (*counts, *measures, labels.max() + 1)]


def scenes(options):
    for make, angle in ((make_traffic_furniture, 15.0), (make_bus_stop, 5.0)):
        table = {}
        for seed in range(options.seeds):
            size = {"n_samples": options.size} if options.size else {}
            scene = make(**size, random_state=seed)
            for method in options.methods:
                normals = RobustNormalEstimator(method=method, random_state=0, n_jobs=-1)
                columns = normals.fit_transform(scene.data)
                for name, form in FORMS.items():
                    growing = RegionGrowing(max_angle=angle, normals="precomputed")
                    with without_steps(*form):
                        row = figures(scene.surface, growing.fit_predict(columns))
                    table.setdefault(f"{method}, {name}", []).append(row)
        title = f"{make.__name__}, {angle:g} degrees, {options.seeds} seeds"
        rows = [[name, *np.mean(rows, axis=0)] for name, rows in table.items()]
        print_table(title, ["", *HEAD], rows, digits=3)


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


def labelled(options):
    """Rand index of crown roofs and of real clouds, IoU of the tables; and the regions."""
    made = [
        (f"crown roof {n:,} {seed}", make_crown_roof(n, random_state=seed))
        for n in options.sizes
        for seed in range(options.seeds)
    ]
    clouds = [(name, roof.data, roof.surface) for name, roof in made]
    clouds += labelled_clouds(options)
    for table in sorted(Path(options.data).glob("kinect_tables/*.npz")):
        with np.load(table) as frame:
            X, surface = frame["xyz"].astype(np.float64), np.where(frame["label"] == 1, 1, -1)
            clouds += [(f"{table.stem}, all {len(X):,}", X, surface)]
    path = Path(options.data) / "cad_cube_pointfilter" / "cloud.npz"
    if path.is_file():
        with np.load(path) as cube:
            noisy = cube["xyz_noisy"].astype(np.float64)
            clouds += [("noisy cube, each 5th", noisy[::5], cube["patch"][::5])]
            clouds += [("noisy cube", noisy, cube["patch"])]
    rows = []
    for name, X, surface in clouds:
        row = [name]
        for divide in (False, True):
            with without_steps(*["divide_at_creases"] * (not divide)):
                labels = RegionGrowing(random_state=0).fit_predict(X)
            row += [float(agreement(surface, labels)), int(labels.max() + 1)]
        rows.append(row)
    print_table("", ["cloud", "not divided", "regions", "default", "regions"], rows, digits=3)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    tasks = parser.add_subparsers(dest="task", required=True)

    parts = {}
    for task in (scenes, roofs, labelled, peers):
        parts[task] = tasks.add_parser(task.__name__)
        parts[task].set_defaults(run=task)
    for task in (scenes, roofs, labelled):
        parts[task].add_argument("--seeds", type=int, default=2)
    for task in (labelled, peers):
        parts[task].add_argument("--data", default="../shared/data", help="folder of real clouds")
    for task, sizes in ((roofs, [200, 1000, 5000, 20_000]), (labelled, [3_000, 20_000, 50_000])):
        parts[task].add_argument("--sizes", type=int, nargs="+", default=sizes)
    parts[scenes].add_argument("--methods", nargs="+", default=["mcmd_z"])
    parts[scenes].add_argument("--size", type=int, help="points; by default the paper's")
    creases = [5, 10, 15, 20, 35, 50]
    parts[roofs].add_argument("--creases", type=float, nargs="+", default=creases)
    parts[roofs].add_argument("--noises", type=float, nargs="+", default=[0.1, 0.33])
    methods = {"nargs": "*", "default": list(METHODS), "choices": METHODS}
    parts[peers].add_argument("--methods", **methods)
    parts[peers].add_argument("--clouds", nargs="+", help="those that begin with one of these")
    parts[peers].add_argument("--limit", type=float, default=180.0, help="seconds for a cloud")
    parts[peers].add_argument("--output", default="docs/benchmarks/segmentation.json")
    options = parser.parse_args(arguments)
    options.run(options)


if __name__ == "__main__":
    main()
