"""Do errors of planes hold? Halves of real planes shall agree within their 95 % regions.

    python benchmarks/bench_planes.py --data ../shared/data
    python benchmarks/bench_planes.py --simulated 200 --output docs/benchmarks

The second asks simulated planes whether bands, levels and verdicts hold.

Halves are random, left and right, lower and upper, or the squares of a checkerboard.
"""

import argparse
from pathlib import Path

import numpy as np
from _plane_verdicts import TABLES
from _real_clouds import load_clouds
from _tables import print_table, texts, write_csv

from sklearn_mcmd import BaardaPlaneDetector, RegionGrowing
from sklearn_mcmd.adjustment import compare_planes

HEAD = ["what", "share", "±"]
VARIANCES = ("independent", "posterior")
LEAST = 200  # points of a real plane
SIMULATED = ("cad_", "dipole", "pcpnet")  # beginnings of names of clouds without real noise


def fitted(X):
    return BaardaPlaneDetector(sigma0="auto", surface="orthogonal").fit(X)


def rate(values):
    """A share and its standard error; planes, not places, are independent."""
    values = np.asarray(values, float)
    return float(values.mean()), float(values.std() / np.sqrt(len(values)))


def real_planes(data, limit):
    """Flat regions of real clouds that are wider than a fiftieth of their length."""
    for cloud in load_clouds(data, limit=limit):
        if cloud.name.startswith(SIMULATED):
            continue
        growing = RegionGrowing(random_state=0, n_jobs=-1).fit(cloud.points)
        for region in np.flatnonzero(growing.regions_["kind"] == "plane"):
            points = cloud.points[growing.labels_ == region]
            local = points - points.mean(axis=0)
            length, width, thick = np.linalg.svd(local, compute_uv=False)
            if len(points) >= LEAST and width > length / 50 and thick > 1e-6 * width:
                yield points, local @ np.linalg.svd(local, full_matrices=False)[2][:2].T


def halves(rng, places):
    """Names and masks of halves: random, and parts of the plane."""
    yield "random halves", rng.random(len(places)) < 0.5
    for name, along in zip(("left and right", "lower and upper"), places.T, strict=True):
        yield name, along < np.median(along)
    side = np.sqrt(np.prod(np.ptp(places, axis=0))) / 8
    yield "checkerboard", np.floor(places / side).sum(axis=1) % 2 == 0


def agreement(rng, data, limit):
    """Shares of halves of real planes whose heights and tilts agree within 95 % regions."""
    agreements, n_planes = {}, 0
    for points, places in real_planes(data, limit):
        n_planes += 1
        for name, first in halves(rng, places):
            if min(first.sum(), (~first).sum()) < LEAST / 4:
                continue
            pair = [fitted(points[part]) for part in (first, ~first)]
            middle = np.mean(
                [part.mean(axis=0) for part in (points[first], points[~first])], axis=0
            )
            kinds = [compare_planes(*pair, variance=kind, place=middle) for kind in VARIANCES]
            for what in ("offset", "tilt"):
                agrees = [getattr(one, what).pvalue >= 0.05 for one in kinds]
                agreements.setdefault(f"{name} of {{}} real planes agree, {what}", []).append(
                    agrees
                )
    for name, agrees in agreements.items():
        yield name.format(n_planes), *map(rate, np.transpose(agrees))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--limit", type=int, default=40_000, help="points of each real cloud")
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--simulated", type=int, metavar="N", help="so many planes a row instead")
    parser.add_argument("--output", help="folder for the table of simulated planes")
    options = parser.parse_args(arguments)
    if options.simulated:
        rows = [row for table in TABLES for row in table(7, options.simulated)]
        print_table("Simulated planes: shares, and their standard errors", HEAD, rows, 3)
        if options.output:
            write_csv(Path(options.output) / "planes_simulated.csv", texts([HEAD, *rows], 3))
        return
    agreements = agreement(np.random.default_rng([7, 50]), options.data, options.limit)
    rows = [(name, *independent, *alike) for name, independent, alike in agreements]
    head = ["what", "independent", "±", "alike nearby", "±"]
    print_table("Shares, and their standard errors", head, rows, 3)


if __name__ == "__main__":
    main()
