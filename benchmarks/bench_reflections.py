"""Reflections in a shop window: how many are found, what is lost, and where the pane is.

    python benchmarks/bench_reflections.py
    python benchmarks/bench_reflections.py --real ../shared/data
    python benchmarks/bench_reflections.py --constants ../shared/data

The first prints the table of docs/sensor.rst. The second asks real clouds, in which nobody has
seen a reflection, for mirrors and times. The third scales each constant.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import _glass, make_street
from sklearn_mcmd.datasets._road import PATH_Z
from sklearn_mcmd.outliers import _cloud, _reflections

PANE_Y = 4.6  # of the simulated street, whose pane faces -y
MIDDLE = np.array([1.125, PANE_Y, 1.375])
FACTORS = (0.5, 0.8, 1.25, 2.0)
OFF = np.array([0.03, -0.03, 0.026])  # a position that is wrong by 5 cm


def glazed(share=0.03, kinds=("reflection",), n_samples=20_000, **parameters):
    settings = {"tree": True, "sampling": "scan_lines", **parameters}
    return make_street(
        n_samples, glass=True, outlier_share=share, outlier_kinds=list(kinds), **settings
    )


def masks(street):
    """Reflections, points of the room, and other regular points."""
    names = np.array([*street.surface_names, ""])
    in_room = np.char.startswith(names[street.surface], "room")
    reflected = street.outlier_kind == street.outlier_kind_names.index("reflection")
    return reflected, in_room, (street.target == 1) & ~in_room


def judged(X, position, **parameters):
    detector = MCMDOutlierDetector(random_state=0, **parameters)
    start = time.process_time()
    detector.fit(X, sensor_origin=position)
    return detector, time.process_time() - start


def bent(street, sagitta):
    """The street's points where the pane is a part of a cylinder, this much deeper at its sides."""
    X, reflected = street.data.copy(), masks(street)[0]
    q, sensor = X[reflected], street.scanners[0]
    place = sensor + ((PANE_Y - sensor[1]) / (q[:, 1] - sensor[1]))[:, None] * (q - sensor)
    width = 1.75
    angle = 2 * (place[:, 0] - MIDDLE[0]) * 8 * sagitta / width**2
    away = q - place
    X[reflected, 0] = place[:, 0] + np.cos(angle) * away[:, 0] - np.sin(angle) * away[:, 1]
    X[reflected, 1] = place[:, 1] + np.sin(angle) * away[:, 0] + np.cos(angle) * away[:, 1]
    return X


def without_oblique(street):
    """Rows without the mirror images of sign, post and tree."""
    image = street.data - 2 * (street.data[:, 1:2] - PANE_Y) * [0, 1, 0]
    telling = (image[:, 2] > 0.2) & (image[:, 1] < 4.4)
    return ~(masks(street)[0] & telling)


def line(name, street, X, rows, position):
    """One line of the table."""
    plain, seconds = judged(X[rows], position)
    detector, longer = judged(X[rows], position, reflections=True)
    mirrored = detector.mirror_index_ >= 0
    reflected, room, regular = (mask[rows] for mask in masks(street))
    share = 100 * mirrored[reflected].mean() if reflected.any() else np.nan
    before = 100 * (plain.scores_ < -3)[reflected].mean() if reflected.any() else np.nan
    cells = [f"{before:5.1f}", f"{share:5.1f}", f"{100 * (~mirrored[room]).mean():6.2f}"]
    cells += [f"{100 * mirrored[regular].mean():5.2f}"]
    planes = []
    for normal, offset, n, evidence in zip(*detector.mirrors_, strict=True):
        tilt = np.degrees(np.arccos(min(1.0, abs(normal[1]))))
        planes.append(f"{1000 * abs(MIDDLE @ normal - offset):.1f} mm {tilt:.2f} deg")
        planes[-1] += f" ({n} points, evidence {evidence:.0f})"
    print(
        f"{name:34}", *cells, f"x {longer / seconds:.2f}", "; ".join(planes) or "none", flush=True
    )


def table():
    print(
        "scene: found without, found with reflections=True, room kept, regular lost; time; planes"
    )
    for noise in (0.002, 0.005, 0.01):
        for seed in range(3):
            street = glazed(noise=noise, random_state=seed)
            rows = np.ones(len(street.data), dtype=bool)
            name = f"noise {1000 * noise:g} mm, seed {seed}"
            line(name, street, street.data, rows, street.scanners[0])
            if noise == 0.005:
                line(f"{name}, 5 cm off", street, street.data, rows, street.scanners[0] + OFF)
    street = glazed(0.05, n_samples=60_000, random_state=0)
    rows = np.ones(len(street.data), dtype=bool)
    line("60,000 points", street, street.data, rows, street.scanners[0])
    kinds = ("reflection", "gaussian", "uniform", "mixed_pixel", "ghost")
    for share in (0.1, 0.2):
        street = glazed(share, kinds, n_samples=60_000, random_state=0)
        rows = np.ones(len(street.data), dtype=bool)
        line(
            f"60,000 points, {share:.0%} of 5 kinds", street, street.data, rows, street.scanners[0]
        )
    street = glazed(n_samples=60_000, spacing=0.035, random_state=0)
    rows = np.ones(len(street.data), dtype=bool)
    bay = (street.data[:, 0] * len(street.scanners) / street.length).astype(int)
    positions = street.scanners[np.clip(bay, 0, len(street.scanners) - 1)]
    line(f"60,000 points, {len(street.scanners)} bays", street, street.data, rows, positions)
    print("what fails")
    street = glazed(random_state=0)
    rows = np.ones(len(street.data), dtype=bool)
    for sagitta in (0.003, 0.01, 0.03):
        X = bent(street, sagitta)
        line(f"pane bent by {1000 * sagitta:g} mm", street, X, rows, street.scanners[0])
    line("no sign, post, tree in the pane", street, street.data, without_oblique(street),
         street.scanners[0])  # fmt: skip
    for share in (0.01, 0.003):
        few = glazed(share, random_state=0)
        rows = np.ones(len(few.data), dtype=bool)
        line(f"{share:.1%} of reflections", few, few.data, rows, few.scanners[0])
    level, _glass._ROOM = _glass._ROOM, _glass._ROOM._replace(z0=PATH_Z)
    street = glazed(random_state=0)
    _glass._ROOM = level
    rows = np.ones(len(street.data), dtype=bool)
    line("floor of the room level with the path", street, street.data, rows, street.scanners[0])
    print("nothing to find")
    for name, street in (
        ("clear pane", glazed(0.0, random_state=0)),
        ("no pane", make_street(20_000, tree=True, sampling="scan_lines", random_state=0)),
    ):
        rows = np.ones(len(street.data), dtype=bool)
        detector, _ = judged(street.data, street.scanners[0], reflections=True)
        print(f"{name:34}", len(detector.mirrors_.offsets), "mirrors")


def real_clouds(data):
    """Name, points and a position for the sensor: known of the first four, a guess of the rest."""
    for path in sorted((data / "snow_spinning_lidar").glob("*.npz"))[:1]:
        with np.load(path) as arrays:
            yield path.stem, arrays["xyz"].astype(np.float64), "origin"
    names = (
        *("fast_gicp_velodyne", "pcl_office1", "ahn3_amsterdam_2397", "ign_village"),
        *("open3d_redwood_fragment", "pcl_building_region_growing", "jakarto_scanlines"),
        *("pcl_cars_mincut", "pcl_lamppost"),
    )
    for name in names:
        path = data / name / "cloud.npz"
        if path.is_file():
            with np.load(path) as arrays:
                X = arrays["xyz"].astype(np.float64)
            X = X[np.isfinite(X).all(axis=1)]
            height = {"ahn3_amsterdam_2397": 500, "ign_village": 500}.get(name, 2)
            known = name.startswith(("fast", "pcl_office", "pcl_building"))
            yield (
                name,
                X,
                "origin" if known else [*np.median(X[:, :2], axis=0), X[:, 2].min() + height],
            )


def ask_real(data):
    judged(np.random.default_rng(0).random((3000, 3)), [0.5, 0.5, 9.0])  # compiles
    for name, X, position in real_clouds(data):
        _, seconds = judged(X, position)
        detector, longer = judged(X, position, reflections=True)
        print(f"{name:28} {len(X):7,} points, mirrors {len(detector.mirrors_.offsets)}, "
              f"x {longer / seconds:.2f}", flush=True)  # fmt: skip


def seen_of(X, position):
    """What `find_mirrors` is asked with, and the rows of the points."""
    asked = []

    def keep(*arguments):
        asked.append(arguments)
        return find(*arguments)

    find, _cloud.find_mirrors = _cloud.find_mirrors, keep
    try:
        detector, _ = judged(X, position, reflections=True)
    finally:
        _cloud.find_mirrors = find
    return asked[0][:2], detector._model.index.rows


def scale_constants(data):
    streets = []
    for seed, noise in ((0, 0.002), (1, 0.005), (2, 0.01)):
        street = glazed(noise=noise, random_state=seed)
        seen, rows = seen_of(street.data, street.scanners[0])
        streets.append((seen, *(mask[rows] for mask in masks(street))))
    names = "turn_000003", "fast_gicp_velodyne", "ahn3_amsterdam_2397", "pcl_cars_mincut"
    others = [seen_of(X, at)[0] for name, X, at in real_clouds(data) if name in names]

    def measured(limits):
        """Least share found, most real points lost, and mirrors in real clouds."""
        found, lost = [], []
        for seen, reflected, room, regular in streets:
            mirrored = _reflections.find_mirrors(*seen, limits)[1] >= 0
            found.append(100 * mirrored[reflected].mean())
            lost.append(100 * mirrored[room | regular].mean())
        mirrors = sum(len(_reflections.find_mirrors(*seen, limits)[0].offsets) for seen in others)
        return f"{min(found):.0f} / {max(lost):.2f} / {mirrors}"

    default = _reflections.MirrorLimits()
    print("default", measured(default))
    for name, value in default._asdict().items():
        cells = []
        for factor in FACTORS:
            scaled = value * factor
            scaled = max(1, round(scaled)) if isinstance(value, int) else scaled
            scaled = min(scaled, 0.99) if name in ("agree", "clear") else scaled
            cells.append(measured(default._replace(**{name: scaled})))
        print(f"{name:10} {value:6g}", *(f"{cell:>14}" for cell in cells), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--real", metavar="DATA", help="folder of real clouds")
    parser.add_argument("--constants", metavar="DATA", help="folder of real clouds")
    options = parser.parse_args()
    if options.real:
        ask_real(Path(options.real))
    elif options.constants:
        scale_constants(Path(options.constants))
    else:
        table()


if __name__ == "__main__":
    main()
