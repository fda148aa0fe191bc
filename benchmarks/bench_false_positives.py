"""Does the detector achieve the stated false-positive rate?

The clouds are new clean planes with Gaussian noise. Rates are in percent of all points, also those
at the plane's edge. In parentheses they are in percent of the points farther than two
neighborhoods from the edge, for which the rate is stated. Numbers are means over the seeds. The
last column is the standard error of the stated rate for the same number of independent points.

    python benchmarks/bench_false_positives.py --seeds 3
    python benchmarks/bench_false_positives.py --shapes --forms isolated groups surfaces \
        --rates 0.001 0.003 0.01 0.03

With ``--shapes`` the clouds are whole clean scans of all kinds, without and with the sensor's
position, and the rates are those of points on faces. With ``--outliers`` the share of these that
is found is printed as well.
"""

import argparse
from itertools import product

import numpy as np

FORMS = {
    "paper": {"strictness": None},
    "isolated": {"strictness": "isolated"},
    "groups": {},
    "surfaces": {"strictness": "surfaces"},
}
# Parts of the names of what is no face.
SOFT = (
    "tree",
    "crown",
    "forest",
    "shrub",
    "bush",
    "hedge",
    "plant",
    "grass",
    "wire",
    "cable",
    "fence",
    "post",
    "pole",
)


def clean_plane(n, noise, n_neighbors, seed):
    """Square of n points of spacing 1, and which are far from its edge."""
    rng = np.random.default_rng([seed, n])
    side = np.sqrt(n)
    X = rng.uniform(0, side, (n, 3))
    X[:, 2] = rng.normal(0, noise, n)
    margin = 2 * np.sqrt(n_neighbors / np.pi)
    return X, (np.abs(X[:, :2] - side / 2) < side / 2 - margin).all(axis=1)


def achieved(X, far, form, n_neighbors, rate, n_jobs):
    from sklearn_mcmd import MCMDOutlierDetector

    detector = MCMDOutlierDetector(
        n_neighbors, false_positive_rate=rate, random_state=0, n_jobs=n_jobs, **FORMS[form]
    )
    flagged = detector.fit_predict(X) == -1
    return flagged.mean(), flagged[far].mean(), -detector.offset_


def shapes(n, seed, outliers):
    """Name, points, where the sensor stood, which are on faces, and which are real, of clouds.

    Points of leaves, wires, posts and grass are on no face.
    """
    from simulators import make_airborne_scan, make_depth_frame, make_mobile_scan

    from sklearn_mcmd.datasets import make_lidar_turn, make_street

    rng = np.random.default_rng([seed, n])
    everywhere, noise = np.ones(n, bool), rng.normal(0, 0.004, n)
    along, far = rng.uniform(0, 3, n), 30 * rng.random(n) ** 3
    plane, _ = clean_plane(n, 0.3, 50, seed)
    yield "plane", plane, [np.sqrt(n) / 2, np.sqrt(n) / 2, 50.0], everywhere, everywhere
    uneven = np.column_stack([far, along, noise])
    yield "plane of uneven density", uneven, [0.0, 1.0, 2.0], everywhere, everywhere
    angle, radius = rng.uniform(0, 2 * np.pi, n), 1 + noise
    cylinder = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), along])
    yield "cylinder", cylinder, [0.0, 0.0, 1.5], everywhere, everywhere
    sphere = rng.normal(size=(n, 3))
    sphere *= (radius / np.linalg.norm(sphere, axis=1))[:, None]
    yield "sphere", sphere, [0.0, 0.0, 0.0], everywhere, everywhere
    for name, how in {
        "street": {},
        "street, spacing grows 3.4 times": {"spacing_growth": 3.4},
        "street with a tree": {"tree": True},
        "street in scan lines": {"sampling": "scan_lines"},
        "street in scan lines, tree": {"sampling": "scan_lines", "tree": True},
    }.items():
        street = make_street(n, outlier_share=outliers, random_state=seed, **how)
        yield name, street.data, street.sensor_origins[0], faces_of(street), street.target == 1
    for name, make, how in (
        ("mobile scan", make_mobile_scan, {"far_share": 0}),
        ("airborne scan", make_airborne_scan, {"far_share": 0}),
        ("spinning turn", make_lidar_turn, {}),
        ("depth frame", make_depth_frame, {}),
    ):
        made = make(n, outlier_share=outliers, random_state=seed, **how)
        yield name, made.data, made.sensor_origins, faces_of(made), made.target == 1


def faces_of(made):
    """Which points are of faces, by the names of what they are on."""
    names = np.asarray(made.surface_names)
    soft = [any(word in name for word in SOFT) for name in names]
    return ~np.asarray(soft)[made.surface]


def print_shapes(options):
    from sklearn_mcmd import MCMDOutlierDetector

    rates = "".join(f"{100 * rate:8g}" for rate in options.rates)
    rates += " (found, in the same order)" if options.outliers else ""
    print(f"{'flagged %, asked:':33}{'strictness':11}{'sensor':8}{rates}    worst / asked")
    for name, X, position, faces, real in shapes(
        options.n_points, options.first_seed, options.outliers
    ):
        if not any(part in name for part in options.clouds):
            continue
        for form, known in product(options.forms, (False, True)):
            detector = MCMDOutlierDetector(
                random_state=0, n_jobs=options.threads, **{"strictness": form, **FORMS[form]}
            )
            counted, lost, found = faces & real, [], []
            for rate in options.rates:
                detector.set_params(false_positive_rate=rate)
                labels = detector.fit_predict(X, sensor_origin=position if known else None)
                lost.append((labels[counted] == -1).mean())
                found.append((labels[~real] == -1).sum() / max(1, np.count_nonzero(~real)))
            sensor, worst = "known" if known else "unknown", max(np.divide(lost, options.rates))
            shown = "".join(f"{100 * share:8.3f}" for share in lost)
            shown += "".join(f"{100 * share:8.1f}" for share in found) if options.outliers else ""
            print(f"{name:33}{form:11}{sensor:8}{shown}{worst:9.1f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--forms", nargs="+", choices=FORMS, default=list(FORMS))
    parser.add_argument("--neighbors", nargs="+", type=int, default=[20, 30, 50, 100])
    parser.add_argument("--rates", nargs="+", type=float, default=[0.001, 0.01, 0.05])
    parser.add_argument("--noise", nargs="+", type=float, default=[0.1, 0.3, 1.0])
    parser.add_argument("--n-points", type=int, default=20_000)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--outliers", type=float, default=0.0, help="share, with --shapes")
    parser.add_argument("--clouds", nargs="+", default=[""], help="parts of names, with --shapes")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--shapes", action="store_true", help="whole clean scans instead")
    options = parser.parse_args()
    if options.shapes:
        return print_shapes(options)
    print("form       k    noise  asked %  all %  (far %)  cutoff  +- %", flush=True)
    rows = product(options.forms, options.neighbors, options.noise, options.rates)
    for form, k, noise, rate in rows:
        found = [
            achieved(*clean_plane(options.n_points, noise, k, seed), form, k, rate, options.threads)
            for seed in range(options.seeds)
        ]
        all_points, far, cutoff = np.mean(found, axis=0)
        error = np.sqrt(rate * (1 - rate) / (options.n_points * options.seeds))
        print(
            f"{form:10} {k:3d}  {noise:5g}  {100 * rate:7g}  {100 * all_points:5.3f}  "
            f"({100 * far:5.3f})  {cutoff:6.3f}  {100 * error:5.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
