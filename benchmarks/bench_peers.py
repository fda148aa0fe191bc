"""How long, how much memory, how right? Searches, normals, outliers and regions beside peers.

Every measurement runs in its own process, in turn with the others, on a simulated street. Wall
and processor time are medians over the rounds. Memory is the peak less what the process holds
with its input loaded. Only ratios can be compared between machines. Peers that are not installed
are left out (`pip install jakteristics open3d pgeof pykdtree pynanoflann small_gicp`). Linux only.

    python benchmarks/bench_peers.py --sizes 100000 1000000 10000000 --rounds 5 5 2 \\
        --orders random spatial --threads 1 2 --output docs/benchmarks/peers.json
    python benchmarks/bench_peers.py --show docs/benchmarks/peers.json

Each measurement is stored at once; `--resume` goes on with an interrupted run. `--show` prints the
tables and writes them and the plots beside the file. The docs show these.
"""

import argparse
import contextlib
import datetime
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from _peer_jobs import JOBS, KINDS, is_installed
from _peer_process import N_WARM, make_cloud, measure_apart
from _peer_report import POINTS, Results, draw, tables, write_tables

PACKAGES = ("sklearn-mcmd", "numpy", "scipy", "scikit-learn", "numba", "joblib")
PEERS = ("open3d", "pgeof", "jakteristics", "small-gicp", "pynanoflann", "pykdtree")


class Condition(NamedTuple):
    """One measurement. Rounds, orders and threads alternate, so a busy minute meets them all."""

    size: int
    round: int
    order: str
    threads: int
    job: str


def main():
    options = parse()
    if options.show:
        show(Path(options.show))
        return
    for job in [job for job in options.jobs if not is_installed(job)]:
        print(f"{job}: left out, {JOBS[job].package} is not installed")
        options.jobs.remove(job)
    store = Store(Path(options.output), options)
    conditions = [c for c in plan(options) if not store.has(c)]
    for size in options.sizes:
        todo = [c for c in conditions if c.size == size]
        with contextlib.ExitStack() as stack:
            folders = clouds(stack, todo, options.n_neighbors) if todo else {}
            for condition in todo:
                if store.has(condition):  # left out in an earlier round
                    continue
                reason = why_not(store.runs, condition, options.limit, options.memory)
                figures = {"left_out": reason} if reason else run(condition, folders, options)
                store.add(condition, figures)
                print(describe(condition, figures), flush=True)
    store.finish()
    print(f"\n{options.output} is complete; --show {options.output} draws it")


def parse():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[100_000, POINTS])
    orders = ["random", "spatial"]
    parser.add_argument("--orders", nargs="+", default=orders, choices=orders)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, nargs="+", default=[5], help="one, or one per size")
    parser.add_argument("--n-neighbors", type=int, default=50)
    parser.add_argument("--jobs", nargs="+", default=list(KINDS), help="kinds, or names of jobs")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds of one measurement")
    parser.add_argument(
        "--memory", type=float, help="MB of one measurement; default: 80 %% of free"
    )
    parser.add_argument("--output", default="peers.json")
    parser.add_argument("--resume", action="store_true", help="go on with the file of --output")
    parser.add_argument("--note", help="shown above the tables, such as why a run is no final one")
    parser.add_argument("--show", metavar="FILE", help="print and draw stored results")
    options = parser.parse_args()
    options.sizes = sorted(set(options.sizes))
    if len(options.rounds) not in (1, len(options.sizes)):
        parser.error("--rounds takes one number, or one for each of --sizes")
    options.jobs = [j for j in JOBS if j in options.jobs or j.partition(":")[0] in options.jobs]
    if not options.jobs:
        parser.error(f"--jobs are {', '.join(KINDS)}, or of {list(JOBS)}")
    available = len(os.sched_getaffinity(0))
    if max(options.threads) > available:
        parser.error(f"--threads: only {available} processors are there")
    options.memory = options.memory or 0.8 * free_memory()
    return options


def plan(options):
    """All measurements in their order, then those of normals far from the origin."""
    conditions = []
    rounds = options.rounds * (len(options.sizes) if len(options.rounds) == 1 else 1)
    grid_size = max((n for n in options.sizes if n <= POINTS), default=min(options.sizes))
    for size, n_rounds in zip(options.sizes, rounds, strict=True):
        jobs = [job for job in options.jobs if size <= JOBS[job].max_points]
        conditions += [
            Condition(size, i, order, threads, job)
            for i in range(n_rounds)
            for order in options.orders
            for threads in options.threads
            for job in jobs
        ]
        if size == grid_size:
            conditions += [
                Condition(size, 0, "national grid", max(options.threads), job)
                for job in jobs
                if job.startswith("normals")
            ]
    return conditions


def clouds(stack, conditions, k):
    """Folders with the streets of one size by order, and the small one to warm up with."""
    largest = max(condition.size for condition in conditions)
    folders = {"warm": (min(N_WARM, largest), "random")}
    folders |= {c.order: (c.size, c.order) for c in conditions}
    columns = any(c.job.startswith("regions") for c in conditions)
    for name, (n, order) in folders.items():
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        wanted = columns and order != "national grid"
        make_cloud(folder, n, order, k, columns=wanted)
        folders[name] = folder
    return folders


def run(condition, folders, options):
    warm, folder = folders["warm"], folders[condition.order]
    k, threads = options.n_neighbors, condition.threads
    return measure_apart(condition.job, folder, warm, k, threads, options.limit)


def why_not(runs, condition, limit, memory):
    """Why a measurement would be in vain, by what smaller clouds took; None if it is not."""
    alike = [
        run
        for run in runs
        if all(run[name] == getattr(condition, name) for name in ("job", "order", "threads"))
        and run["size"] < condition.size
    ]
    for run in alike:
        if "left_out" in run:
            return run["left_out"].removesuffix(LESS) + LESS
    if not alike:
        return None
    largest = max(run["size"] for run in alike)
    growth = condition.size / largest
    last = [run for run in alike if run["size"] == largest]
    seconds = growth * statistics.median(run["wall"] for run in last)
    if seconds > limit:
        return f"about {seconds:.0f} s expected"
    megabytes = growth * statistics.median(run["peak_mb"] for run in last)
    return f"about {megabytes:.0f} MB expected" if megabytes > memory else None


LESS = ", with fewer points"


class Store:
    """The file of results. It is complete after each measurement, whatever happens next.

    Parameters
    ----------
    path : Path
    options : argparse.Namespace
    """

    def __init__(self, path, options):
        self.path = path
        stored = json.loads(path.read_text()) if path.exists() else None
        if options.resume and stored:
            about = stored["header"]["about"]
            same = stored["header"]["n_neighbors"] == options.n_neighbors
            if not same or any(about[name] != value for name, value in machine().items()):
                sys.exit(f"{path} is of another machine, other versions or other neighbors")
            self.stored = stored
        elif stored and not stored["complete"]:
            sys.exit(f"{path} is an unfinished run: --resume goes on with it; or move it away")
        else:
            self.stored = {"complete": False, "header": header(options), "runs": []}
        self.stored["complete"] = False
        self.runs = self.stored["runs"]

    def has(self, condition):
        """Whether it is measured, or was given up in some round."""
        name = condition._asdict()
        return any(
            all(run[key] == value for key, value in name.items() if key != "round")
            and (run["round"] == condition.round or "left_out" in run)
            for run in self.runs
        )

    def add(self, condition, figures):
        self.runs.append({**condition._asdict(), **figures})
        self.save()

    def finish(self):
        self.stored["complete"] = True
        self.save()

    def save(self):
        self.path.parent.mkdir(parents=True, exist_ok=True)
        part = self.path.with_suffix(".part")
        # One measurement a line.
        head = json.dumps({**self.stored, "runs": []}, indent=1)
        runs = ",\n".join(json.dumps(run) for run in self.runs)
        part.write_text(head.replace('"runs": []', f'"runs": [\n{runs}\n]') + "\n")
        os.replace(part, self.path)


def header(options):
    note = {"note": options.note} if options.note else {}
    about = {
        **note,
        **machine(),
        "date": datetime.date.today().isoformat(),
        "neighbors": str(options.n_neighbors),
        "limit": f"{options.limit:g} s and {options.memory:.0f} MB for each measurement",
        **startup(),
    }
    return {"n_neighbors": options.n_neighbors, "about": about}


def machine():
    """What measurements of one run have in common."""
    packages = [f"{name} {found}" for name in (*PACKAGES, *PEERS) if (found := version_of(name))]
    return {
        "processor": processor(),
        "processors": str(os.cpu_count()),
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "packages": ", ".join(packages),
    }


def version_of(package):
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def processor():
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def free_memory():
    lines = Path("/proc/meminfo").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("MemAvailable"))


def startup():
    """Seconds to import the package, and milliseconds of its first fit, import left out."""
    imports = [
        f"{seconds_of(f'import {name}'):.2f} s" for name in ("sklearn_mcmd", "sklearn.neighbors")
    ]
    fit = (
        "import time, numpy as np, sklearn_mcmd as s;"
        "X = np.random.default_rng(0).normal(size=(50, 3));"
        "t = time.perf_counter(); s.RobustNormalEstimator(random_state=0).fit(X);"
        "print(1e3 * (time.perf_counter() - t))"
    )
    command = [sys.executable, "-c", fit]
    fits = [subprocess.run(command, capture_output=True, check=True).stdout for _ in range(5)]
    return {
        "import": f"{imports[0]}; of sklearn.neighbors {imports[1]}",
        "first fit of 50 points": f"{statistics.median(map(float, fits)):.0f} ms",
    }


def seconds_of(statement, repeats=7):
    """Median seconds of a fresh interpreter running a statement."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-c", statement], check=True)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def describe(condition, figures):
    where = f"{condition.size:>10,} {condition.order:13} {condition.threads} {condition.job:36}"
    if "left_out" in figures:
        return f"{where} left out: {figures['left_out']}"
    wall, cpu, peak = (figures[name] for name in ("wall", "cpu", "peak_mb"))
    return f"{where}{wall:9.3f} s wall{cpu:9.2f} s CPU{peak:8.0f} MB"


def show(path):
    results = Results(json.loads(path.read_text()))
    for name, rows in tables(results).items():
        print(f"\n{name}")
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        for row in rows:
            print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)))
    write_tables(results, path.parent)
    draw(results, path.parent)
    print(f"\nwritten beside {path.name}: tables (csv) and plots (svg)")


if __name__ == "__main__":
    main()
