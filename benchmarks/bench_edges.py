"""Which points belong to edges? What the default finds and what it labels beside, with the truth.

It takes less than a minute of processor time, so that a change of the detector is judged at once,
beside the stored figures. A row is the mean over its clouds and seeds. F1, and "beside", the share
of points of no edge that are labelled, have the standard error of that mean. Where there is no
edge, "beside" alone counts.

    python benchmarks/bench_edges.py
    python benchmarks/bench_edges.py street "dense roofs"  # rows that begin so
    python benchmarks/bench_edges.py --output docs/benchmarks

Machined parts have the true distance to the edge (`edge_dist`), roofs the plane of each point
(`plane`) or a wireframe. A point belongs to an edge if its true distance is two spacings at most.
"""

import argparse
import csv
import time
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from _real_clouds import spacing_of as wide_spacing
from _tables import print_table, texts, write_csv
from scipy.spatial import cKDTree
from simulators import make_roof, roof_edges

from sklearn_mcmd import SharpFeatureDetector
from sklearn_mcmd.datasets import make_street

STORED = Path(__file__).resolve().parents[1] / "docs" / "benchmarks" / "edges_panel.csv"
HEAD = ["cloud", "clouds", "P", "R", "F1", "its error", "beside", "error of it"]
BAND = 2  # spacings from an edge that belong to it
MOST = 15_000  # points of a cloud of a file
N_SEEDS = 3  # of rows that draw points or outliers


def spacing_of(X):
    """Side of the square that the median point takes, from its 8 neighbors."""
    distances, _ = cKDTree(X).query(X, k=9)
    return np.median(distances[:, -1]) * np.sqrt(np.pi / 8)


def from_planes(arrays):
    """Distances to the edge, which is half a spacing before the next point of another plane."""
    X, plane = arrays["xyz"], arrays["plane"]
    distance = np.full(len(X), np.nan)
    for number in range(1, plane.max() + 1):
        others = cKDTree(X[(plane > 0) & (plane != number)])
        distance[plane == number] = others.query(X[plane == number])[0]
    return distance - 0.5 * spacing_of(X)


def of_file(path, share=0.0, seed=0):
    """Points, of which a share is displaced, distance to the edge (NaN: outlier) and spacing."""
    rng = np.random.default_rng(seed)
    with np.load(path) as arrays:
        X = arrays["xyz"].astype(np.float64)
        distance = arrays["edge_dist"] if "edge_dist" in arrays else from_planes(arrays)
    if len(X) > MOST:
        rows = rng.permutation(len(X))[:MOST]
        X, distance = X[rows], distance[rows]
    spacing = spacing_of(X)
    n = round(len(X) * share / (1 - share))
    displaced = X[rng.permutation(len(X))[:n]] + rng.normal(0, 5 * spacing, (n, 3))
    return np.vstack([X, displaced]), np.r_[distance, np.full(n, np.nan)], spacing


def simulated_roofs():
    """The same of 36 roofs."""
    for kind, n, crease, noise in product(
        ("gable", "hip", "mansard"), (500, 2_000, 8_000), (30.0, 45.0), (0.1, 0.3)
    ):
        yield roof_edges(kind, n, crease, noise)


def rows(data):
    """Name -> function that yields points, distances to the edge (NaN: unknown), and spacing."""
    parts = {name: sorted(data.glob(f"cad_{name}*/cloud.npz")) for name in ("cube", "plate")}
    drawn = {
        f"{name}{', 20 % outliers' * (share > 0)}": partial(of_files, paths, share)
        for name, paths in parts.items()
        for share in (0.0, 0.2)
    }
    streets = {
        f"street, {100 * share:g} % outliers": partial(street, share) for share in (0.1, 0.2)
    }
    dense = data / "roofs_dense" / "roofs.npz"
    return {
        **drawn,
        **streets,
        "roofs' ridges": partial(of_files, sorted(data.glob("roof_planes/*.npz")), 0.0, 1),
        "simulated roofs": simulated_roofs,
        "dense roofs' wireframes": partial(wireframes, dense, True),
        "dense roofs without a crease": partial(wireframes, dense, False),
        "barrels": barrels,
        "foliage": partial(leaves, data),
    }


def of_files(paths, share, n_seeds=N_SEEDS):
    for seed, path in product(range(n_seeds), paths):
        yield of_file(path, share, seed)


def leaves(data):
    """A street's and a village's, of which none belongs to an edge; all else is unknown."""
    classes = {"mobile_street_labelled": ("label", 1300)}
    classes["village_hanging_things"] = ("classification", 5)
    for name, (field, number) in classes.items():
        if (data / name).is_dir():
            with np.load(data / name / "cloud.npz") as arrays:
                X, leaf = arrays["xyz"].astype(np.float64), arrays[field] == number
            yield X, np.where(leaf, np.inf, np.nan), spacing_of(X)


def street(share):
    for seed in range(N_SEEDS):
        cloud = make_street(20_000, outlier_share=share, random_state=seed)
        yield cloud.data, cloud.edge_distance, cloud.spacing


def barrels():
    """Smooth: a quarter of a cylinder's outline, of the simulated roofs' sizes and noises."""
    for n in (500, 2_000, 8_000):
        for noise in (0.1, 0.3):
            X, _ = make_roof("barrel", n, 45, noise)
            yield X, np.full(n, np.inf), wide_spacing(X)


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
            spacing, distance = wide_spacing(roof), from_lines(roof, creases)
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


def found_and_beside(distance, spacing, flagged):
    """Precision, recall and F1 of the known points, and the share of others that is labelled."""
    judged = ~np.isnan(distance)
    edge, flagged = distance[judged] <= BAND * spacing, flagged[judged]
    hits = np.count_nonzero(edge & flagged)
    beside = 100 * np.mean(flagged[~edge])
    if not edge.any():
        return [np.nan, np.nan, np.nan, beside]
    precision, recall = hits / max(flagged.sum(), 1), hits / edge.sum()
    return [100 * precision, 100 * recall, 200 * hits / (flagged.sum() + edge.sum()), beside]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", help="beginnings of their names; all by default")
    parser.add_argument("--data", type=Path, default="../shared/data", help="real clouds")
    parser.add_argument("--output", type=Path, help="folder for the table")
    options = parser.parse_args(arguments)
    if options.rows and options.output:
        parser.error("--output stores the whole table: name no rows")
    before, shown = {}, []
    if STORED.is_file():
        with open(STORED, newline="", encoding="utf-8") as file:
            before = {
                row[0]: [float(cell or "nan") for cell in row[1:]]
                for row in list(csv.reader(file))[1:]
            }
    for name, load in rows(options.data).items():
        if not name.startswith(tuple(options.rows or [""])):
            continue
        scores = []
        for X, distance, spacing in load():
            detector = SharpFeatureDetector(n_neighbors=40, random_state=0).fit(X)
            flagged = detector.scores_ < detector.offset_
            scores.append(found_and_beside(distance, spacing, flagged))
        if scores:
            mean = np.mean(scores, axis=0)
            error = np.std(scores, axis=0, ddof=1) / np.sqrt(len(scores))
            then = before.get(name, [np.nan] * (len(HEAD) - 1))
            row = [name, len(scores), *mean[:3], error[2], mean[3], error[3], then[3], then[5]]
            shown.append(row)
    print_table("in percent", [*HEAD, "F1 before", "beside before"], shown)
    print(f"{time.process_time():.0f} s of processor time")
    if options.output:
        stored = texts([row[: len(HEAD)] for row in shown], digits=1)
        stored = [["" if cell == "nan" else cell for cell in row] for row in stored]
        write_csv(options.output / STORED.name, [HEAD, *stored])


if __name__ == "__main__":
    main()
