"""How long, how much memory, how right? Normals, outliers, regions and edges beside peers.

Every measurement runs in its own process, in turn with the others, on a simulated street, whose
rows are shuffled, or sorted along the leaves of a tree. Processor time is the least of the rounds.
Memory is the peak less what the process holds with its input loaded. Only ratios can be compared
between machines. Peers that are not installed are left out (`pip install jakteristics open3d pgeof
small_gicp`). Linux only.

    python benchmarks/bench_peers.py --output docs/benchmarks/peers.json
    python benchmarks/bench_peers.py --show docs/benchmarks/peers.json

Results are stored in a file, and the tables that the docs show beside it.
"""

import argparse
import ctypes
import datetime
import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from _peer_jobs import JOBS, KINDS, OURS, Case, is_installed
from _tables import print_table, write_csv

PACKAGES = ("sklearn-mcmd", "numpy", "scipy", "scikit-learn", "numba", "joblib")
PEERS = ("open3d", "pgeof", "jakteristics", "small-gicp")
NEAR, RIGHT = 4.0, 10.0  # spacings from an edge, and degrees
NATIONAL_GRID = (5e5, 5.4e6, 0.0)
ORDERS = ("shuffled", "sorted")  # of rows
# Of processor times to that of normals, whose own time may be taken off before.
RATIOS = {
    "detector over normals": ("outliers: sklearn_mcmd", 0),
    "growing beyond its normals over normals": ("regions: sklearn_mcmd, with normals", 1),
}
N_WARM = 10_000  # points on which each process compiles and loads what it needs, before the clock
ONE_STREET = 100_000  # points with 2 cm between them; more are streets in a row


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[10**4, 10**5, 10**6])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--n-neighbors", type=int, default=50)
    parser.add_argument("--jobs", nargs="+", default=list(KINDS), help="kinds, or names of jobs")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds of one measurement")
    parser.add_argument("--output", type=Path, default=Path("peers.json"))
    parser.add_argument("--show", type=Path, metavar="FILE", help="tables of stored results")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.child:
        print(json.dumps(measure(**json.loads(options.child))))
        return
    if not options.show:
        jobs = [job for job in JOBS if job in options.jobs or job.partition(":")[0] in options.jobs]
        stored = {"header": header(options), "runs": list(runs(jobs, options))}
        head = json.dumps({"header": stored["header"]}, indent=1)[:-2]
        lines = ",\n".join(map(json.dumps, stored["runs"]))
        options.output.write_text(f'{head},\n "runs": [\n{lines}\n ]\n}}\n')
    path = options.show or options.output
    for name, (head, *rows) in tables(json.loads(path.read_text())).items():
        print_table(name, head, rows)
        write_csv(path.with_name(f"{name}.csv"), [head, *rows])


def runs(jobs, options):
    """Yield the figures of each measurement; normals are measured far from the origin, too."""
    for size in sorted(options.sizes):
        with tempfile.TemporaryDirectory() as folder:
            make_cloud(
                Path(folder), size, options.n_neighbors, columns=any("regions" in j for j in jobs)
            )
            rounds = range(options.rounds)
            conditions = [(i, order, job) for i in rounds for job in jobs for order in ORDERS]
            conditions += [(0, "national grid", job) for job in jobs if job.startswith("normals")]
            for i, order, job in conditions:
                if not is_installed(job):
                    continue
                condition = {"size": size, "round": i, "order": order, "job": job}
                condition["threads"] = options.threads
                figures = measure_apart(folder, condition, options)
                print(condition, figures, flush=True)
                yield condition | figures


def make_cloud(folder, n, k, *, columns):
    """Save streets in a row with their truth, shuffled, and columns of normals if wanted."""
    from scipy.spatial import cKDTree

    from sklearn_mcmd import RobustNormalEstimator
    from sklearn_mcmd.datasets import make_street

    m = max(1, round(n / ONE_STREET))
    streets = [make_street(n // m + (i < n % m), random_state=i) for i in range(m)]
    for i, street in enumerate(streets):
        street.data += [5.0 * i, 0, 0]
    shuffled = np.random.default_rng(0).permutation(n)
    arrays = {
        name: np.concatenate([street[name] for street in streets])[shuffled]
        for name in ("data", "normals", "edge_distance", "target")
    }
    arrays |= {"X": arrays.pop("data"), "spacing": streets[0].spacing}
    arrays["order"] = cKDTree(arrays["X"]).indices
    if columns:
        estimator = RobustNormalEstimator(k, random_state=0, n_jobs=-1)
        arrays["columns"] = estimator.fit_transform(arrays["X"])
    np.savez(folder / "street.npz", **arrays)


def measure_apart(folder, condition, options):
    """Figures of one run of a job in a fresh process, or ``{"left_out": reason}``."""
    names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, str(options.threads))}
    asked = {name: condition[name] for name in ("job", "order", "threads")}
    asked |= {"path": f"{folder}/street.npz", "k": options.n_neighbors, "limit": options.limit}
    command = [sys.executable, __file__, "--child", json.dumps(asked)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    if done.returncode == -signal.SIGALRM:
        return {"left_out": f"over {options.limit:g} s"}
    if done.returncode:
        return {"left_out": f"failed: {(done.stderr.strip() or 'no message').splitlines()[-1]}"}
    return json.loads(done.stdout.splitlines()[-1])


def measure(job, order, threads, path, k, limit):
    """In the child: seconds, processor seconds and megabytes of one run, and how good it is."""
    # Some libraries count the processors instead of taking a number of threads.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
    street = dict(np.load(path))
    spacing, rows = street.pop("spacing"), street.pop("order")
    if order == "sorted":
        street = {name: values[rows] for name, values in street.items()}
    X = street["X"] + (NATIONAL_GRID if order == "national grid" else 0.0)
    radius = float(spacing) * np.sqrt(k / np.pi)  # of the disk that holds k points
    columns = street.get("columns")
    first = slice(min(N_WARM, len(X)))
    JOBS[job].run(Case(X[first], k, threads, radius, None if columns is None else columns[first]))
    ctypes.CDLL(None).malloc_trim(0)  # what imports and compiling have freed
    Path("/proc/self/clear_refs").write_text("5")
    before = status("VmRSS")
    signal.setitimer(signal.ITIMER_REAL, limit)  # its signal ends the process
    cpu, wall = time.process_time(), time.perf_counter()
    answer = JOBS[job].run(Case(X, k, threads, radius, columns))
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    signal.setitimer(signal.ITIMER_REAL, 0)
    figures = {"wall": wall, "cpu": cpu, "peak_mb": max(status("VmHWM") - before, 0.0)}
    regular = street["target"] == 1
    if job.startswith("normals"):
        figures["quality"] = normals_quality(np.asarray(answer, np.float64), street, spacing)
    elif job.startswith("outliers"):
        share_found, kept = (answer[~regular] == -1).mean(), (answer[regular] == 1).mean()
        figures["quality"] = {"found": float(share_found), "kept": float(kept)}
    return figures


def normals_quality(normals, street, spacing):
    """Median angles to the true normals in degrees, and shares of right ones, by distance."""
    regular = street["target"] == 1
    cosine = np.abs(np.einsum("nd,nd->n", normals[regular], street["normals"][regular]))
    cosine = np.where(np.isnan(cosine), 0.0, cosine)  # no normal is a wrong one
    angle = np.degrees(np.arccos(np.minimum(cosine, 1.0)))
    near = street["edge_distance"][regular] < NEAR * spacing
    return {
        "near_right": float((angle[near] <= RIGHT).mean()),
        "far_right": float((angle[~near] <= RIGHT).mean()),
        "near_median": float(np.median(angle[near])),
        "far_median": float(np.median(angle[~near])),
        "median": float(np.median(angle)),
    }


def status(key):
    """An entry of Linux's process status, in MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(key + ":"))


def header(options):
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    packages = [f"{name} {number}" for name in (*PACKAGES, *PEERS) if (number := version_of(name))]
    about = {
        "processor": names[0] if names else platform.machine(),
        "processors": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "packages": ", ".join(packages),
        "date": datetime.date.today().isoformat(),
        "neighbors": str(options.n_neighbors),
        "threads": str(options.threads),
        "rounds": str(options.rounds),
        "limit": f"{options.limit:g} s for each measurement",
        "load before": f"{os.getloadavg()[1]:.2f} processes, mean of five minutes",
    }
    return {"n_neighbors": options.n_neighbors, "about": about}


def version_of(package):
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def tables(stored):
    """Rows of cells by the name of the table, the first row its head."""
    by_condition = defaultdict(list)
    for run in stored["runs"]:
        by_condition[run["order"], run["job"], run["size"]].append(run)
    sizes = sorted({run["size"] for run in stored["runs"]})
    shown = {"machine": [["measured", "with"], *map(list, stored["header"]["about"].items())]}
    shown["costs"] = costs(by_condition, sizes, stored["header"]["n_neighbors"])
    head = ["method", "within 10 deg. near edges", "elsewhere", "median near edges", "elsewhere"]
    shown["accuracy"] = [[*head, "all", "all, national grid", "us/point"]]
    shown["detection"] = [["method", "points", "outliers found", "regular points kept"]]
    for (order, job, size), of_job in by_condition.items():
        quality, name = of_job[0].get("quality"), job.partition(": ")[2]
        if order != ORDERS[0] or not quality:
            continue
        if job.startswith("outliers"):
            shares = [f"{100 * quality[part]:.1f} %" for part in ("found", "kept")]
            shown["detection"].append([name, f"{size:,}", *shares])
        elif size == sizes[-1]:
            shares = [f"{100 * quality[part]:.1f} %" for part in ("near_right", "far_right")]
            medians = [f"{quality[part]:.2f}" for part in ("near_median", "far_median", "median")]
            moved = by_condition.get(("national grid", job, size))
            grid = f"{moved[0]['quality']['median']:.2f}" if moved else "-"
            time = f"{1e6 / size * least(of_job, 'cpu'):.2f}"
            shown["accuracy"].append([name, *shares, *medians, grid, time])
    return shown


def costs(by_condition, sizes, k):
    """Processor time a neighbor by the order of rows and the size, ratios of it, and memory."""
    columns = [(order, size) for order in ORDERS for size in sizes]
    rows = [["ns a neighbor", *(f"{size:,} {order}" for order, size in columns)]]
    rows[0].append(f"MB at {sizes[-1]:,}")
    seconds = {
        job: [least(by_condition.get((o, job, n), ()), "cpu") for o, n in columns] for job in JOBS
    }
    for job in JOBS:
        if np.isfinite(seconds[job]).any():
            ns = 1e9 * np.divide(seconds[job], [n * k for _, n in columns])
            memory = least(by_condition.get((ORDERS[0], job, sizes[-1]), ()), "peak_mb")
            rows.append([job, *(f"{value:,.0f}" for value in [*ns, memory])])
    for name, (job, taken_off) in RATIOS.items():
        ratios = np.divide(seconds[job], seconds[OURS]) - taken_off
        rows.append([name, *(f"{value:.2f}" for value in ratios), "-"])
    return [[cell.replace("nan", "-") for cell in row] for row in rows]


def least(of_job, name):
    """The least of the rounds; NaN where there is none."""
    return min((run[name] for run in of_job if name in run), default=np.nan)


if __name__ == "__main__":
    main()
