"""How good and how fast are regions? Scores on scenes with truth, seconds from 10^4 points on.

Scores: a street with 10 % outliers is denoised first, as a user would do. Regions grow by the
paper's rules alone and by ours, on normals of several sizes and methods. All true points count, so
points that denoising wrongly removed have no region. The second Rand index counts only the points
that denoising kept. DBSCAN, a peer, uses no normals.

Speed: growing alone is timed, after normals, on streets in random row order. Each measurement runs
in its own process; numbers are medians over the rounds. If seconds for a point are constant, the
time is linear.

    python benchmarks/bench_segmentation.py scores --size 100000 --seeds 3
    python benchmarks/bench_segmentation.py scenes
    python benchmarks/bench_segmentation.py speed --sizes 10000 100000 1000000 --threads 2
    python benchmarks/bench_segmentation.py clouds ../shared/data/*/cloud.npz
    python benchmarks/bench_segmentation.py roofs --noises 0.1 0.2 0.33
    python benchmarks/bench_segmentation.py labelled --data ../shared/data
    python benchmarks/bench_segmentation.py peers --data ../shared/data

The last compares with other libraries (`pip install cgal open3d`; `apt-get install g++ pkg-config
libpcl-dev` for PCL) and with other settings, and writes the tables that the docs show. What is not
installed keeps its stored results. `--methods sklearn_mcmd` measures our default alone anew.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
from _ablation_changes import without_steps

from sklearn_mcmd.segmentation._steps import GrowthSteps

# Steps of growth that are left out.
FORMS = {
    "paper's rules": GrowthSteps._fields,
    "and mutual": GrowthSteps._fields[1:],
    "and rest assigned": GrowthSteps._fields[1:-1],
    "and coplanar joined": ("find_narrow_faces", "divide_at_creases", "join_curved"),
    "and curved joined": ("find_narrow_faces", "divide_at_creases"),
    "and narrow faces": ("divide_at_creases",),
    "default": (),
}
DENOISERS = {
    "default": {},
    "surfaces": {"strictness": "surfaces"},
    "no": None,
}
SMALLEST = 100  # points of a surface that must be found


def normals_of(X, k, method, threads):
    from sklearn_mcmd import RobustNormalEstimator

    reweight = True
    if method == "mcmd_z, literal":
        method, reweight = "mcmd_z", False
    estimator = RobustNormalEstimator(k, method=method, reweight=reweight, random_state=0)
    return estimator.set_params(n_jobs=threads).fit_transform(X)


def figures(truth, labels, keep):
    """The values of a row, but for the seconds: see `HEAD`."""
    from sklearn_mcmd.metrics import segmentation_scores

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # undefined ratios print as nan
        scores = segmentation_scores(truth, labels)
        kept = segmentation_scores(truth[keep], labels[keep])
    large = scores.surface_sizes >= SMALLEST
    found = (scores.surface_iou[large] > 0.5).mean()
    return [
        scores.adjusted_rand,
        kept.adjusted_rand,
        scores.surface_iou[large].mean(),
        100 * found,
        scores.proper,
        scores.over,
        scores.under,
        scores.missed,
        100 * scores.f_score,
        labels.max() + 1,
    ]


HEAD = [
    "ARI",
    "ARI kept",
    "mean IoU",
    "found %",
    "PS",
    "OS",
    "US",
    "missed",
    "F %",
    "segments",
    "seconds",
]


def print_row(name, row):
    print(f"{name:44}" + "".join(f"{value:10.3f}" for value in row), flush=True)


def print_head(title):
    print(f"\n{title}\n{'':44}" + "".join(f"{name:>10}" for name in HEAD))


def compare_forms(X, truth, keep, options, angle=15.0):
    """A row a form, on normals of the points kept; the others have no region."""
    from sklearn_mcmd import RegionGrowing

    rows = {}
    for method in options.methods:
        for k in options.normals:
            columns = normals_of(X[keep], k, method, options.threads)
            for name, left_out in FORMS.items():
                growing = RegionGrowing(
                    options.n_neighbors,
                    max_angle=angle,
                    normals="precomputed",
                    n_jobs=options.threads,
                )
                start = time.perf_counter()
                labels = np.full(len(X), -1)
                with without_steps(*left_out):
                    labels[keep] = growing.fit_predict(columns)
                seconds = time.perf_counter() - start
                rows[f"{method} {k}, {name}"] = [*figures(truth, labels, keep), seconds]
    return rows


def run_scores(options):
    from sklearn.cluster import DBSCAN

    from sklearn_mcmd import MCMDOutlierDetector
    from sklearn_mcmd.datasets import make_street

    for denoiser in options.denoise:
        table = {}
        for seed in range(options.seeds):
            street = make_street(options.size, outlier_share=options.share, random_state=seed)
            X, keep = street.data, np.ones(len(street.data), dtype=bool)
            if DENOISERS[denoiser] is not None:
                detector = MCMDOutlierDetector(
                    random_state=0, n_jobs=options.threads, **DENOISERS[denoiser]
                )
                keep = detector.fit_predict(X) == 1
            rows = compare_forms(X, street.surface, keep, options)
            if options.peers:
                start = time.perf_counter()
                labels = np.full(len(X), -1)
                labels[keep] = DBSCAN(2.5 * street.spacing, min_samples=5).fit_predict(X[keep])
                seconds = time.perf_counter() - start
                rows["DBSCAN, coordinates"] = [*figures(street.surface, labels, keep), seconds]
            for name, row in rows.items():
                table.setdefault(name, []).append(row)
        print_head(
            f"street of {options.size:,} points, {100 * options.share:g} % outliers, denoised: "
            f"{denoiser}; grown among {options.n_neighbors}, 15 degrees; {options.seeds} seeds"
        )
        for name, rows in table.items():
            print_row(name, np.mean(rows, axis=0))


def run_scenes(options):
    from simulators import make_bus_stop, make_traffic_furniture

    for make, angle in ((make_traffic_furniture, 15.0), (make_bus_stop, 5.0)):
        table = {}
        for seed in range(options.seeds):
            scene = make(random_state=seed)
            keep = np.ones(len(scene.data), dtype=bool)
            rows = compare_forms(scene.data, scene.surface, keep, options, angle)
            for key, row in rows.items():
                table.setdefault(key, []).append(row)
        print_head(
            f"{make.__name__}, grown among {options.n_neighbors}, {angle:g} degrees, "
            f"{options.seeds} seeds"
        )
        for key, rows in table.items():
            print_row(key, np.mean(rows, axis=0))


def run_roofs(options):
    """Rand index, or of barrels the share of the largest region, by crease and points."""
    from simulators import ROOFS, make_roof

    from sklearn_mcmd import RegionGrowing

    rows = [(n, noise) for n in options.sizes for noise in options.noises]
    for kind in ROOFS:
        means = []
        print(f"\n{kind}, creases of {', '.join(f'{crease:g}' for crease in options.creases)}")
        for n, noise in rows:
            row = []
            for crease in options.creases:
                scores = []
                for seed in range(options.seeds):
                    X, surface = make_roof(kind, n, crease, noise, seed)
                    with without_steps(*["divide_at_creases"] * options.whole):
                        labels = RegionGrowing(random_state=0).fit_predict(X)
                    if kind == "barrel":
                        scores.append(np.bincount(labels[labels >= 0]).max() / n)
                    else:
                        scores.append(adjusted_rand(surface, labels))
                row.append(np.mean(scores))
            means.append(row)
            print(f"{n:9,}{noise:7.2f}  " + "".join(f"{value:7.2f}" for value in row), flush=True)
        print(f"{'mean':18}{np.mean(means):7.3f}", flush=True)


def adjusted_rand(surface, labels):
    from sklearn.metrics import adjusted_rand_score

    return adjusted_rand_score(surface, labels)


def run_labelled(options):
    """Rand index of crown roofs and of real clouds, IoU of the tables; and the regions."""
    from _ablation_clouds import labelled

    from sklearn_mcmd import RegionGrowing
    from sklearn_mcmd.datasets import make_crown_roof

    clouds = [
        (f"crown roof {n:,} {seed}", make_crown_roof(n, random_state=seed))
        for n in (3_000, 20_000, 50_000)
        for seed in range(options.seeds)
    ]
    clouds = [(name, roof.data, roof.surface) for name, roof in clouds]
    clouds += [(key, X, surface) for _, key, X, surface in labelled(options)]
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
    for name, X, surface in clouds:
        row = []
        for divide in (False, True):
            with without_steps(*["divide_at_creases"] * (not divide)):
                labels = RegionGrowing(random_state=0).fit_predict(X)
            known = surface >= 0
            if known.any() and len(np.unique(surface[known])) == 1:  # a table
                largest = labels == np.bincount(labels[known & (labels >= 0)]).argmax()
                score = (largest & known).sum() / (largest | known).sum()
            else:
                score = adjusted_rand(surface[known], labels[known])
            row += [score, labels.max() + 1]
        print(
            f"{name:40}whole {row[0]:6.3f}{row[1]:5}  divided {row[2]:6.3f}{row[3]:5}", flush=True
        )


def run_peers(options):
    from _region_peers import run

    run(options)


def run_clouds(options):
    from sklearn_mcmd import RegionGrowing

    print(f"{'':32}{'points':>9}{'regions':>9}{'inside %':>10}{'seconds':>9}  largest")
    for path in options.files:
        with np.load(path) as arrays:
            X = arrays["xyz"].astype(np.float64)
        columns = normals_of(X, options.normals[0], options.methods[0], options.threads)
        start = time.perf_counter()
        growing = RegionGrowing(
            options.n_neighbors,
            max_angle=options.angle,
            normals="precomputed",
            n_jobs=options.threads,
        ).fit(columns)
        seconds = time.perf_counter() - start
        inside = 100 * np.mean(growing.labels_ >= 0)
        largest = " ".join(str(size) for size in growing.region_sizes_[:6])
        row = f"{len(X):9,}{growing.n_regions_:9,}{inside:10.1f}{seconds:9.2f}  {largest}"
        print(f"{Path(path).parent.name:32}{row}", flush=True)


def run_speed(options):
    if options.measure:
        measure(options)
        return
    import numba
    import scipy
    import sklearn

    versions = [f"{module.__name__} {module.__version__}" for module in (np, scipy, sklearn, numba)]
    print(f"{platform.machine()}, {os.cpu_count()} CPUs, Python {platform.python_version()}")
    print(
        f"{', '.join(versions)}\ngrown among {options.n_neighbors}, {options.threads} threads, "
        f"medians of {options.rounds} rounds\n"
    )
    print(f"{'points':>10}{'wall s':>9}{'CPU s':>9}{'us/point':>10}{'peak MB':>9}{'regions':>9}")
    for n in options.sizes:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "columns.npy")
            np.save(path, street_columns(n, options))
            command = [sys.executable, __file__, "speed", "--measure", path]
            command += ["--threads", str(options.threads)]
            command += ["--n-neighbors", str(options.n_neighbors)]
            runs = [
                json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
                for _ in range(options.rounds)
            ]
        wall, cpu, peak, regions = (statistics.median(c) for c in zip(*runs, strict=True))
        print(f"{n:10,}{wall:9.2f}{cpu:9.2f}{1e6 * cpu / n:10.2f}{peak:9.0f}{regions:9.0f}")


def street_columns(n, options):
    from sklearn_mcmd.datasets import make_street

    spacing = 0.02 if n >= 100_000 else None
    street = make_street(n, spacing=spacing, outlier_share=0.0, random_state=0)
    return normals_of(street.data, options.normals[0], options.methods[0], options.threads)


def measure(options):
    """In the child: grow once, warm, and print its figures as JSON."""
    from sklearn_mcmd import RegionGrowing

    columns = np.load(options.measure)
    growing = RegionGrowing(options.n_neighbors, normals="precomputed", n_jobs=options.threads)
    growing.fit(columns[:3000])  # compile and import before the clock starts
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    before, start, cpu = status("VmRSS"), time.perf_counter(), time.process_time()
    growing.fit(columns)
    wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    print(json.dumps([wall, cpu, status("VmHWM") - before, growing.n_regions_]))


def status(key):
    """An entry of Linux's process status, in MB."""
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) / 1024 for line in file if line.startswith(key + ":"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--n-neighbors", type=int, default=30, help="that regions grow among")
    common.add_argument("--normals", type=int, nargs="+", default=[50], help="neighbors")
    common.add_argument("--methods", nargs="+", default=["mcmd_z"])
    common.add_argument("--threads", type=int, default=2)
    tasks = parser.add_subparsers(dest="task", required=True)
    scores = tasks.add_parser("scores", parents=[common])
    scores.add_argument("--size", type=int, default=100_000)
    scores.add_argument("--share", type=float, default=0.1)
    scores.add_argument("--seeds", type=int, default=3)
    scores.add_argument("--denoise", nargs="+", default=["default"], choices=list(DENOISERS))
    scores.add_argument("--peers", action="store_true")
    scenes = tasks.add_parser("scenes", parents=[common])
    scenes.add_argument("--seeds", type=int, default=3)
    clouds = tasks.add_parser("clouds", parents=[common])
    clouds.add_argument("files", nargs="+")
    clouds.add_argument("--angle", type=float, default=15.0)
    roofs = tasks.add_parser("roofs")
    roofs.add_argument("--sizes", type=int, nargs="+", default=[200, 1000, 5000, 20_000])
    roofs.add_argument("--creases", type=float, nargs="+", default=[5, 10, 15, 20, 35, 50])
    roofs.add_argument("--noises", type=float, nargs="+", default=[0.1, 0.33])
    roofs.add_argument("--seeds", type=int, default=3)
    roofs.add_argument("--whole", action="store_true", help="divide nothing")
    marked = tasks.add_parser("labelled")
    marked.add_argument("--data", default="../shared/data", help="folder of real clouds")
    marked.add_argument("--seeds", type=int, default=2)
    peers = tasks.add_parser("peers")
    from _region_methods import METHODS

    peers.add_argument("--data", default="../shared/data", help="folder of real clouds")
    peers.add_argument("--methods", nargs="*", default=list(METHODS), choices=METHODS)
    peers.add_argument("--clouds", nargs="+", help="those that begin with one of these")
    peers.add_argument("--limit", type=float, default=180.0, help="seconds for a cloud")
    peers.add_argument("--resume", action="store_true", help="measure only what is not stored")
    peers.add_argument("--output", default="docs/benchmarks/segmentation.json")
    speed = tasks.add_parser("speed", parents=[common])
    speed.add_argument("--sizes", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    speed.add_argument("--rounds", type=int, default=3)
    speed.add_argument("--measure", help=argparse.SUPPRESS)
    options = parser.parse_args()
    tasks = {"scores": run_scores, "scenes": run_scenes, "clouds": run_clouds, "speed": run_speed}
    tasks |= {"roofs": run_roofs, "labelled": run_labelled, "peers": run_peers}
    tasks[options.task](options)


if __name__ == "__main__":
    main()
