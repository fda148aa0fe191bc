"""What has moved? The level of detection of `CloudChange` beside M3C2's, where the truth is known.

"simulated": walls of 12 by 8 m that are scanned twice, with noise that is independent, or alike
nearby, and a street with kerbs. How many unmoved points are called moved at a level of 5 %, and of
those that moved by once and twice the level of detection? "halves": real clouds, cut in two at
random, as two scans of one place: the share of distances beyond 1.96 errors. "bodies": two of nine
walls moved by 5 mm, registered within 2 mm. "speed": seconds and memory of both.

M3C2 is py4dgeo's, where it is installed (``pip install py4dgeo``), with cylinders of 50 points.

    python benchmarks/bench_change.py simulated --output docs/benchmarks
    python benchmarks/bench_change.py halves --data ../shared/data --output docs/benchmarks
    python benchmarks/bench_change.py bodies
    python benchmarks/bench_change.py speed --points 1_000_000
"""

import argparse
import logging
import time
import warnings
from pathlib import Path

import numpy as np
from _halls import hall, registered, walls_of
from _plane_verdicts import smooth, strips
from _real_clouds import load_clouds
from _tables import print_table, texts, write_csv

from sklearn_mcmd import CloudChange
from sklearn_mcmd.change import moved_bodies

SIZE, NOISE = np.array([12.0, 8.0]), 0.004  # meters
REGISTRATION = 0.003
COMMON = {
    "white": lambda rng, xz: 0.0,
    "smooth, 1 mm over 0.3 m": lambda rng, xz: 0.001 * smooth(rng, xz, 0.3),
    "smooth, 1 mm over 1 m": lambda rng, xz: 0.001 * smooth(rng, xz, 1.0),
    "140 rows, 1 mm": lambda rng, xz: strips(rng, xz[:, 1], 140),
    "30 columns, 1 mm": lambda rng, xz: strips(rng, xz[:, 0], 30),
    "registration off by 3 mm, given": lambda rng, xz: rng.normal(0, REGISTRATION),
}


def wall(rng, n, common, moved=0.0):
    xz = rng.uniform(0, 1, (n, 2)) * SIZE
    y = 0.03 * np.sin(xz[:, 0]) + rng.normal(0, NOISE, n) + common(rng, xz)
    return np.column_stack([xz[:, 0], y + moved * (xz[:, 0] > SIZE[0] / 2), xz[:, 1]])


def kerb(rng, n, common, moved=0.0):
    """A road, a kerb of 15 cm and a facade, whose edges are 5 spacings away at most."""
    part = rng.integers(0, 3, n)
    xyz = rng.uniform(0, 1, (n, 3)) * [12, 0.6, 1]
    xyz[part == 0, 2] = 0
    xyz[part == 1, 1:] += [0.6, 0]
    xyz[part == 1, 2] = 0.15
    xyz[part == 2, 1] = 1.2
    xyz[part == 2, 2] += 0.15
    return xyz + rng.normal(0, NOISE, xyz.shape)


def pipe(rng, n, common, moved=0.0):
    """A pipe of 2 m that is 6 m long."""
    turn, radius = rng.uniform(0, 2 * np.pi, n), 1 + rng.normal(0, NOISE, n)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), rng.uniform(0, 6, n)])


def ours(before, after, registration=None):
    """Distances and levels of detection of single points."""
    change = CloudChange(registration=registration, correction="none", random_state=0, n_jobs=-1)
    changes = change.fit(before).compare(after)
    return changes.distance, changes.level_of_detection


def m3c2(before, after, registration=None):
    """The same by py4dgeo, whose cylinders hold 50 points and whose normals are of as many."""
    import py4dgeo
    from scipy.spatial import cKDTree

    logging.disable(logging.INFO)
    radius = float(np.median(cKDTree(before).query(before[::50], 50)[0][:, -1]))
    method = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(before), py4dgeo.Epoch(after)),
        corepoints=before,
        normal_radii=(radius,),
        cyl_radius=radius,
        max_distance=10 * radius,
        registration_error=registration or 0.0,
    )
    distance, told = method.run()
    return distance, told["lodetection"]


def methods():
    try:
        import py4dgeo  # noqa: F401
    except ImportError:
        print("py4dgeo is not installed: M3C2 is left out")
        return {"ours": ours}
    return {"ours": ours, "M3C2": m3c2}


def called(distance, level):
    told = np.isfinite(distance) & np.isfinite(level)
    return float(np.mean(np.abs(distance[told]) > level[told]))


def simulated(options):
    rows = []
    scenes = {name: (wall, common) for name, common in COMMON.items()}
    scenes["within 5 spacings of edges"] = (kerb, COMMON["white"])
    scenes["a pipe, the second scan half as dense"] = (pipe, COMMON["white"])
    for name, (make, common) in scenes.items():
        registration = REGISTRATION if "given" in name else None
        row = [f"called moved: {name}"]
        n_pairs = 5 * options.repetitions if registration else options.repetitions
        for method in methods().values():
            shares = []
            for i in range(n_pairs):
                rng, n = np.random.default_rng(i), options.points
                before, after = make(rng, n, COMMON["white"]), make(rng, n, common)
                if make is pipe:
                    after = after[: n // 2]
                if name in COMMON and not registration:
                    before = make(rng, n, common)
                shares.append(called(*method(before, after, registration)))
            row += [float(np.mean(shares)), float(np.std(shares) / np.sqrt(n_pairs))]
        rows.append(row)
    rng = np.random.default_rng(0)
    before = wall(rng, options.points, COMMON["white"])
    for times in (1, 2):
        row = [f"found at {times} level of detection"]
        for method in methods().values():
            level = np.nanmedian(method(before, wall(rng, options.points, COMMON["white"]))[1])
            after = wall(rng, options.points, COMMON["white"], times * level)
            distance, levels = method(before, after)
            moved = before[:, 0] > SIZE[0] / 2 + 0.5
            row += [called(distance[moved], levels[moved]), np.nan]
        rows.append(row)
    return [["", *(f"{name}{end}" for name in methods() for end in ("", " ±"))], *rows]


def halves(options):
    rows = []
    for cloud in load_clouds(options.data, limit=30_000):
        X = cloud.points if cloud.noise is None else cloud.points[~cloud.noise]
        X = X[X.any(axis=1)].astype(np.float64)
        if len(X) < 5_000 or "ntnu" in cloud.name:  # roofs that lie over one another
            continue
        first, row = np.random.default_rng(0).random(len(X)) < 0.5, [cloud.name]
        for method in methods().values():
            distance, level = method(X[first], X[~first])
            row += [float(np.isfinite(level).mean()), called(distance, level)]
        rows.append(row)
    return [["", *(f"{n}{end}" for n in methods() for end in (": compared", ": beyond"))], *rows]


def bodies(options):
    named, false = [], []
    for i in range(options.repetitions):
        rng = np.random.default_rng(i)
        # Of three walls that face one way one moves: if two move together, the third does, too.
        moved = 3 * rng.choice(3, 2, replace=False) + rng.choice(3, 2)
        before, walls = hall(rng)
        after, _ = registered(hall(rng, moved, 0.005 * rng.choice([-1, 1]))[0], rng)
        told = moved_bodies(before, after, random_state=0)
        is_moved = np.isin(walls_of(told, before, walls), moved)
        named += list(told.moved[is_moved])
        false += list(told.moved[~is_moved])
    return [["", "share"], ["walls that moved, named", np.mean(named)], ["false", np.mean(false)]]


def speed(options):
    rng = np.random.default_rng(0)
    before, after = (wall(rng, options.points, COMMON["white"]) for _ in range(2))
    rows = [["", "seconds"]]
    for name, method in methods().items():
        method(before[:2_000], after[:2_000])  # compiles
        begin = time.perf_counter()
        method(before, after)
        rows.append([name, time.perf_counter() - begin])
    return rows


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=["simulated", "halves", "bodies", "speed"])
    parser.add_argument("--points", type=int, default=20_000)
    parser.add_argument("--repetitions", type=int, default=10)
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--output", type=Path, help="folder for the table")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    head, *rows = globals()[options.kind](options)
    print_table(options.kind, head, rows, digits=3)
    if options.output:
        rows = [[cell.replace("nan", "") for cell in row] for row in texts(rows, 3)]
        write_csv(options.output / f"change_{options.kind}.csv", [head, *rows])


if __name__ == "__main__":
    main()
