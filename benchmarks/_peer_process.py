"""One measurement of `bench_peers.py` in a process of its own, and the clouds that it takes.

python benchmarks/_peer_process.py cloud FOLDER '{"n": 100000, ...}'
python benchmarks/_peer_process.py measure FOLDER '{"job": "normals: Open3D", ...}'
"""

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from _peer_jobs import JOBS, Case, leaf_order

__all__ = ["N_WARM", "make_cloud", "measure_apart"]

# An edge is near within so many spacings, as in `bench_normals.py`.
NEAR = 4.0
RIGHT = 10.0  # degrees
NATIONAL_GRID = (5e5, 5.4e6, 0.0)
# Points of the street on which each process compiles and loads what it needs, before the clock;
# as many as are measured, if these are fewer.
N_WARM = 10_000
# Streets of at least so many points have 2 cm between points. Smaller ones would be too short.
DENSE_FROM = 100_000


def make_cloud(folder, n, order, k, *, columns):
    """Save a street in `folder`; `columns` says whether normals for growing are wanted."""
    arguments = {"n": n, "order": order, "k": k, "columns": columns}
    answer = call("cloud", folder, arguments, os.cpu_count())
    if "left_out" in answer:
        raise RuntimeError(f"no street of {n} points: {answer['left_out']}")


def measure_apart(job, folder, warm, k, threads, limit):
    """Figures of one run of a job in a fresh process, or ``{"left_out": reason}``."""
    arguments = {"job": job, "warm": str(warm), "k": k, "threads": threads, "limit": limit}
    return call("measure", folder, arguments, threads)


def call(work, folder, arguments, threads):
    names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, str(threads))}
    command = [sys.executable, __file__, work, str(folder), json.dumps(arguments)]
    result = subprocess.run(command, capture_output=True, text=True, env=environment)
    if result.returncode == -signal.SIGALRM:
        return {"left_out": f"over {arguments['limit']:g} s"}
    if result.returncode < 0:
        return {"left_out": f"stopped by signal {-result.returncode}"}
    if result.returncode:
        return {"left_out": f"failed: {(result.stderr.strip() or 'no message').splitlines()[-1]}"}
    return json.loads(result.stdout.splitlines()[-1])


def cloud(folder, n, order, k, columns):
    """In the child: a street with its truth. "national grid" is the random order, moved."""
    from sklearn_mcmd.datasets import make_street

    folder = Path(folder)
    street = make_street(n, spacing=0.02 if n >= DENSE_FROM else None, random_state=0)
    rows = leaf_order(street.data) if order == "spatial" else slice(None)
    X = np.ascontiguousarray(street.data[rows])
    if order == "national grid":
        X += NATIONAL_GRID
    np.save(folder / "X.npy", X)
    np.save(folder / "normals.npy", street.normals[rows])
    np.save(folder / "edge_distance.npy", street.edge_distance[rows])
    np.save(folder / "target.npy", street.target[rows])
    # The disk that holds k points of a plane.
    radius = street.spacing * np.sqrt(k / np.pi)
    (folder / "scales.json").write_text(json.dumps([street.spacing, radius]))
    if columns:
        from sklearn_mcmd import RobustNormalEstimator

        estimator = RobustNormalEstimator(k, random_state=0, n_jobs=os.cpu_count())
        np.save(folder / "columns.npy", estimator.fit_transform(X))
    return {}


def measure(folder, job, warm, k, threads, limit):
    """In the child: seconds, processor seconds and megabytes of one run, and how good it is."""
    # Some libraries count the processors instead of taking a number of threads.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
    run = JOBS[job].run
    run(load(warm, job, k, threads))
    case = load(folder, job, k, threads)
    clear_peak()
    before = status("VmRSS")
    signal.setitimer(signal.ITIMER_REAL, limit)  # its signal ends the process
    cpu, wall = time.process_time(), time.perf_counter()
    answer = run(case)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    signal.setitimer(signal.ITIMER_REAL, 0)
    figures = {"wall": wall, "cpu": cpu, "peak_mb": max(peak() - before, 0.0)}
    if job.startswith("normals"):
        figures["quality"] = normals_quality(np.asarray(answer, dtype=np.float64), Path(folder))
    elif job.startswith("outliers"):
        regular = np.load(Path(folder) / "target.npy") == 1
        figures["quality"] = {
            "found": float((answer[~regular] == -1).mean()),
            "kept": float((answer[regular] == 1).mean()),
        }
    return figures


def load(folder, job, k, threads):
    folder = Path(folder)
    columns = np.load(folder / "columns.npy") if job.startswith("regions") else None
    _, radius = json.loads((folder / "scales.json").read_text())
    return Case(np.load(folder / "X.npy"), k, threads, radius, columns)


def normals_quality(normals, folder):
    """Median angles to the true normals in degrees, and shares of right ones, by distance."""
    spacing, _ = json.loads((folder / "scales.json").read_text())
    regular = np.load(folder / "target.npy") == 1
    truth, distance = np.load(folder / "normals.npy"), np.load(folder / "edge_distance.npy")
    cosine = np.abs(np.einsum("nd,nd->n", normals[regular], truth[regular]))
    cosine = np.where(np.isnan(cosine), 0.0, cosine)  # no normal is a wrong one
    angle = np.degrees(np.arccos(np.minimum(cosine, 1.0)))
    near = distance[regular] < NEAR * spacing
    return {
        "near_right": float((angle[near] <= RIGHT).mean()),
        "far_right": float((angle[~near] <= RIGHT).mean()),
        "near_median": float(np.median(angle[near])),
        "far_median": float(np.median(angle[~near])),
        "median": float(np.median(angle)),
    }


def clear_peak():
    """Give back what imports and compiling have freed, and forget their peak."""
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")


def peak():
    return status("VmHWM")


def status(key):
    """An entry of Linux's process status, in MB."""
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) / 1024 for line in file if line.startswith(key + ":"))


if __name__ == "__main__":
    work, folder, arguments = sys.argv[1:]
    run = {"cloud": cloud, "measure": measure}[work]
    print(json.dumps(run(folder, **json.loads(arguments))))
