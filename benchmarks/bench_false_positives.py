"""Does the detector achieve the stated false-positive rate?

The clouds are whole clean scans of all kinds, without and with the sensor's position. Rates are in
percent of the points on faces: leaves, wires, posts and grass are on none.

    python benchmarks/bench_false_positives.py --rates 0.001 0.01 0.03 --first-seed 7
    python benchmarks/bench_false_positives.py --neighbors 20 50 100  # at a cutoff of 3
"""

import argparse
from itertools import product

import numpy as np
from _tables import print_table
from simulators import make_airborne_scan, make_depth_frame, make_lidar_turn, make_mobile_scan

from sklearn_mcmd import MCMDOutlierDetector
from sklearn_mcmd.datasets import make_street

# Parts of the names of what is no face.
SOFT = ("tree", "crown", "forest", "shrub", "bush", "hedge", "plant", "grass", "wire", "cable")
SOFT += ("fence", "post", "pole")
STREETS = {
    "street": {},
    "street with a tree": {"tree": True},
    "street in scan lines": {"sampling": "scan_lines"},
    "street in scan lines, tree": {"sampling": "scan_lines", "tree": True},
}
SCANS = {
    "mobile scan": (make_mobile_scan, {"far_share": 0}),
    "airborne scan": (make_airborne_scan, {"far_share": 0}),
    "spinning turn": (make_lidar_turn, {}),
    "depth frame": (make_depth_frame, {}),
}


def shapes(n, seed):
    """Name, points, where the sensor stood, and which points are on faces."""
    rng, plane_rng = np.random.default_rng([seed, n]), np.random.default_rng([seed, n])
    everywhere, noise = np.ones(n, bool), rng.normal(0, 0.004, n)
    along, far = rng.uniform(0, 3, n), 30 * rng.random(n) ** 3
    plane = plane_rng.uniform(0, np.sqrt(n), (n, 3))
    plane[:, 2] = plane_rng.normal(0, 0.3, n)
    yield "plane", plane, [np.sqrt(n) / 2, np.sqrt(n) / 2, 50.0], everywhere
    uneven = np.column_stack([far, along, noise])
    yield "plane of uneven density", uneven, [0.0, 1.0, 2.0], everywhere
    angle, radius = rng.uniform(0, 2 * np.pi, n), 1 + noise
    cylinder = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), along])
    yield "cylinder", cylinder, [0.0, 0.0, 1.5], everywhere
    sphere = rng.normal(size=(n, 3))
    sphere *= (radius / np.linalg.norm(sphere, axis=1))[:, None]
    yield "sphere", sphere, [0.0, 0.0, 0.0], everywhere
    for name, how in STREETS.items():
        street = make_street(n, outlier_share=0.0, random_state=seed, **how)
        yield name, street.data, street.sensor_origins[0], faces_of(street)
    for name, (make, how) in SCANS.items():
        made = make(n, outlier_share=0.0, random_state=seed, **how)
        yield name, made.data, made.sensor_origins, faces_of(made)


def faces_of(made):
    """Which points are of faces, by the names of what they are on."""
    soft = [any(word in name for word in SOFT) for name in made.surface_names]
    return ~np.asarray(soft)[made.surface]


def at_three(neighbors, n, seed, n_planes=3):
    """Percent of clean planes beyond three deviations, and standard errors."""
    forms = {"default": {}, "None": {"strictness": None}}
    forms["None, no reweighting"] = {"strictness": None, "reweight": False}
    for (form, how), k, noise in product(forms.items(), neighbors, (0.05, 0.3)):
        lost = []
        for i in range(n_planes):
            rng = np.random.default_rng([seed, i])
            X = rng.uniform(0, np.sqrt(n), (n, 3))
            X[:, 2] = rng.normal(0, noise, n)
            detector = MCMDOutlierDetector(k, cutoff=3.0, random_state=0, n_jobs=-1, **how)
            lost.append(100 * float((detector.fit_predict(X) == -1).mean()))
        yield f"{form}, {k} neighbors, noise {noise:g}", np.mean(lost), np.std(lost) / n_planes**0.5


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--forms", nargs="+", default=["groups"], help="levels of strictness")
    parser.add_argument("--rates", nargs="+", type=float, default=[0.001, 0.01, 0.05])
    parser.add_argument("--n-points", type=int, default=20_000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--clouds", nargs="+", default=[""], help="parts of names")
    parser.add_argument("--neighbors", nargs="+", type=int, help="planes at a cutoff of 3 instead")
    options = parser.parse_args(arguments)
    if options.neighbors:
        rows = list(at_three(options.neighbors, options.n_points, options.first_seed))
        print_table("beyond 3, percent", ["strictness, plane", "flagged", "±"], rows, digits=3)
        return
    rows = []
    for name, X, position, faces in shapes(options.n_points, options.first_seed):
        if not any(part in name for part in options.clouds):
            continue
        for form, known in product(options.forms, (False, True)):
            detector = MCMDOutlierDetector(strictness=form, random_state=0, n_jobs=-1)
            lost = []
            for rate in options.rates:
                detector.set_params(false_positive_rate=rate)
                labels = detector.fit_predict(X, sensor_origin=position if known else None)
                lost.append(100 * float((labels[faces] == -1).mean()))
            rows.append([f"{name}, {form}, {'known' if known else 'unknown'}", *lost])
    head = ["cloud, strictness, sensor", *(f"{100 * rate:g} %" for rate in options.rates)]
    print_table("flagged, percent", head, rows, digits=2)


if __name__ == "__main__":
    main()
