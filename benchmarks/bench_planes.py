"""Do errors, lack of fit, flatness and comparisons of planes hold? Rates with standard errors.

    python benchmarks/bench_planes.py --data ../shared/data --output docs/benchmarks

A wall of 4 by 2.5 m has 4 mm of independent noise, and beside it a smooth part: normal, of a
standard deviation in mm, and with a correlation that falls over a length in m like a normal curve.
Real planes are cut in halves, which shall agree within their 95 % regions.
"""

import argparse
import warnings
from itertools import product
from pathlib import Path

import numpy as np
from _real_clouds import load_clouds
from _tables import print_table, write_csv
from scipy.spatial.distance import cdist

from sklearn_mcmd import BaardaPlaneDetector, FuzzyPlaneDetector, RegionGrowing
from sklearn_mcmd.adjustment import compare_planes, flatness

WALL, NOISE = np.array([4.0, 2.5]), 0.004  # meters
SMOOTH = [(0, 0.3), (0.5, 0.3), (1, 0.3), (1, 0.5)]  # mm, m
LENGTHS = [0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0]
VARIANCES = ("independent", "posterior")
LEAST = 200  # points of a real plane
TURN = [np.array([2.0, 1.25, 0.0]), 1.0]  # place and degrees
SIMULATED = ("cad_", "dipole", "pcpnet")  # beginnings of names of clouds without real noise


def fitted(X, sigma0=NOISE):
    return BaardaPlaneDetector(sigma0=sigma0, surface="orthogonal").fit(X)


def wall(rng, n, heights=0.0):
    """Points of a wall that lies on its back."""
    return np.column_stack([rng.uniform(0, 1, (n, 2)) * WALL, heights + rng.normal(0, NOISE, n)])


def smooth_walls(rng, repetitions, size, length, across=False):
    """Walls of 2,000 points with a smooth part; `across` has ridges that are alike along y."""
    per_design = min(repetitions, 50)
    for _ in range(-(-repetitions // per_design)):
        xy = rng.uniform(0, 1, (2_000, 2)) * WALL
        places = xy * [1, 0] if across else xy
        covariance = np.exp(-(cdist(places, places) ** 2) / (2 * length**2))
        root = np.linalg.cholesky(covariance + 1e-7 * np.eye(len(xy))) if size else np.zeros((1, 1))
        for _ in range(per_design):
            parts = size / 1000 * (root @ rng.normal(size=len(root)))
            yield np.column_stack([xy, parts + rng.normal(0, NOISE, len(xy))])


def rate(values):
    """A share and its standard error; planes, not places, are independent."""
    values = np.asarray(values, float)
    return float(values.mean()), float(values.std() / np.sqrt(len(values)))


def errors_of_smooth(name, rng, repetitions, **how):
    """Coverage of the band, and planes that seem to differ, by both kinds of errors."""
    places = np.column_stack([rng.uniform(0, 1, (200, 2)) * WALL, np.zeros(200)])
    found = [fitted(X) for X in smooth_walls(rng, repetitions, **how)]
    bands, moved = [], []
    for kind in VARIANCES:
        gaps = ((abs(one.residuals(places)), one.band(places, variance=kind)[0]) for one in found)
        bands.append(rate([np.mean(gap <= band) for gap, band in gaps]))
        pairs = zip(found[::2], found[1::2], strict=False)
        verdicts = [compare_planes(*pair, variance=kind).verdict for pair in pairs]
        moved.append(rate([verdict != "same" for verdict in verdicts]))
    yield f"95 % band covers, {name}", *bands
    yield f"moved or tilted, though nothing is, {name}", *moved


def forms(rng, repetitions):
    """Lack of fit and flatness, of walls without and with a bow."""
    nothing = (np.nan, np.nan)

    def bow(X, height):
        X[:, 2] += height * (1 - (X[:, 0] / 2 - 1) ** 2)
        return X

    for name, height in (("lack of fit, flat", 0.0), ("lack of fit, bow of 2 mm", 0.002)):
        walls = (bow(wall(rng, 2_000), height) for _ in range(repetitions))
        yield name, nothing, rate([fitted(X).form_.pvalue < 0.05 for X in walls])
    cases = {"flat, 10 mm: kept": (0, 0.01), "bow of 10 mm, 5 mm: exceeded": (0.01, 0.005)}
    for name, (height, tolerance) in cases.items():
        walls = (bow(wall(rng, 8_000), height) for _ in range(repetitions // 4))
        verdicts = [flatness(fitted(X), X, tolerance).verdict for X in walls]
        found = [verdict == name.split(": ")[1] for verdict in verdicts]
        yield f"flatness of 8,000 points, {name}", nothing, rate(found)


def levels(rng, repetitions):
    """Clean planes of few points with a flagged one, at alpha 0.05."""
    kinds = {
        "snooping, auto": BaardaPlaneDetector(sigma0="auto"),
        "snooping, tau": BaardaPlaneDetector(test="tau"),
        "fuzzy, sigma0 known": FuzzyPlaneDetector(sigma0=NOISE),
        "fuzzy, auto": FuzzyPlaneDetector(sigma0="auto"),
        "fuzzy, sigma0 known, Sidak": FuzzyPlaneDetector(sigma0=NOISE, correction="sidak"),
        "fuzzy, auto, Sidak": FuzzyPlaneDetector(sigma0="auto", correction="sidak"),
    }
    for name, detector in kinds.items():
        for n in (10, 20, 50, 200):
            found = [-1 in detector.fit_predict(wall(rng, n)) for _ in range(repetitions)]
            yield f"clean planes of {n} points with a flagged one, {name}", rate(found)


def inside_ellipse(detector, normal):
    """Whether the 95 % region of the normal holds the true one."""
    precision = detector.precision("independent")
    error = np.sign(detector.normal_ @ normal) * normal - detector.normal_
    radius = np.degrees(precision.ellipse_axes.T @ error) / precision.ellipse
    return np.linalg.norm(radius) <= precision.confidence_factor()


def few_and_narrow(rng, repetitions):
    """Coverage where planes are narrow, and where sigma0 and outliers are unknown."""
    up = np.array([0.0, 0, 1])
    for width in (1.5, 3.0):
        found = []
        for _ in range(repetitions):
            X = rng.uniform(-1, 1, (200, 3)) * [100, width * np.sqrt(3), 0] * NOISE
            X += rng.normal(0, NOISE, X.shape)
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message="The points that pass are as thick")
                found.append(inside_ellipse(fitted(X), up))
        yield f"95 % region of the normal, strip of {width:g} sigma", rate(found)
    for sigma0, deviations, n in product((NOISE, "auto"), (10, 4), (10, 20, 100)):
        detector = BaardaPlaneDetector(
            sigma0=sigma0, surface="orthogonal", robust_start=True, random_state=0
        )
        inside, shares = [], []
        for _ in range(repetitions):
            X = wall(rng, n)
            X[: n // 5, 2] += deviations * NOISE
            detector.fit(X)
            inside.append(inside_ellipse(detector, up))
            shares.append(np.mean(detector.labels_[: n // 5] == -1))
        known = "auto" if sigma0 == "auto" else "sigma0 known"
        name = f"{n} points, {known}, a fifth {deviations} sigma to one side"
        yield f"95 % region of the normal, {name}", rate(inside)
        yield f"outliers found, {name}", rate(shares)


def turned(X, degrees, place):
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    return (X - place) @ turn + place


def turns(rng, repetitions):
    """A pure turn about a place, and the errors of large tilts over their deviations."""
    nothing, (place, degrees) = (np.nan, np.nan), TURN
    for name, where in (("given", place), ("of the middles", None)):
        found = []
        for _ in range(repetitions):
            pair = fitted(wall(rng, 2_000)), fitted(turned(wall(rng, 2_000), degrees, place))
            found.append(compare_planes(*pair, place=where).offset.significant)
        yield f"moved, of a turn of 1 degree about the place {name}", nothing, rate(found)
    for tilt in (45, 80):
        pairs = [
            (wall(rng, 60), turned(wall(rng, 60), tilt, place)) for _ in range(4 * repetitions)
        ]
        found = [compare_planes(*map(fitted, pair), variance="prior").tilt for pair in pairs]
        values, errors = np.array([(one.value, one.error) for one in found]).T
        ratio = np.sqrt(np.mean(errors**2)) / values.std()
        error = ratio / np.sqrt(2 * len(values))
        yield f"error of a tilt of {tilt} degrees over its deviation", nothing, (ratio, error)


def real_planes(data, limit):
    """Flat regions of real clouds that are wider than a fiftieth of their length."""
    for cloud in load_clouds(data, limit=limit):
        if cloud.name.startswith(SIMULATED):
            continue
        growing = RegionGrowing(random_state=0, n_jobs=-1).fit(cloud.points)
        for region in np.flatnonzero(growing.regions_["kind"] == "plane"):
            own = cloud.points[growing.labels_ == region]
            local = own - own.mean(axis=0)
            length, width, thick = np.linalg.svd(local, compute_uv=False)
            if len(own) >= LEAST and width > length / 50 and thick > 1e-6 * width:
                yield own, local @ np.linalg.svd(local, full_matrices=False)[2][:2].T


def halves(rng, places):
    """Names and masks of halves: random, and parts of the plane."""
    yield "random halves", rng.random(len(places)) < 0.5
    for name, along in zip(("left and right", "lower and upper"), places.T, strict=True):
        yield name, along < np.median(along)
    side = np.sqrt(np.prod(np.ptp(places, axis=0))) / 8
    yield "checkerboard", np.floor(places / side).sum(axis=1) % 2 == 0


def agreement(rng, data, limit):
    """Shares of halves of real planes whose heights and tilts agree within 95 % regions."""
    found, n_planes = {}, 0
    for own, places in real_planes(data, limit):
        n_planes += 1
        for name, first in halves(rng, places):
            if min(first.sum(), (~first).sum()) < LEAST / 4:
                continue
            pair = [fitted(own[part], "auto") for part in (first, ~first)]
            middle = np.mean([part.mean(axis=0) for part in (own[first], own[~first])], axis=0)
            kinds = [compare_planes(*pair, variance=kind, place=middle) for kind in VARIANCES]
            for what in ("offset", "tilt"):
                agrees = [getattr(one, what).pvalue >= 0.05 for one in kinds]
                found.setdefault(f"{name} of {{}} real planes agree, {what}", []).append(agrees)
    for name, agrees in found.items():
        yield name.format(n_planes), *map(rate, np.transpose(agrees))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repetitions", type=int, default=800, help="simulated walls of a row")
    parser.add_argument("--limit", type=int, default=40_000, help="points of each real cloud")
    parser.add_argument("--data", type=Path, help="folder of real clouds")
    parser.add_argument("--output", type=Path, help="folder for planes_errors.csv")
    options = parser.parse_args(arguments)
    n, rows = options.repetitions, []
    head = ["what", "independent", "±", "alike nearby", "±"]

    def seeded(seed):
        return np.random.default_rng([7, seed])

    for i, (size, length) in enumerate(SMOOTH):
        name = f"smooth part of {size:g} mm over {length:g} m" if size else "no smooth part"
        rows += errors_of_smooth(name, seeded(i), n, size=size, length=length)
    for i, length in enumerate(LENGTHS):
        name = f"1 mm over {length:g} m"
        rows += list(errors_of_smooth(name, seeded(10 + i), n // 4, size=1, length=length))[:1]
    name = "ridges of 1 mm over 0.3 m"
    ridges = errors_of_smooth(name, seeded(20), n // 4, size=1, length=0.3, across=True)
    rows += list(ridges)[:1]
    rows += forms(seeded(30), n)
    rows += turns(seeded(40), n)
    if options.data is not None:
        rows += agreement(seeded(50), options.data, options.limit)
    rows = [(name, *first, *second) for name, first, second in rows]
    rows = [[row[0], *("" if value != value else value for value in row[1:])] for row in rows]
    print_table("Shares, and their standard errors", head, rows, 3)
    if options.output is not None:
        rows = [[row[0], *(v if v == "" else f"{v:.3f}" for v in row[1:])] for row in rows]
        write_csv(options.output / "planes_errors.csv", [head, *rows])
    rows = [*levels(seeded(60), n), *few_and_narrow(seeded(70), n)]
    rows = [(name, *found) for name, found in rows]
    print_table("Levels and coverage", ["what", "share", "±"], rows, 3)


if __name__ == "__main__":
    main()
