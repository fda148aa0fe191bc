"""Does the detector achieve the stated false-positive rate?

The clouds are new clean planes with Gaussian noise. Rates are in percent of all points, also those
at the plane's edge. In parentheses they are in percent of the points farther than two
neighborhoods from the edge, for which the rate is stated. Numbers are means over the seeds. The
last column is the standard error of the stated rate for the same number of independent points.

    python benchmarks/bench_false_positives.py --seeds 3
    python benchmarks/bench_false_positives.py --shapes

With ``--shapes`` the clouds are whole clean scans: a cylinder, a plane of uneven density, and
streets, without and with the sensor's position.
"""

import argparse
from itertools import product

import numpy as np

FORMS = {
    "paper": {"strictness": None},
    "groups": {},
    "surfaces": {"strictness": "surfaces"},
}


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


def shapes(n, seed):
    """Name, points and where a sensor may stand, of clean clouds in meters."""
    from sklearn_mcmd.datasets import make_street

    rng = np.random.default_rng([seed, n])
    noise = rng.normal(0, 0.004, n)
    angle, radius = rng.uniform(0, 2 * np.pi, n), 1 + noise
    along = rng.uniform(0, 3, n)
    yield (
        "cylinder",
        np.column_stack([radius * np.cos(angle), radius * np.sin(angle), along]),
        [0.0, 0.0, 1.5],
    )
    far = 30 * rng.random(n) ** 3
    yield "uneven plane", np.column_stack([far, along, noise]), [0.0, 1.0, 2.0]
    for sampling in ("uniform", "scan_lines"):
        street = make_street(n, outlier_share=0, sampling=sampling, random_state=seed)
        yield f"street, {sampling}", street.data, street.scanners[0]


def print_shapes(options):
    from sklearn_mcmd import MCMDOutlierDetector

    print("cloud                 sensor   asked %  flagged %", flush=True)
    for name, X, position in shapes(options.n_points, 0):
        for known, rate in product((False, True), options.rates):
            detector = MCMDOutlierDetector(
                false_positive_rate=rate, sensor_origin=position if known else None,
                random_state=0, n_jobs=options.threads,
            )  # fmt: skip
            flagged = (detector.fit_predict(X) == -1).mean()
            sensor = "known" if known else "unknown"
            print(f"{name:20}  {sensor:7}  {100 * rate:7g}  {100 * flagged:7.3f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--forms", nargs="+", choices=FORMS, default=list(FORMS))
    parser.add_argument("--neighbors", nargs="+", type=int, default=[20, 30, 50, 100])
    parser.add_argument("--rates", nargs="+", type=float, default=[0.001, 0.01, 0.05])
    parser.add_argument("--noise", nargs="+", type=float, default=[0.1, 0.3, 1.0])
    parser.add_argument("--n-points", type=int, default=20_000)
    parser.add_argument("--seeds", type=int, default=3)
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
