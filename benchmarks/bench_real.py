"""What does each outlier detector take from, and find in, every real cloud?

Two parts for each cloud, in percent. "clean" is the cloud as it is: the real points that a method
flags, of all and by the publishers' classes, and how much of the noise that publishers label it
finds. "injected" is the cloud without that noise, with 10 % of outliers put in, whose truth is
known. Peers marked "told" know the share of outliers, where it is known, and take scikit-learn's
default elsewhere. "time" is the processor time as a ratio to that of "SOR 20".

    python benchmarks/bench_real.py --csv real.csv --table real.md
    python benchmarks/bench_real.py --clouds ign_village snow_spinning_lidar --limit 50000

SOR is statistical outlier removal: a point goes whose mean distance to its k nearest others is
more than 2 standard deviations above the mean of all. Radius outlier removal takes points with
fewer than 5 others within 3 times the cloud's median spacing. ``_real_methods.py`` has the others
and their sources; what needs the sensor's position runs on clouds that were taken from their
origin. A new setting of the detector is one line in its `METHODS`. Classes and kinds of outliers
not in the tables are in the CSV file.
"""

import argparse
import csv
import io
import os
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _real_clouds import RealCloud, evaluate, inject, load_clouds
from _real_methods import METHODS, judgment

YARDSTICK = "SOR 20"


class Row(NamedTuple):
    """One number: `subset` is "all", a class or a kind of outliers; `value` is in percent."""

    cloud: str
    part: str
    method: str
    points: int
    measure: str
    subset: str
    value: float


def parts_of(cloud, seed):
    """Name, cloud and kind of its points, of both parts; outliers put in have no intensity."""
    real = np.ones(len(cloud.points), dtype=bool) if cloud.noise is None else ~cloud.noise
    yield "clean", cloud, np.where(real, "real", "noise")
    points, kind = inject(cloud.points[real], np.random.default_rng(seed))
    classes = cloud.classes
    if classes is not None:
        classes = np.concatenate([classes[real], kind[kind != "real"]])
    yield "injected", cloud._replace(points=points, classes=classes, intensity=None), kind


def timed(name, cloud, share):
    start = time.process_time()
    result = judgment(name, cloud, share)
    return result, time.process_time() - start


def measured(cloud, methods, seed):
    """Rows of a cloud."""
    for part, part_cloud, kind in parts_of(cloud, seed):
        outliers = kind != "real"
        share = outliers.mean() if outliers.any() else None
        _, yardstick = timed(YARDSTICK, part_cloud, share)
        for name in methods:
            result, seconds = timed(name, part_cloud, share)
            if result is None:
                continue
            labels, outlyingness = result
            found = evaluate(labels, outlyingness, kind, part_cloud.classes)
            found["seconds", "all"] = seconds
            found["time", "all"] = seconds / yardstick
            for (measure, subset), value in found.items():
                yield Row(cloud.name, part, name, len(kind), measure, subset, value)


TABLES = [
    ("clean", "flagged", None, "Real points flagged, by class"),
    ("clean", "TPR", "all", "Labelled noise found"),
    ("clean", "precision", "all", "Labelled noise: share of it among all that is flagged"),
    ("clean", "average precision", "all", "Labelled noise: average precision of the score"),
    ("injected", "TPR", "all", "Injected outliers found"),
    ("injected", "TPR", "uniform", "Injected outliers found: uniform in the box"),
    ("injected", "TPR", "group", "Injected outliers found: groups of 20 to 60"),
    ("injected", "TPR", "near", "Injected outliers found: 5 to 20 spacings off real points"),
    ("injected", "TNR", "all", "Real points kept beside injected outliers"),
    ("injected", "accuracy", "all", "Right labels with injected outliers"),
    ("injected", "average precision", "all", "Average precision with injected outliers"),
    ("injected", "time", "all", f"Processor time with injected outliers, {YARDSTICK} being 1"),
]


def tables(rows, methods):
    """Markdown: one table for each measure, with a line a cloud and a column a method."""
    lines = []
    for part, measure, subset, title in TABLES:
        chosen = [r for r in rows if (r.part, r.measure) == (part, measure)]
        values = {(r.cloud, r.method): r.value for r in chosen if r.subset == (subset or "all")}
        if not values:
            continue
        columns = [m for m in methods if any(m == method for _, method in values)]
        clouds = list(dict.fromkeys(cloud for cloud, _ in values))
        of_method = {m: [v for (_, method), v in values.items() if method == m] for m in columns}
        worst = max if measure in ("flagged", "time") else min
        values |= {("**median**", m): float(np.median(v)) for m, v in of_method.items()}
        values |= {("**worst**", m): worst(v) for m, v in of_method.items()}
        if subset is None:
            classes = [r for r in chosen if r.subset not in ("all", "surface")]
            values |= {(f"{r.cloud}: {r.subset}", r.method): r.value for r in classes}
            clouds = sorted({cloud for cloud, _ in values if "**" not in cloud})
        lines += [f"## {title}", "", "| | " + " | ".join(columns) + " |"]
        lines += ["|---|" + "---:|" * len(columns)]
        for cloud in [*clouds, "**median**", "**worst**"]:
            cells = [f"{values[cloud, m]:.2f}" if (cloud, m) in values else "" for m in columns]
            lines.append(f"| {cloud} | " + " | ".join(cells) + " |")
        lines.append("")
    return "\n".join(lines)


def write(path, text):
    """The file appears only when it is whole."""
    temporary = Path(f"{path}.tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)


def as_csv(rows):
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Row._fields)
    writer.writerows(row._replace(value=f"{row.value:.6g}") for row in rows)
    return text.getvalue()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--clouds", nargs="+", metavar="NAME", help="folders, or folder/file")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--limit", type=int, help="crop clouds to so many points, at least 1,000")
    parser.add_argument("--seed", type=int, default=0, help="of crops and injected outliers")
    parser.add_argument("--csv", help="file for all numbers")
    parser.add_argument("--table", help="Markdown file for the tables, instead of printing them")
    options = parser.parse_args()
    if options.limit is not None and options.limit < 1_000:
        parser.error(f"--limit is {options.limit}; take at least 1,000 points")
    places = np.random.default_rng(0).random((2_000, 3))
    warm_up = RealCloud("warm-up", places, None, None, True, places[:, 0])
    for name in options.methods:
        judgment(name, warm_up, 0.1)  # compiles, and imports, outside of what is timed
    rows = []
    for cloud in load_clouds(options.data, options.clouds, options.limit, options.seed):
        print(f"{cloud.name}, {len(cloud.points):,} points", file=sys.stderr, flush=True)
        rows += measured(cloud, options.methods, options.seed)
    if options.csv:
        write(options.csv, as_csv(rows))
    if options.table:
        write(options.table, tables(rows, options.methods))
    else:
        print(tables(rows, options.methods))


if __name__ == "__main__":
    main()
