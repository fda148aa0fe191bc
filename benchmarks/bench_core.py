"""How long does a robust normal take? Search, kernel and whole job against SciPy's search.

Every measurement runs in its own process, in turn with the others, on the same street cloud in
random row order (`--order spatial` sorts the rows first). Peak memory is that of the process,
less its memory with the input loaded. Seconds of wall and CPU time are medians over the rounds.
Ratios are to SciPy's search of the same run. Only ratios can be compared between machines.

    python benchmarks/bench_core.py --sizes 10000 100000 1000000 --threads 2
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

import numpy as np


def scipy_search(X, k, threads):
    from scipy.spatial import cKDTree

    cKDTree(X).query(X, k=k, workers=threads)


def our_search(X, k, threads):
    from joblib import Parallel, delayed

    from sklearn_mcmd.planes._neighborhoods import NeighborIndex, spatial_order

    index = NeighborIndex(X, k)
    order = spatial_order(X)
    rows = [order[start : start + 4096] for start in range(0, len(X), 4096)]
    Parallel(n_jobs=threads, require="sharedmem")(
        delayed(lambda r: len(index.query(X[r])[0]))(r) for r in rows
    )


def detector(X, k, threads):
    from sklearn_mcmd import MCMDOutlierDetector

    MCMDOutlierDetector(k, random_state=0, n_jobs=threads).fit_predict(X)


def normals(X, k, threads, **parameters):
    from sklearn_mcmd import RobustNormalEstimator

    RobustNormalEstimator(k, random_state=0, n_jobs=threads, **parameters).fit(X)


def normals_literal(X, k, threads):
    normals(X, k, threads, refine=None)


def normals_md(X, k, threads):
    normals(X, k, threads, method="mcmd_md")


def normals_pca(X, k, threads):
    normals(X, k, threads, method="pca")


def open3d_normals(X, k, threads):
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(X))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(k))


def pgeof_normals(X, k, threads):
    import pgeof

    local = (X - X.mean(axis=0)).astype(np.float32)
    neighbors, _ = pgeof.knn_search(local, local, k)
    starts = np.arange(0, (len(X) + 1) * k, k, dtype=np.uint32)
    pgeof.compute_features(local, neighbors.ravel(), starts)


JOBS = {
    "scipy search": scipy_search,
    "our search": our_search,
    "detector (69 trials)": detector,
    "normals (69 trials)": normals,
    "normals, literal": normals_literal,
    "normals, mcmd_md": normals_md,
    "normals, pca": normals_pca,
    "Open3D PCA normals": open3d_normals,
    "pgeof PCA features": pgeof_normals,
}


def street(n, order):
    from sklearn_mcmd.datasets import make_street

    # 2 cm between points, the street as long as that makes it; coarser where it would be none.
    X = make_street(n, spacing=0.02 if n >= 100_000 else None, random_state=0).data
    if order == "spatial":
        from sklearn_mcmd.planes._neighborhoods import spatial_order

        X = X[spatial_order(X)]
    return np.ascontiguousarray(X)


def measure(job, path, k, threads):
    """In the child: run a job once, warm, and print its figures as JSON."""
    X = np.load(path)
    run = JOBS[job]
    # Compile and import before the clock starts.
    run(X[: min(len(X), 2000)], k, threads)
    # Forget the peak of imports and compiling.
    with open("/proc/self/clear_refs", "w") as file:
        file.write("5")
    before, start = status("VmRSS"), time.perf_counter()
    cpu = time.process_time()
    run(X, k, threads)
    wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    print(json.dumps([wall, cpu, status("VmHWM") - before]))


def status(key):
    """An entry of Linux's process status, in MB."""
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) / 1024 for line in file if line.startswith(key + ":"))


def child(arguments, threads):
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads), "NUMBA_NUM_THREADS": str(threads)}
    result = subprocess.run(
        [sys.executable, __file__, *arguments], capture_output=True, text=True, env=environment
    )
    if result.returncode:
        return result.stderr.strip().splitlines()[-1]
    return json.loads(result.stdout.splitlines()[-1])


def seconds_of(statement, repeats=7):
    """Median seconds of a fresh interpreter running a statement."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", statement], check=True)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def small_fit():
    """Milliseconds of the first fit on 50 points in a fresh process, import excluded."""
    statement = (
        "import time, numpy as np, sklearn_mcmd as s;"
        "X = np.random.default_rng(0).normal(size=(50, 3));"
        "t = time.perf_counter(); s.RobustNormalEstimator(random_state=0).fit(X);"
        "print(1e3 * (time.perf_counter() - t))"
    )
    command = [sys.executable, "-c", statement]
    runs = [subprocess.run(command, capture_output=True, check=True) for _ in range(5)]
    return statistics.median(float(run.stdout) for run in runs)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--n-neighbors", type=int, default=50)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--order", choices=["random", "spatial"], default="random")
    parser.add_argument("--jobs", nargs="+", default=list(JOBS), choices=list(JOBS), metavar="JOB")
    parser.add_argument("--measure", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        measure(*options.measure, options.n_neighbors, options.threads)
        return

    import numba
    import scipy
    import sklearn

    modules = (np, scipy, sklearn, numba)
    versions = ", ".join(f"{module.__name__} {module.__version__}" for module in modules)
    print(f"{platform.machine()}, {os.cpu_count()} CPUs, Python {platform.python_version()}")
    print(versions)
    print(
        f"k = {options.n_neighbors}, {options.threads} threads, rows in {options.order} order, "
        f"medians of {options.rounds} rounds\n"
    )
    for n in options.sizes:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "street.npy")
            np.save(path, street(n, options.order))
            figures = {job: [] for job in options.jobs}
            for _ in range(options.rounds):
                for job in options.jobs:
                    arguments = ["--measure", job, path, "--threads", str(options.threads)]
                    arguments += ["--n-neighbors", str(options.n_neighbors)]
                    figures[job].append(child(arguments, options.threads))
        print(f"n = {n:,}")
        print(f"{'':24}{'wall s':>9}{'CPU s':>9}{'us/point':>10}{'peak MB':>9}{'ratio':>8}")
        base = None
        for job, runs in figures.items():
            if isinstance(runs[0], str):
                print(f"{job:24}{runs[0]}")
                continue
            wall, cpu, peak = (statistics.median(column) for column in zip(*runs, strict=True))
            base = base or wall
            row = f"{job:24}{wall:9.3f}{cpu:9.2f}{1e6 * cpu / n:10.2f}{peak:9.0f}"
            print(f"{row}{wall / base:8.2f}")
        print()
    ours, theirs = seconds_of("import sklearn_mcmd"), seconds_of("import sklearn.neighbors")
    print(f"import sklearn_mcmd: {ours:.2f} s, {ours / theirs:.2f} times sklearn.neighbors")
    print(f"first fit on 50 points: {small_fit():.0f} ms")


if __name__ == "__main__":
    main()
