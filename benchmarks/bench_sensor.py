"""What the sensor's position changes: turns in snow, clouds as they are, streets. In percent.

    python benchmarks/bench_sensor.py --data ../shared/data

Each line has the result by coordinates, of ``strictness="isolated"``, and with the position.
Processor time is that with the position over that without.
"""

import argparse
import time
from itertools import chain
from pathlib import Path

import numpy as np
from simulators import make_airborne_scan, make_depth_frame, make_mobile_scan

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_lidar_turn, make_street

FORMS = ({}, {"strictness": "isolated"}, None)  # None: with the position


def real_clouds(data):
    """Name, points, outliers (or None) and the sensor's position."""
    for path in sorted((data / "snow_spinning_lidar").glob("*.npz")):
        with np.load(path) as arrays:
            yield path.stem, arrays["xyz"].astype(np.float64), arrays["snow"], "origin"
    for name in ("fast_gicp_velodyne", "ahn3_amsterdam_2397"):
        path = data / name / "cloud.npz"
        if path.is_file():
            with np.load(path) as arrays:
                X = arrays["xyz"]
            above = [*X[:, :2].mean(axis=0), X[:, 2].min() + 500]
            yield name, X, None, "origin" if name.startswith("fast") else above


def simulated_scans():
    """Turns in snow, whose flakes also are where beams meet nothing else; scans with errors."""
    for snowfall in (1.0, 2.0):
        turn = make_lidar_turn(snow=snowfall, outlier_share=0, random_state=0)
        yield f"make_lidar_turn, {snowfall:g} mm/h", turn.data, turn.target == -1, "origin"
    for make in (make_mobile_scan, make_airborne_scan, make_depth_frame):
        for seed in (0, 1):
            scan = make(outlier_share=0.1, random_state=seed)
            name = f"{make.__name__}, seed {seed}"
            yield name, scan.data, scan.target == -1, scan.sensor_origins


def simulated_streets():
    """Streets whose mixed pixels are drawn, and one whose wide beams make them."""
    lines = {"sampling": "scan_lines", "tree": True, "random_state": 0}
    for share in (0.1, 0.2):
        yield f"{share:.0%}", make_street(outlier_share=share, **lines)
    others = ["gaussian", "uniform", "ghost"]
    yield "3 mrad", make_street(outlier_kinds=others, beam_divergence=0.003, **lines)


def judged(X, position):
    """Which points each form flags, and the ratio of times."""
    flagged, seconds = [], []
    for form in FORMS:
        known = position if form is None else None
        start = time.process_time()
        detector = MCMDOutlierDetector(random_state=0, **(form or {}))
        flagged.append(detector.fit_predict(X, sensor_origin=known) == -1)
        seconds.append(time.process_time() - start)
    return flagged, seconds[2] / seconds[0]


def f1(flagged, outlier):
    return 200 * (flagged & outlier).sum() / (flagged.sum() + outlier.sum())


def street_line(street, flagged):
    """Found of each kind, regular points and foliage kept, and right labels."""
    kind, foliage = street.outlier_kind, street.surface_names.index("foliage")
    found = [100 * flagged[kind == k].mean() for k in range(1, 5)]
    regular = (kind == 0) & (street.surface != foliage)
    kept = [100 * (~flagged[of]).mean() for of in (regular, (kind == 0) & ~regular)]
    right = 100 * (flagged == (kind > 0)).mean()
    return " ".join(f"{value:6.2f}" for value in (*found, *kept, right))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    options = parser.parse_args()
    judged(np.random.default_rng(0).random((3000, 3)), [0.5, 0.5, 9.0])  # compiles
    print("cloud: F1 / real points flagged, by coordinates, isolated, with the position; time")
    for name, X, outlier, position in chain(real_clouds(Path(options.data)), simulated_scans()):
        real = np.ones(len(X), dtype=bool) if outlier is None else ~outlier
        forms, ratio = judged(X, position)
        cells = [f"{100 * flagged[real].mean():.2f}" for flagged in forms]
        if outlier is not None:
            scores = (f1(flagged, outlier) for flagged in forms)
            cells = [f"{score:.1f} / {cell}" for score, cell in zip(scores, cells, strict=True)]
        print(f"{name:25}", "  ".join(cells), f" x {ratio:.2f}", flush=True)
    print("street: Gaussian, uniform, mixed pixels, ghosts found; regular, foliage kept; right")
    for outliers, street in simulated_streets():
        forms, ratio = judged(street.data, street.sensor_origins)
        for name, flagged in zip(("unknown", "isolated", "known"), forms, strict=True):
            print(f"{outliers:6} {name:9}", street_line(street, flagged), flush=True)
        print(f"{outliers:6} time x {ratio:.2f}")


if __name__ == "__main__":
    main()
