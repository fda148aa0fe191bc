"""The panel of real clouds: what the default detector finds and loses, beside the last release.

Clouds are taken as they are. Where publishers name no outliers, those of `inject` are found in a
second run. Clouds that were taken from their origin are judged by coordinates, with the position,
and with the intensity as well, if they have one.
"""

import csv
from pathlib import Path

import numpy as np
from _real_clouds import inject
from _tables import print_table, write_csv

from sklearn_mcmd import MCMDOutlierDetector

STORED = Path(__file__).resolve().parents[1] / "docs" / "benchmarks" / "panel.csv"
HEAD = ["cloud", "told", "side", "class", "points", "percent"]
FEWEST = 10  # points of a class that has a line


def forms(cloud):
    """What the detector is told, in words and as arguments of `fit`."""
    yield "coordinates", {}
    if cloud.from_origin:
        yield "position", {"sensor_origin": (0.0, 0.0, 0.0)}
        if cloud.intensity is not None:
            yield "intensity", {"sensor_origin": (0.0, 0.0, 0.0), "intensity": cloud.intensity}


def panel(clouds, seed):
    """Yield the rows of the panel, as `HEAD` names them."""
    for cloud in clouds:
        print(f"{cloud.name}, {len(cloud.points):,} points", flush=True)
        outlier = cloud.noise
        classes = np.full(len(cloud.points), "all") if cloud.classes is None else cloud.classes
        yield from judged(cloud, classes, outlier)
        if outlier is None:
            points, kind = inject(cloud.points, np.random.default_rng(seed))
            injected, outlier = cloud._replace(points=points, intensity=None), kind != "real"
            yield from judged(injected, np.where(outlier, kind, "among errors"), outlier)


def judged(cloud, classes, outlier):
    outlier = np.zeros(len(classes), bool) if outlier is None else outlier
    for told, of_sensor in forms(cloud):
        detector = MCMDOutlierDetector(random_state=0, n_jobs=2)
        flagged = detector.fit_predict(cloud.points, **of_sensor) == -1
        for side, of_side in (("lost", ~outlier), ("found", outlier)):
            names = np.unique(classes[of_side]).tolist()
            for name in names if len(names) == 1 else [*names, "all"]:
                rows = flagged[of_side & ((classes == name) | (name == "all"))]
                if len(rows) >= FEWEST:
                    percent = round(100 * float(rows.mean()), 3)
                    yield [cloud.name, told, side, name, len(rows), percent]


def show_panel(clouds, seed, output):
    """Print the panel, the worst changes first, and store it if `output` is a folder."""
    rows, before = [], {}
    if STORED.is_file():
        with open(STORED, newline="", encoding="utf-8") as file:
            before = {tuple(row[:5]): float(row[5]) for row in list(csv.reader(file))[1:]}
    for row in panel(clouds, seed):
        then = before.get(tuple(map(str, row[:5])), np.nan)
        rows.append([*row, then, (row[5] - then) * (1 if row[2] == "lost" else -1)])
    rows.sort(key=lambda row: -np.nan_to_num(row[-1], nan=np.inf))  # what is new comes first
    print_table("in percent", [*HEAD, "before", "worse by"], rows, digits=2)
    if output:
        rows.sort(key=lambda row: row[:4])
        write_csv(output / STORED.name, [HEAD, *([*row[:5], f"{row[5]:.3f}"] for row in rows)])
