"""Tables and plots of the results of `bench_peers.py`."""

import csv
import math
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import NamedTuple

from _peer_jobs import JOBS, KINDS

__all__ = ["POINTS", "Results", "draw", "tables", "write_tables"]

# What the targets are about.
POINTS, THREADS, ORDER, ROUNDS = 1_000_000, 2, "random", 5
GROWTH = 100_000, 10_000_000
OURS = (
    "search: sklearn_mcmd",
    "normals: sklearn_mcmd, default",
    "normals: sklearn_mcmd, literal",
    "outliers: sklearn_mcmd",
    "regions: sklearn_mcmd growing",
)
# Okabe and Ito's colors, which people who see two primary colors can tell apart, and a marker.
LOOKS = {
    "sklearn_mcmd": ("#0072B2", "o"),
    "scipy": ("#777777", "s"),
    "pykdtree": ("#CC79A7", "v"),
    "pynanoflann": ("#E69F00", "P"),
    "small_gicp": ("#009E73", "D"),
    "pgeof": ("#D55E00", "^"),
    "sklearn": ("#56B4E9", "X"),
    "open3d": ("#000000", "s"),
    "jakteristics": ("#CC79A7", "v"),
}
DASHES = ("-", "--", ":")


class Results:
    """Measurements by job, size, order and threads.

    Parameters
    ----------
    stored : dict
        What the script stores: "header", and "runs" with "job", "size", "order", "threads",
        "round" and either figures or "left_out", the reason why there are none.
    """

    def __init__(self, stored):
        self.header = stored["header"]
        self._runs, self._notes = defaultdict(dict), {}
        for run in stored["runs"]:
            condition = run["job"], run["size"], run["order"], run["threads"]
            if "left_out" in run:
                self._notes[condition] = run["left_out"]
            else:
                self._runs[condition][run["round"]] = run
        known = {*self._runs, *self._notes}
        self.jobs = [job for job in JOBS if any(job == c[0] for c in known)]
        self.sizes = sorted({c[1] for c in known})
        self.orders = [o for o in ("random", "spatial") if any(o == c[2] for c in known)]
        self.threads = sorted({c[3] for c in known})

    @property
    def usual_size(self):
        """The targets' size, or else the nearest smaller one, or else the least."""
        return max((n for n in self.sizes if n <= POINTS), default=min(self.sizes))

    @property
    def usual_threads(self):
        return THREADS if THREADS in self.threads else max(self.threads)

    def rounds(self, job, size, order=ORDER, threads=None):
        """Runs by round."""
        return self._runs.get((job, size, order, threads or self.usual_threads), {})

    def median(self, name, job, size, order=ORDER, threads=None):
        """Median of a figure over the rounds; None where there is none."""
        runs = self.rounds(job, size, order, threads).values()
        return median(run[name] for run in runs) if runs else None

    def quality(self, job, size, order=ORDER):
        """How good the answers are, the same in each round; empty where there are none."""
        for run in self.rounds(job, size, order).values():
            return run.get("quality", {})
        return {}

    def note(self, job, size, order, threads):
        return self._notes.get((job, size, order, threads), "-")


class Target(NamedTuple):
    """What has to be at most `limit`: a value of each round."""

    what: str
    limit: float
    values: Callable[[Results, int], list[float]]


def ratio(job, peer):
    """Wall time over the peer's in the same round."""

    def values(results, size):
        ours, theirs = results.rounds(job, size), results.rounds(peer, size)
        return [ours[i]["wall"] / theirs[i]["wall"] for i in ours if i in theirs]

    return values


def nanoseconds(job):
    """Processor time for each neighbor on one core."""

    def values(results, size):
        runs = results.rounds(job, size, ORDER, 1).values()
        return [1e9 * run["cpu"] / (size * results.header["n_neighbors"]) for run in runs]

    return values


SEARCH, DEFAULT, LITERAL, DETECTOR, GROWING = OURS
LEAF_ORDER, OPEN3D = "search: SciPy cKDTree, leaf order", "normals: Open3D"
TARGETS = (
    Target("search / cKDTree in leaf order", 0.45, ratio(SEARCH, LEAF_ORDER)),
    Target("search, ns per neighbor on one core", 50, nanoseconds(SEARCH)),
    Target("default normals / Open3D", 0.6, ratio(DEFAULT, OPEN3D)),
    Target("default normals / pgeof", 0.8, ratio(DEFAULT, "normals: pgeof, float32")),
    Target("literal normals / Open3D", 0.7, ratio(LITERAL, OPEN3D)),
    Target("detector / default normals", 1.5, ratio(DETECTOR, DEFAULT)),
    Target("growing / Open3D's normals", 0.333, ratio(GROWING, OPEN3D)),
)
EXPONENT = 1.05


def tables(results):
    """Rows of cells by the name of the table, the first row its head."""
    return {
        "machine": machine_table(results),
        "targets": targets_table(results),
        **{kind: times_table(results, kind) for kind in KINDS},
        "accuracy": accuracy_table(results),
        "detection": detection_table(results),
    }


def machine_table(results):
    return [["measured", "with"], *(list(row) for row in results.header["about"].items())]


def targets_table(results):
    rows = [["what", "at most", "measured", "points", "rounds", "met"]]
    for target in TARGETS:
        size = results.usual_size
        values = target.values(results, size)
        judged = size == POINTS and results.usual_threads == THREADS and len(values) >= ROUNDS
        rows.append(
            verdict(target.what, target.limit, values, f"{size:,}", str(len(values)), judged)
        )
    for job in OURS:
        sizes = [n for n in results.sizes if results.rounds(job, n)]
        if len(sizes) < 2:
            continue
        ends = sizes[0], sizes[-1]
        walls = [results.median("wall", job, n) for n in ends]
        exponent = math.log(walls[1] / walls[0]) / math.log(ends[1] / ends[0])
        rounds = "/".join(str(len(results.rounds(job, n))) for n in ends)
        what = f"growth, {job}"
        span = f"{ends[0]:,} to {ends[1]:,}"
        rows.append(verdict(what, EXPONENT, [exponent], span, rounds, ends == GROWTH))
    return rows


def verdict(what, limit, values, points, rounds, judged):
    """A row: the median beside the limit. Other sizes or too few rounds are not judged."""
    if not values:
        return [what, f"{limit:g}", "-", points, rounds, "not measured"]
    value = median(values)
    met = "not judged" if not judged else "yes" if value <= limit else "no"
    return [what, f"{limit:g}", f"{value:.3g}", points, rounds, met]


def times_table(results, kind):
    """Wall seconds under each condition; the rest in random order on the usual threads."""
    conditions = [(order, t) for order in results.orders for t in results.threads]
    head = ["points", "method", *(f"{order}, {t} thr." for order, t in conditions)]
    rows = [[*head, "spread", "CPU s", "MB"]]
    for size in results.sizes:
        for job in (job for job in results.jobs if job.startswith(kind)):
            row = [f"{size:,}", job.partition(": ")[2]]
            for condition in conditions:
                wall = results.median("wall", job, size, *condition)
                row.append(results.note(job, size, *condition) if wall is None else f"{wall:.3g}")
            walls = [run["wall"] for run in results.rounds(job, size).values()]
            if not walls:
                rows.append([*row, "-", "-", "-"])
                continue
            row.append(f"{100 * (max(walls) - min(walls)) / median(walls):.0f} %")
            row.append(f"{results.median('cpu', job, size):.3g}")
            rows.append([*row, f"{results.median('peak_mb', job, size):.0f}"])
    return rows


def accuracy_table(results):
    head = ["method", "within 10 deg. near edges", "elsewhere", "median near edges", "elsewhere"]
    rows = [[*head, "all", "all, national grid", "us/point"]]
    size = results.usual_size
    for job in (job for job in results.jobs if job.startswith("normals")):
        here, moved = results.quality(job, size), results.quality(job, size, "national grid")
        if not here:
            continue
        shares = [f"{100 * here[name]:.1f} %" for name in ("near_right", "far_right")]
        medians = [f"{here[name]:.2f}" for name in ("near_median", "far_median", "median")]
        grid = f"{moved['median']:.2f}" if moved else "-"
        time = f"{1e6 * results.median('wall', job, size) / size:.2f}"
        rows.append([job.partition(": ")[2], *shares, *medians, grid, time])
    return rows


def detection_table(results):
    rows = [["method", "points", "outliers found", "regular points kept"]]
    for job in (job for job in results.jobs if job.startswith("outliers")):
        for size in (n for n in results.sizes if results.quality(job, n)):
            shares = results.quality(job, size)
            cells = [f"{100 * shares[name]:.1f} %" for name in ("found", "kept")]
            rows.append([job.partition(": ")[2], f"{size:,}", *cells])
    return rows


def write_tables(results, folder):
    for name, rows in tables(results).items():
        with open(Path(folder) / f"{name}.csv", "w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(rows)


def draw(results, folder, suffix=".svg"):
    """Save the plots: time against size for each kind, and accuracy against time."""
    import matplotlib

    # The same results give the same file.
    with matplotlib.rc_context({"svg.hashsalt": "sklearn_mcmd", "font.size": 9}):
        figures = {f"time_{kind}": draw_times(results, kind) for kind in KINDS}
        figures["accuracy"] = draw_accuracy(results)
        for name, figure in figures.items():
            metadata = {"Date": None} if suffix == ".svg" else None
            figure.savefig(Path(folder) / f"{name}{suffix}", metadata=metadata)


def draw_times(results, kind):
    """Microseconds per point against the number of points, by order of the rows."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.8), layout="constrained")
    panels = figure.subplots(1, len(results.orders), sharey=True, squeeze=False)[0]
    for ax, order in zip(panels, results.orders, strict=True):
        seen = defaultdict(int)
        for job in (job for job in results.jobs if job.startswith(kind)):
            sizes = [n for n in results.sizes if results.rounds(job, n, order)]
            times = [1e6 * results.median("wall", job, n, order) / n for n in sizes]
            ax.plot(sizes, times, label=job.partition(": ")[2], **look(job, seen))
        ax.set(xscale="log", yscale="log", title=f"rows in {order} order", xlabel="points")
        ax.grid(which="both", linewidth=0.3, alpha=0.5)
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_formatter("{x:g}")
    panels[0].set_ylabel(f"microseconds per point, {results.usual_threads} threads")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")
    return figure


def draw_accuracy(results):
    """Share of right normals near edges against time: the upper left corner is best."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4), layout="constrained")
    ax = figure.subplots()
    size, seen = results.usual_size, defaultdict(int)
    for job in (job for job in results.jobs if job.startswith("normals")):
        quality = results.quality(job, size)
        if quality:
            style = {**look(job, seen), "linestyle": "none", "markersize": 9}
            time = 1e6 * results.median("wall", job, size) / size
            label = job.partition(": ")[2]
            ax.plot(time, 100 * quality["near_right"], label=label, **style)
    ax.set(xlabel=f"microseconds per point, {results.usual_threads} threads", ylim=(0, 100))
    ax.set_xlim(left=0)
    ax.set_ylabel("normals within 10 degrees near edges, %")
    ax.set_title(
        f"{size:,} points, rows in {ORDER} order, {results.header['n_neighbors']} neighbors"
    )
    ax.grid(linewidth=0.3, alpha=0.5)
    figure.legend(loc="outside right center")
    return figure


def look(job, seen):
    """Color and marker of the package; its second and third job are dashed and open."""
    package = JOBS[job].package
    color, marker = LOOKS[package]
    count, seen[package] = seen[package], seen[package] + 1
    return {
        "color": color,
        "marker": "*" if count == 2 else marker,
        "linestyle": DASHES[count],
        "markerfacecolor": color if count == 0 else "none",
        "linewidth": 2.4 if package == "sklearn_mcmd" else 1.2,
        "zorder": 3 if package == "sklearn_mcmd" else 2,
    }
