"""What the sensor's position changes: turns in snow, clouds as they are, streets. In percent.

    python benchmarks/bench_sensor.py --data ../shared/data

Each line has the result by coordinates, of ``strictness="isolated"``, and with the position.
"""

import argparse
from itertools import chain
from pathlib import Path

import numpy as np
from _tables import print_table
from simulators import make_airborne_scan, make_depth_frame, make_lidar_turn, make_mobile_scan

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street

FORMS = {"coordinates": {}, "isolated": {"strictness": "isolated"}, "position": {}}


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


def simulated_scans(size):
    """Turns in snow, whose flakes also are where beams meet nothing else; scans with errors."""
    for snowfall in (1.0, 2.0):
        turn = make_lidar_turn(**size, snow=snowfall, outlier_share=0, random_state=0)
        yield f"make_lidar_turn, {snowfall:g} mm/h", turn.data, turn.target == -1, "origin"
    for make in (make_mobile_scan, make_airborne_scan, make_depth_frame):
        for seed in (0, 1):
            scan = make(**size, outlier_share=0.1, random_state=seed)
            name = f"{make.__name__}, seed {seed}"
            yield name, scan.data, scan.target == -1, scan.sensor_origins


def simulated_streets(size):
    """Streets whose mixed pixels are drawn, and one whose wide beams make them."""
    lines = {**size, "sampling": "scan_lines", "tree": True, "random_state": 0}
    for share in (0.1, 0.2):
        yield f"{share:.0%}", make_street(outlier_share=share, **lines)
    others = ["gaussian", "uniform", "ghost"]
    yield "3 mrad", make_street(outlier_kinds=others, beam_divergence=0.003, **lines)


def judged(X, position):
    """Which points each form flags."""
    for name, form in FORMS.items():
        detector = MCMDOutlierDetector(random_state=0, n_jobs=-1, **form)
        known = position if name == "position" else None
        yield name, detector.fit_predict(X, sensor_origin=known) == -1


def f1(flagged, outlier):
    return 200 * (flagged & outlier).sum() / (flagged.sum() + outlier.sum())


def street_row(street, flagged):
    """Found of each kind, regular points and foliage kept, and right labels."""
    kind, foliage = street.outlier_kind, street.surface_names.index("foliage")
    regular = (kind == 0) & (street.surface != foliage)
    parts = [flagged[kind == k] for k in range(1, 5)]
    parts += [~flagged[regular], ~flagged[(kind == 0) & ~regular], flagged == (kind > 0)]
    return [100 * float(part.mean()) if len(part) else np.nan for part in parts]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--points", type=int, help="of simulated scans, in place of their own")
    options = parser.parse_args(arguments)
    size, rows = {"n_samples": options.points} if options.points else {}, []
    clouds = chain(real_clouds(Path(options.data)), simulated_scans(size))
    for name, X, outlier, position in clouds:
        real = np.ones(len(X), dtype=bool) if outlier is None else ~outlier
        row = [name]
        for _, flagged in judged(X, position):
            lost = f"{100 * flagged[real].mean():.2f}"
            row.append(lost if outlier is None else f"{f1(flagged, outlier):.1f} / {lost}")
        rows.append(row)
    print_table("F1 / real points flagged", ["cloud", *FORMS], rows)
    rows = [
        [f"{outliers}, {name}", *street_row(street, flagged)]
        for outliers, street in simulated_streets(size)
        for name, flagged in judged(street.data, street.sensor_origins)
    ]
    head = [
        "street",
        "Gaussian",
        "uniform",
        "mixed pixels",
        "ghosts",
        "regular",
        "foliage",
        "right",
    ]
    print_table("found, kept and right", head, rows, digits=2)


if __name__ == "__main__":
    main()
