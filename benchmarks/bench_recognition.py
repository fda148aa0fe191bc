"""Which clouds are recognized as taken from the origin, as they are and moved. See docs/sensor.rst.

    python benchmarks/bench_recognition.py --data ../shared/data

Each line has how uneven directions are over how uneven points are in space (less than .5 for a
view), the least rise from six positions aside in standard errors (more than 3), and the verdict.
"-" was not asked. Then come counts of clouds moved by 1, 10 and 1,000 units in four directions.
"""

import argparse

import numpy as np
from _real_clouds import load_clouds
from simulators import make_airborne_scan, make_depth_frame, make_mobile_scan

from sklearn_mcmd.datasets import make_box, make_crown_roof, make_lidar_turn, make_street
from sklearn_mcmd.sensors import _recognition

DIRECTIONS = np.array([[1, 0, 0], [0, 1, 0], [-0.6, -0.8, 0], [0, 0.6, 0.8]])
LENGTHS = 1, 10, 1_000


def figures(points):
    """Ratio of unevenness and least rise, None where it is not asked, and what is recognized."""
    (here,) = _recognition._views(lambda: [points], np.zeros((1, 3)))
    told = _recognition.view_from_origin(lambda: [points])
    if here is None:
        return None, None, told
    ratio = here.uneven() / here.uneven_in_space()
    if ratio >= _recognition.ViewLimits().even:
        return ratio, None, told
    aside = _recognition.ViewLimits().aside * here.usual_range * np.vstack([np.eye(3), -np.eye(3)])
    mean, error = here.uneven_beside_others()
    others = (view.uneven_beside_others() for view in _recognition._views(lambda: [points], aside))
    return ratio, min((m - mean) / max(error, e) for m, e in others), told


def simulated():
    """Name, points, and whether they were taken from the origin."""
    for rings in (16, 32, 64):
        for options in ({}, {"snow": 2.0}, {"outlier_share": 0.2}):
            name = f"turn of {rings} rings {options or ''}"
            yield name, make_lidar_turn(n_rings=rings, random_state=0, **options).data, True
    frame = make_depth_frame(random_state=0)
    yield "depth frame", frame.data - frame.sensor_origins[0], True
    yield "street", make_street(random_state=0).data, False
    lines = make_street(sampling="scan_lines", random_state=0)
    yield "street in scan lines", lines.data, False
    yield "one of its setups", lines.data - lines.sensor_origins[0], False
    yield "mobile scan", make_mobile_scan(random_state=0).data, False
    yield "airborne scan", make_airborne_scan(random_state=0).data, False
    yield "box", make_box(random_state=0).data, False
    yield "crown roof", make_crown_roof(random_state=0).data, False
    rng = np.random.default_rng(0)
    yield "filled ball", rng.normal(size=(20_000, 3)), False


def moved(points):
    for length in LENGTHS:
        yield from (points + length * direction for direction in DIRECTIONS)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    options = parser.parse_args()
    real = ((cloud.name, cloud.points, None) for cloud in load_clouds(options.data))
    for title, clouds in (("real", real), ("simulated", simulated())):
        recognized, n_moved, n_clouds = 0, 0, 0
        for name, points, truth in clouds:
            ratio, rise, told = figures(points)
            cells = ["-" if value is None else f"{value:.2f}" for value in (ratio, rise)]
            wrong = "" if truth is None or bool(told) == truth else "   WRONG"
            print(f"{name:40} {cells[0]:>6} {cells[1]:>6}  {told or 'not recognized'}{wrong}")
            elsewhere = [
                bool(_recognition.view_from_origin(lambda p=p: [p])) for p in moved(points)
            ]
            recognized, n_moved = recognized + sum(elsewhere), n_moved + len(elsewhere)
            n_clouds += 1
        print(f"{title}: {n_clouds} clouds; moved, {recognized} of {n_moved} are recognized")


if __name__ == "__main__":
    main()
