"""What does each outlier detector take from, and find in, every real cloud?

Two parts for each cloud, in percent. "flagged" is of the cloud as it is: the real points that a
method flags, of all and by the publishers' classes. "found" and "precision" are of the cloud
without the noise that publishers label, with 10 % of outliers put in, whose truth is known: the
outliers found / the real points lost, and the average precision of the score. Peers marked "told"
know the share of outliers, where it is known, and take scikit-learn's default elsewhere.

    python benchmarks/bench_real.py --output docs/benchmarks
    python benchmarks/bench_real.py --clouds ign_village snow_spinning_lidar --limit 50000
    python benchmarks/bench_real.py --panel

The panel is of the default detector alone: what it finds and loses by class, with the sensor's
position where there is one, beside the stored figures of the last release, the worst changes
first. A change of a rule shows it in its commit. ``--panel --output docs/benchmarks`` stores it.

SOR is statistical outlier removal: a point goes whose mean distance to its k nearest others is
more than 2 standard deviations above the mean of all. Radius outlier removal takes points with
fewer than 5 others within 3 times the cloud's median spacing. ``_real_methods.py`` has the others
and their sources; what needs the sensor's position runs on clouds that were taken from their
origin. A new setting of the detector is one line in its `METHODS`.
"""

import argparse
from pathlib import Path

import numpy as np
from _panel import show_panel
from _real_clouds import evaluate, inject, load_clouds
from _real_methods import METHODS, judgment
from _tables import print_table, write_csv

SHOWN = ["isolated", "default", "surfaces", "SOR 8", "SOR 20", "SOR 50", "radius", "LOF, told"]
SHOWN += ["mean distance, told", "IsolationForest, told"]


def measured(cloud, methods, seed):
    """Yield the table, the row, the method, and one or two numbers, of a cloud."""
    real = np.ones(len(cloud.points), dtype=bool) if cloud.noise is None else ~cloud.noise
    clean = np.where(real, "real", "noise")
    points, kind = inject(cloud.points[real], np.random.default_rng(seed))
    injected = cloud._replace(points=points, classes=None)
    for name in methods:
        if result := judgment(name, cloud, (~real).mean() or None):
            for (measure, part), value in evaluate(*result, clean, cloud.classes).items():
                if measure == "flagged" and part != "surface":
                    title = cloud.name if part == "all" else f"{cloud.name}, {part}"
                    yield "flagged", title, name, (value,)
        if result := judgment(name, injected, (kind != "real").mean()):
            percent = evaluate(*result, kind)
            yield "found", cloud.name, name, (percent["TPR", "all"], percent["flagged", "all"])
            yield "precision", cloud.name, name, (percent["average precision", "all"],)


def tables(values, methods):
    """Name of each table and its rows, with the median and the worst cloud."""
    for table in ("flagged", "found", "precision"):
        of_table = {key[1:]: value for key, value in values.items() if key[0] == table}
        names = [method for method in methods if any(key[1] == method for key in of_table)]
        clouds = list(dict.fromkeys(cloud for cloud, _ in of_table))
        rows = [[cloud, *(cell(of_table.get((cloud, m))) for m in names)] for cloud in clouds]
        whole = [cloud for cloud in clouds if ", " not in cloud]
        worst = [max] if table == "flagged" else [min, max]
        for title, of in (("median", [np.median, np.median]), ("worst", worst)):
            row = [title]
            for m in names:
                columns = zip(*(of_table[c, m] for c in whole if (c, m) in of_table), strict=True)
                row.append(cell([f(c) for f, c in zip(of, columns, strict=False)]))
            rows.append(row)
        yield table, [["cloud", *names], *rows]


def cell(numbers):
    return " / ".join(f"{number:.2f}" for number in numbers) if numbers else ""


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--clouds", nargs="+", metavar="NAME", help="folders, or folder/file")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=SHOWN)
    parser.add_argument("--limit", type=int, help="crop clouds to so many points, at least 1,000")
    parser.add_argument("--seed", type=int, default=0, help="of crops and injected outliers")
    parser.add_argument("--output", type=Path, help="folder for the tables as CSV")
    parser.add_argument("--panel", action="store_true", help="of the default, beside the stored")
    options = parser.parse_args(arguments)
    clouds = load_clouds(options.data, options.clouds, options.limit, options.seed)
    if options.panel:
        return show_panel(clouds, options.seed, options.output)
    values = {}
    for cloud in clouds:
        print(f"{cloud.name}, {len(cloud.points):,} points", flush=True)
        for table, title, name, numbers in measured(cloud, options.methods, options.seed):
            values[table, title, name] = numbers
    for name, (head, *rows) in tables(values, options.methods):
        print_table(name, head, rows)
        if options.output:
            write_csv(options.output / f"real_{name}.csv", [head, *rows])


if __name__ == "__main__":
    main()
