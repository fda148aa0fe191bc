"""Measures methods of `_region_methods.py` on clouds of `_region_clouds.py`, and shows them.

A method runs in a process of its own on one processor, and goes from cloud to cloud. If it fails or
takes too long at one, a new process goes on with the next. Each measurement is stored at once.

    python benchmarks/_region_peers.py METHOD DATA LIMIT CLOUD ...    # the child
"""

import json
import os
import re
import signal
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np
from _real_clouds import spacing_of
from _region_clouds import loaders, scores
from _region_methods import (
    LEAST,
    LEAST_OF_SMALL,
    METHODS,
    SMALL,
    Case,
    Clock,
    version_of,
)
from _tables import print_table, write_csv

N_WARM = 2000  # points on which a process compiles and loads what it needs, before the clock

MEASURES = {
    "precision": "precision",
    "recall": "recall",
    "f1": "F1",
    "f1_strict": "F1 at .75",
    "under": "under",
    "over": "over",
    "missed": "missed",
    "noise": "noise",
    "iou": "mean IoU",
    "dice": "Dice",
}
STREET = {
    "road": "road in its largest region",
    "facade": "facade in five",
    "of_class": "points of their region's main class",
}


def peers(options):
    """Measure the methods that are asked for and installed, keep the others' stored results."""
    path = Path(options.output)
    stored = json.loads(path.read_text()) if path.is_file() else {}
    clouds = [
        name
        for name in loaders(options.data)
        if not options.clouds or any(name.startswith(begin) for begin in options.clouds)
    ]
    for method in options.methods:
        package = version_of(method)
        if package is None:
            print(f"{method}: {METHODS[method].package} is not installed", flush=True)
            continue
        kept = stored.get(method, {}).get("clouds", {}) if options.clouds else {}
        stored[method] = {"package": package, "clouds": kept}
        for name, figures in measured(method, options.data, options.limit, clouds):
            kept[name] = figures
            save(path, stored)
            print(f"{method:26}{name:30}{json.dumps(figures)}", flush=True)
    for name, (head, *rows) in tables(stored).items():
        print_table(name, head, rows)
        write_csv(path.with_name(f"{path.stem}_{name}.csv"), [head, *rows])


def measured(method, data, limit, clouds):
    """Yield each cloud and the figures of the method on it, or why it has none."""
    names = ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {**os.environ, **dict.fromkeys(names, "1")}
    while clouds:
        command = [sys.executable, __file__, method, str(data), str(limit), *clouds]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as child:
            for line in child.stdout:
                if line.startswith("{"):
                    yield clouds[0], json.loads(line)
                    clouds = clouds[1:]
        if clouds:
            late = child.returncode == -signal.SIGALRM
            yield clouds[0], {"failed": f"over {limit:g} s" if late else "failed"}
            clouds = clouds[1:]


def child(method, data, limit, *clouds):
    processor = os.getpid() % len(os.sched_getaffinity(0))
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[processor : processor + 1])
    load = loaders(data)
    measure(method, load["crown roof 3,000"](), N_WARM)
    for name in clouds:
        cloud = load[name]()
        signal.setitimer(signal.ITIMER_REAL, float(limit))  # its signal ends the process
        labels, seconds = measure(method, cloud)
        signal.setitimer(signal.ITIMER_REAL, 0)
        figures = {"points": len(labels), "seconds": round(seconds, 4), **scores(cloud, labels)}
        print(json.dumps(figures), flush=True)


def measure(method, cloud, most=None):
    """Labels, numbered from 0 on, and processor seconds."""
    X = np.ascontiguousarray(cloud.X[:most] - cloud.X.mean(axis=0))
    spacing, clock = spacing_of(X), Clock()
    distance = max(3 * float(np.median(cloud.noise)), spacing / 2)
    least = LEAST if len(X) >= SMALL else LEAST_OF_SMALL
    labels = METHODS[method].run(Case(X, spacing, distance, least, clock))
    inside = labels >= 0
    labels[inside] = np.unique(labels[inside], return_inverse=True)[1]
    return labels, clock.seconds


def save(path, stored):
    part = path.with_suffix(".part")
    text = json.dumps(stored, indent=1) + "\n"
    part.write_text(re.sub(r"\n {4}|\n {3}(?=})", " ", text))  # one measurement a line
    os.replace(part, path)


def tables(stored):
    """Name -> rows. A cloud has a row, the mean over its parts; a method has a column."""
    rows = {}
    for method in METHODS:
        for name, figures in stored.get(method, {}).get("clouds", {}).items():
            rows.setdefault(name.partition("/")[0], {}).setdefault(method, []).append(figures)
    streets = [row for row, by in rows.items() if has(by, "road")]  # classes are no planes
    planes = [row for row in rows if row not in streets]

    def table(names, cell):
        return [["cloud", "points", *METHODS]] + [
            [name, points(rows[name]), *(cell(rows[name].get(method)) for method in METHODS)]
            for name in names
        ]

    def means(names, measures):
        cells = [mean_of("score"), *map(percent_of, measures)]
        figures = {method: each_row(rows, names, measures, method) for method in METHODS}
        return [["method", "ARI", *measures.values()]] + [
            [method, *(cell(parts) for cell in cells)] for method, parts in figures.items()
        ]

    packages = {name: stored.get(name, {}).get("package", "not installed") for name in METHODS}
    return {
        "methods": [["method", "setting", "package"]]
        + [[name, method.setting, packages[name]] for name, method in METHODS.items()],
        "scores": table(rows, mean_of("score")),
        "f1": table(planes, percent_of("f1")),
        "iou": table(planes, mean_of("iou")),
        "planes": means(planes, MEASURES),
        "street": means(streets, STREET),
        "seconds": table(rows, seconds),
    }


def each_row(rows, names, measures, method):
    """The figures of each cloud that the method has finished, means over its parts."""
    done = [parts for name in names if not why_none(parts := rows[name].get(method))]
    return [
        {key: statistics.mean(part[key] for part in parts) for key in ("score", *measures)}
        for parts in done
    ]


def has(by_method, measure):
    return any(measure in part for parts in by_method.values() for part in parts)


def points(by_method):
    sizes = [part["points"] for parts in by_method.values() for part in parts if "points" in part]
    return f"{max(sizes):,}" if sizes else ""


def mean_of(key, scale=1, digits=2):
    """A cell: the mean over parts, with its standard error where they are several."""

    def cell(parts):
        if absent := why_none(parts):
            return absent
        values = [scale * part[key] for part in parts]
        mean = f"{round(statistics.mean(values), digits) + 0.0:.{digits}f}"  # not -0.00
        if len(values) == 1:
            return mean
        return f"{mean} ± {statistics.stdev(values) / len(values) ** 0.5:.{digits}f}"

    return cell


def percent_of(key):
    return mean_of(key, 100, 0)


def seconds(parts):
    return why_none(parts) or f"{statistics.mean(part['seconds'] for part in parts):.2g}"


def why_none(parts):
    if not parts:
        return "not run"
    return next((part["failed"] for part in parts if "failed" in part), None)


if __name__ == "__main__":
    child(*sys.argv[1:])
