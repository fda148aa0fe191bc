"""The panel of edges: what the default detector finds, and what it labels where no edge is.

It takes less than a minute of processor time, so that a change of the detector is judged at once.
A row is the mean over its clouds and seeds; F1 and "beside", the share of points of no edge that
are labelled, have the standard error of that mean. Where there is no edge, "beside" alone counts.
"""

import csv
import time
from argparse import Namespace
from functools import partial
from pathlib import Path

import numpy as np
from _ablation_clouds import spacing_of
from _tables import print_table, texts, write_csv
from simulators import make_roof

from sklearn_mcmd import SharpFeatureDetector

STORED = Path(__file__).resolve().parents[1] / "docs" / "benchmarks" / "edges_panel.csv"
HEAD = ["cloud", "clouds", "P", "R", "F1", "its error", "beside", "error of it"]
BAND = 2  # spacings from an edge that belong to it
MOST = 15_000  # points of a machined part
N_SEEDS = 3  # of rows that draw points or outliers


def rows(clouds, data):
    """Name -> function that yields points, distances to the edge (NaN: unknown), and spacing."""
    parts = {name: sorted(data.glob(f"cad_{name}*/cloud.npz")) for name in ("cube", "plate")}
    drawn = {
        f"{name}{', 20 % outliers' * (share > 0)}": partial(given, clouds, share, paths)
        for name, paths in parts.items()
        for share in (0.0, 0.2)
    }
    streets = {
        f"street, {100 * share:g} % outliers": partial(street, clouds, share)
        for share in (0.1, 0.2)
    }
    ridges = sorted(data.glob("roof_planes/*.npz"))
    dense = data / "roofs_dense" / "roofs.npz"
    return {
        **drawn,
        **streets,
        "roofs' ridges": partial(given, clouds, 0.0, ridges, n_seeds=1),
        "simulated roofs": partial(given, clouds, 0.0, [], roofs=[30.0, 45.0], n_seeds=1),
        "dense roofs' wireframes": partial(wireframes, dense, True),
        "dense roofs without a crease": partial(wireframes, dense, False),
        "barrels": barrels,
    }


def given(clouds, share, paths, roofs=(), n_seeds=N_SEEDS):
    """Clouds of `bench_edges.py`: of files, or simulated roofs."""
    if not paths and not roofs:
        return
    for seed in range(n_seeds):
        options = Namespace(clouds=paths, roofs=roofs, most=MOST)
        yield from (cloud[1:] for cloud in clouds(options, share, seed))


def street(clouds, share):
    for seed in range(N_SEEDS):
        yield list(clouds(Namespace(clouds=[], roofs=[], street=20_000), share, seed))[-1][1:]


def barrels():
    """Smooth: a quarter of a cylinder's outline, of the simulated roofs' sizes and noises."""
    for n in (500, 2_000, 8_000):
        for noise in (0.1, 0.3):
            X, _ = make_roof("barrel", n, 45, noise)
            yield X, np.full(n, np.inf), spacing_of(X)


def wireframes(path, with_creases):
    """Dense roofs, by lines that were drawn by hand where two faces meet, if they have any.

    What is near eaves and walls alone is unknown: a wall below may have been seen or not.
    """
    if not path.is_file():
        return
    with np.load(path) as arrays:
        X, building, lines = (arrays[name] for name in ("xyz", "building", "segments"))
        of_line, faces = arrays["segment_building"], arrays["segment_faces"]
    for number in np.unique(building):
        roof, mine = X[building == number], of_line == number
        creases = lines[mine & (faces == 2)]
        if (len(creases) > 0) == with_creases:
            spacing, distance = spacing_of(roof), from_lines(roof, creases)
            rim = from_lines(roof, lines[mine & (faces < 2)]) <= BAND * spacing
            yield roof, np.where(rim & (distance > BAND * spacing), np.nan, distance), spacing


def from_lines(X, lines):
    """Distance of each point to the nearest of the lines (m, 6), infinite without lines."""
    nearest = np.full(len(X), np.inf)
    for begin, end in zip(lines[:, :3], lines[:, 3:], strict=True):
        way = end - begin
        along = np.clip((X - begin) @ way / (way @ way), 0, 1)
        np.minimum(nearest, np.linalg.norm(X - begin - along[:, None] * way, axis=1), out=nearest)
    return nearest


def found_and_beside(distance, spacing, found):
    """Precision, recall and F1 of the known points, and the share of others that is labelled."""
    known = ~np.isnan(distance)
    edge, found = distance[known] <= BAND * spacing, found[known]
    hits = np.count_nonzero(edge & found)
    beside = 100 * np.mean(found[~edge])
    if not edge.any():
        return [np.nan, np.nan, np.nan, beside]
    precision, recall = hits / max(found.sum(), 1), hits / edge.sum()
    return [100 * precision, 100 * recall, 200 * hits / (found.sum() + edge.sum()), beside]


def show_panel(clouds, data, names, output):
    """Print the rows whose names begin with one of `names`; store all if `output` is a folder."""
    before, shown = {}, []
    if STORED.is_file():
        with open(STORED, newline="", encoding="utf-8") as file:
            before = {
                row[0]: [float(cell or "nan") for cell in row[1:]]
                for row in list(csv.reader(file))[1:]
            }
    for name, load in rows(clouds, Path(data)).items():
        if not any(name.startswith(begin) for begin in names or [""]):
            continue
        scores = []
        for X, distance, spacing in load():
            detector = SharpFeatureDetector(n_neighbors=40, random_state=0).fit(X)
            found = detector.scores_ < detector.offset_
            scores.append(found_and_beside(distance, spacing, found))
        if scores:
            mean = np.mean(scores, axis=0)
            error = np.std(scores, axis=0, ddof=1) / np.sqrt(len(scores))
            then = before.get(name, [np.nan] * (len(HEAD) - 1))
            row = [name, len(scores), *mean[:3], error[2], mean[3], error[3], then[3], then[5]]
            shown.append(row)
    head = [*HEAD, "F1 before", "beside before"]
    print_table("in percent", head, shown)
    print(f"{time.process_time():.0f} s of processor time")
    if output:
        stored = texts([row[: len(HEAD)] for row in shown], digits=1)
        stored = [["" if cell == "nan" else cell for cell in row] for row in stored]
        write_csv(Path(output) / STORED.name, [HEAD, *stored])
