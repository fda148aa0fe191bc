"""What tells a position of the sensor that is right from one that is wrong. See docs/sensor.rst.

    python benchmarks/bench_stated.py --data ../shared/data

Each line has how uneven directions are over how uneven points are in space (a file's word is taken
below .5), the share of sheets of rays in all that is flat (a warning from 10 % on), and percents of
all points: outliers by coordinates, by the position, and by rays alone.
"""

import argparse
import warnings

import numpy as np
from _real_clouds import load_clouds
from simulators import make_airborne_scan, make_depth_frame, make_mobile_scan

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_lidar_turn, make_street
from sklearn_mcmd.sensors import _recognition

TURNS = [
    *("snow_real_half_turn", "snow_spinning_lidar/turn_000003", "fast_gicp_velodyne"),
    "spinning_turns_labelled/turn_04",
]
MERGED = ["open3d_redwood_fragment", "pcl_building_region_growing", "mobile_street_labelled"]


def figures(points, position):
    """The numbers of a line; the ratio is None of a sensor that moves or is far away."""
    ratio = None
    if np.ndim(position) == 1:
        (here,) = _recognition._views(lambda: [points - position], np.zeros((1, 3)))
        ratio = here and here.uneven() / here.uneven_in_space()
    plain = MCMDOutlierDetector(random_state=0, n_jobs=-1).fit(points)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        told = MCMDOutlierDetector(random_state=0, n_jobs=-1).fit(points, sensor_origin=position)
    sheets, surfaces = told._cloud.rays.on_sheet.sum(), told._cloud.explaining.sum()
    flagged = [np.mean(fitted.scores_ < fitted.offset_) for fitted in (plain, told)]
    alone = told.n_by_rays_ / len(points)
    return ratio, *(100 * share for share in (sheets / (sheets + surfaces), *flagged, alone))


def scanned():
    """Simulated scans with outliers: name, points, and positions that are right or wrong."""
    for share in (0.1, 0.2):
        options = {"sampling": "scan_lines", "tree": True, "outlier_share": share}
        street = make_street(100_000, random_state=0, **options)
        yield f"street, {share:.0%} of outliers", street.data, moved(street.sensor_origins[0], 2.8)
    for make in (make_mobile_scan, make_depth_frame, make_airborne_scan):
        scan = make(30_000, outlier_share=0.2, random_state=1)
        low = scan.sensor_origins * [1, 1, 0]
        yield f"{make.__name__}, 20 %", scan.data, {"right": scan.sensor_origins, "at z = 0": low}
    turn = make_lidar_turn(30_000, outlier_share=0.2, random_state=0).data
    yield "make_lidar_turn, 20 %", turn, moved(np.zeros(3), 10.0, turn[:, 2].min())


def moved(position, range_, ground=0.0):
    """The position, and three that are wrong."""
    return {
        "right": position,
        "10 % of the range aside": position + np.array([0.1 * range_, 0, 0]),
        "1.5 above": position + np.array([0, 0, 1.5]),
        "on the ground": np.array([*position[:2], ground]),
    }


def corners(points):
    """Positions that a merged cloud may state: of its box, and its mean."""
    low, high = points.min(axis=0), points.max(axis=0)
    floor = [*(low + high)[:2] / 2, low[2]]
    return {"corner": low, "floor": np.array(floor), "middle": (low + high) / 2}


def clouds(folder):
    yield from scanned()
    for name, points, *_ in load_clouds(folder, TURNS):
        range_, ground = np.median(np.linalg.norm(points, axis=1)), np.percentile(points[:, 2], 5)
        yield name, points, moved(np.zeros(3), range_, ground)
    for name, points, *_ in load_clouds(folder, MERGED):
        yield name, points, corners(points)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    for name, points, positions in clouds(parser.parse_args().data):
        for where, position in positions.items():
            ratio, *shares = figures(points, position)
            cells = ["-" if ratio is None else f"{ratio:.2f}", *(f"{s:.2f}" for s in shares)]
            print(f"{name:30} {where:24}" + "".join(f"{cell:>8}" for cell in cells), flush=True)


if __name__ == "__main__":
    main()
