"""What has moved? The level of detection of `CloudChange` beside M3C2's, where the truth is known.

"simulated": walls of 12 by 8 m that are scanned twice, with noise that is independent, or alike
nearby, a street with kerbs, a pipe and a slope. How many unmoved points are called moved at a level
of 5 %, and of those that moved by once and twice the level of detection? "halves": real clouds, cut
in two at random, as two scans of one place: the share of distances beyond 1.96 errors. "swaths":
two flights over one place. "bodies": two of nine walls moved by 5 mm, registered within 2 mm.
"speed": seconds, memory, and the distances that are told where nothing and where 20 mm moved.

M3C2 is py4dgeo's, with cylinders of 50 points. Distances to the nearest point (C2C) are Open3D's,
and CloudCompare's to a plane of 50 neighbors; they have no level. All run where they are installed
(``pip install py4dgeo open3d``, ``apt install cloudcompare``).

    python benchmarks/bench_change.py simulated --output docs/benchmarks
    python benchmarks/bench_change.py halves --data ../shared/data --output docs/benchmarks
    python benchmarks/bench_change.py swaths --data ../shared/data --output docs/benchmarks
    python benchmarks/bench_change.py bodies --output docs/benchmarks
    python benchmarks/bench_change.py speed --points 1_000_000 --output docs/benchmarks
"""

import argparse
import logging
import multiprocessing
import os
import resource
import shutil
import subprocess
import tempfile
import time
import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from _halls import hall, registered, walls_of
from _plane_verdicts import smooth, strips
from _real_clouds import load_clouds
from _tables import print_table, texts, write_csv
from scipy.stats.qmc import MultivariateNormalQMC

from sklearn_mcmd import CloudChange
from sklearn_mcmd.change import moved_bodies

SIZE, NOISE = np.array([12.0, 8.0]), 0.004  # meters
REGISTRATION = 0.003
TURNS = np.radians(0.01)
MOTION = np.diag([REGISTRATION**2] * 3 + [TURNS**2] * 3)
COMMON = {
    "white": lambda rng, xz: 0.0,
    "smooth, 1 mm over 0.3 m": lambda rng, xz: 0.001 * smooth(rng, xz, 0.3),
    "smooth, 1 mm over 1 m": lambda rng, xz: 0.001 * smooth(rng, xz, 1.0),
    "140 rows, 1 mm": lambda rng, xz: strips(rng, xz[:, 1], 140),
    "30 columns, 1 mm": lambda rng, xz: strips(rng, xz[:, 0], 30),
}

SWATHS = {
    "ign_village/St_Barth_RGAF09_UTM20N_IGN_1988_SB_subset_100m.laz": (4320, 4330),
    "ahn3_amsterdam_2397/ahn_2397_9705.laz": (56027, 56028),
    "village_hanging_things/cloud.npz": (706, 707),
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


def slope(rng, n, common, moved=0.0):
    """A slope of 35 degrees with waves of .3 m, from a scanner somewhere at its foot: the density
    falls by the squared range."""
    xy = rng.uniform(0, 1, (8 * n, 2)) * SIZE
    z = 0.7 * xy[:, 1] + 0.3 * np.sin(1.5 * xy[:, 0]) * np.cos(1.2 * xy[:, 1])
    xyz = np.column_stack([xy, z])
    ranges = np.square(xyz - [rng.uniform(2, 10), -5, 1.5]).sum(axis=1)
    kept = rng.choice(len(xyz), n, replace=False, p=(1 / ranges) / (1 / ranges).sum())
    return xyz[kept] + rng.normal(0, NOISE, (n, 3))


def turned(xyz, motion):
    """A cloud whose registration is off by shifts, and turns about its mean."""
    shift, turn = motion[:3], motion[3:]
    return xyz + shift + np.cross(turn, xyz - xyz.mean(axis=0))


def ours(before, after, registration=None):
    """Distances and levels of detection of single points."""
    change = CloudChange(registration=registration, correction="none", random_state=0, n_jobs=-1)
    changes = change.fit(before).compare(after)
    return changes.distance, changes.level_of_detection


def m3c2(before, after, registration=None):
    """Distances and levels by py4dgeo; its cylinders hold 50 points, its normals are of as many."""
    import py4dgeo
    from scipy.spatial import cKDTree

    logging.disable(logging.INFO)
    if np.ndim(registration):  # it takes a number
        registration = REGISTRATION
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


def open3d_c2c(before, after, registration=None):
    """Distances to the nearest point, without level."""
    import open3d

    clouds = [open3d.geometry.PointCloud(open3d.utility.Vector3dVector(a)) for a in (before, after)]
    return np.asarray(clouds[0].compute_point_cloud_distance(clouds[1])), None


def cloudcompare_c2c(before, after, registration=None):
    """Distances to a plane of the 50 neighbors of the nearest point, without level."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [f"{folder}/{name}.asc" for name in ("before", "after")]
        for path, xyz in zip(paths, (before, after), strict=True):
            np.savetxt(path, xyz, fmt="%.6f")
        command = ["CloudCompare", "-SILENT", "-AUTO_SAVE", "OFF", "-C_EXPORT_FMT", "ASC"]
        command += ["-PREC", "9", "-O", paths[0], "-O", paths[1]]
        command += ["-C2C_DIST", "-MODEL", "LS", "KNN", "50", "-SAVE_CLOUDS", "FILE"]
        command += [f"{folder}/out.asc {folder}/other.asc"]
        environment = os.environ | {"QT_QPA_PLATFORM": "offscreen"}
        subprocess.run(command, check=True, capture_output=True, env=environment)
        return np.loadtxt(f"{folder}/out.asc", usecols=3), None


def methods(with_level=True):
    found = {"ours": ours}
    if find_spec("py4dgeo"):
        found["M3C2"] = m3c2
    if not with_level and find_spec("open3d"):
        found["C2C, Open3D"] = open3d_c2c
    if not with_level and shutil.which("CloudCompare"):
        found["C2C to planes, CloudCompare"] = cloudcompare_c2c
    return found


def called(distance, level):
    told = np.isfinite(distance) & np.isfinite(level)
    return float(np.mean(np.abs(distance[told]) > level[told]))


def simulated(options):
    rows = []
    white = COMMON["white"]
    # Two functions that make a cloud, noise of both, and what is told of the registration.
    scenes = {name: (wall, wall, common, None) for name, common in COMMON.items()}
    for name, told in (("off by 3 mm", REGISTRATION), ("and .01 degrees off", MOTION)):
        scenes[f"registration {name}, given"] = (wall, wall, white, told)
    scenes["within 5 spacings of edges"] = (kerb, kerb, white, None)
    scenes["a pipe, the second scan half as dense"] = (
        pipe,
        lambda rng, n, common: pipe(rng, n // 2, common),
        white,
        None,
    )
    scenes["a slope from two places"] = (slope, slope, white, None)
    for name, (first, second, common, told) in scenes.items():
        row = [f"called moved: {name}"]
        n_pairs = options.repetitions if told is None else 6 * options.repetitions
        # Evenly drawn, as a movement of all points is but one draw of each cloud.
        motions = MultivariateNormalQMC(np.zeros(6), np.asarray(MOTION), rng=0).random(n_pairs)
        motions[:, 3:] *= np.ndim(told) > 0
        for method in methods().values():
            shares = []
            for i in range(n_pairs):
                rng, n = np.random.default_rng(i), options.points
                before, after = first(rng, n, common), second(rng, n, common)
                if told is not None:
                    after = turned(after, motions[i])
                shares.append(called(*method(before, after, told)))
            row += [float(np.mean(shares)), float(np.std(shares) / np.sqrt(n_pairs))]
        rows.append(row)
    for times in (1, 2):
        row = [f"found at {times} level of detection"]
        for method in methods().values():
            shares = []
            for i in range(options.repetitions):
                rng = np.random.default_rng(i)
                before, after = (wall(rng, options.points, white) for _ in range(2))
                level = np.nanmedian(method(before, after)[1])
                after = wall(rng, options.points, white, times * level)
                distance, levels = method(before, after)
                moved = before[:, 0] > SIZE[0] / 2 + 0.5
                shares.append(called(distance[moved], levels[moved]))
            row += [float(np.mean(shares)), float(np.std(shares) / np.sqrt(len(shares)))]
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


def swaths(options):
    """Two flights over one place, registered by their surveyors; "auto" for ours, too."""
    rows = []
    for name, lines in SWATHS.items():
        xyz, line = flights(options.data / name)
        clouds = [np.unique(xyz[line == one], axis=0) for one in lines]
        row = [f"{name.split('/')[0]}, {lines[0]} and {lines[1]}"]
        for method in methods().values():
            row.append(called(*method(*clouds)))
        rows.append([*row, called(*ours(*clouds, "auto"))])
    return [["", *methods(), "ours, registration auto"], *rows]


def flights(path):
    """Points of a file, and the flight line of each."""
    if path.suffix == ".npz":
        with np.load(path) as stored:
            return stored["xyz"], stored["point_source_id"]
    import laspy

    read = laspy.read(path)
    return np.asarray(read.xyz) - read.header.mins, np.asarray(read.point_source_id)


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
    rows = []
    for name in methods(with_level=False):
        # A process of its own, whose peak is that of one method.
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            rows.append([name, *pool.apply(timed, (name, options.points))])
    head = ["", "seconds", "memory, bytes a point", "told where nothing moved, mm", "20 mm moved"]
    return [head, *rows]


def timed(name, n):
    """Seconds, bytes for each point of both clouds, and medians of distances in millimeters."""
    warnings.simplefilter("ignore")
    method, rng = methods(with_level=False)[name], np.random.default_rng(0)
    before, after = (wall(rng, n, COMMON["white"], moved) for moved in (0.0, 0.02))
    method(before[:2_000], after[:2_000])  # compiles
    first, begin = peak(), time.perf_counter()
    distance = np.abs(method(before, after)[0])
    seconds, memory = time.perf_counter() - begin, (peak() - first) / (2 * n)
    memory = np.nan if method is cloudcompare_c2c else memory  # of a process of its own
    parts = before[:, 0] < SIZE[0] / 2 - 0.5, before[:, 0] > SIZE[0] / 2 + 0.5
    return seconds, memory, *(1000 * float(np.nanmedian(distance[part])) for part in parts)


def peak():
    """Bytes that this process has had at most."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kind", choices=["simulated", "halves", "swaths", "bodies", "speed"])
    parser.add_argument("--points", type=int, default=20_000)
    parser.add_argument("--repetitions", type=int, default=10)
    parser.add_argument("--data", type=Path, default="../shared/data", help="folder of real clouds")
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
