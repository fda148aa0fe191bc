"""Simulated planes whose truth is known: do bands, levels and verdicts hold?"""

import warnings

import numpy as np

from sklearn_mcmd import BaardaPlaneDetector, RobustNormalEstimator
from sklearn_mcmd.adjustment import compare_planes, flatness, scan_weights

SIZE, NOISE = np.array([4.0, 2.5]), 0.004  # meters, of walls
AUTO = {"sigma0": "auto", "surface": "orthogonal"}
STATION = np.array([-3.0, -2.0, 1.2])
BANDS = {
    "white": lambda rng, xy: 0.0,
    "smooth, 1 mm over 0.3 m": lambda rng, xy: 0.001 * smooth(rng, xy, 0.3),
    "smooth, 1 mm over 1 m": lambda rng, xy: 0.001 * smooth(rng, xy, 1.0),
    "14 rows, 1 mm": lambda rng, xy: strips(rng, xy[:, 1], 14),
    "44 rows, 1 mm": lambda rng, xy: strips(rng, xy[:, 1], 44),
    "10 columns, 1 mm": lambda rng, xy: strips(rng, xy[:, 0], 10),
}
FORMS = {
    "flat": lambda rng, xy, times: np.zeros(len(xy)),
    "bow": lambda rng, xy, times: times * (2 * xy[:, 0] / SIZE[0] - 1) ** 2,
    "plateau of 1 square meter": lambda rng, xy, times: times * plateau(rng, xy),
}
HEIGHTS = {"flat": [0.0], "bow": [0.5, 0.8, 0.95, 1.1, 1.4]}
HEIGHTS["plateau of 1 square meter"] = [0.45, 0.6, 0.8, 0.95, 1.1, 1.4]


def smooth(rng, xy, length, n_waves=400):
    """Random waves of unit variance, of the correlation exp(-d^2 / (2 length^2))."""
    waves, phases = rng.normal(size=(n_waves, 2)) / length, rng.uniform(0, 2 * np.pi, n_waves)
    return np.sqrt(2 / n_waves) * np.cos(xy @ waves.T + phases).sum(axis=1)


def strips(rng, along, n):
    return 0.001 * rng.normal(size=n)[(along / along.max() * n).astype(int).clip(max=n - 1)]


def plateau(rng, xy):
    center = rng.uniform([0.6, 0.6], SIZE - 0.6)
    return (np.abs(xy - center) < 0.5).all(axis=1)


def judged(X, weights=None):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return BaardaPlaneDetector(**AUTO, robust_start=True, random_state=0).fit(X, None, weights)


def share(values):
    """A share or mean, and its standard error."""
    values = np.asarray(values, float)
    return float(values.mean()), float(values.std() / np.sqrt(len(values)))


def bands(seed, repetitions):
    """Walls with noise in common: does the band of 95 % hold the middle, do equal walls differ?"""
    for name, common in BANDS.items():
        held, width, differ = [], [], []
        for i in range(repetitions):
            rng, pair = np.random.default_rng([seed, i]), []
            for _ in range(2):
                xy = rng.uniform(0, 1, (2_000, 2)) * SIZE
                z = rng.normal(0, NOISE, 2_000) + common(rng, xy)
                pair.append(judged(np.column_stack([xy, z])))
            middle = np.append(SIZE / 2, 0.0)[None]
            limits = [pair[0].band(middle, variance=v)[0][0] for v in ("posterior", "independent")]
            held.append(abs(pair[0].residuals(middle)[0]) < limits[0])
            width.append(limits[0] / limits[1])
            differ.append(compare_planes(*pair).verdict != "same")
        yield f"band holds, {name}", *share(held)
        yield f"width over that of independent noise, {name}", *share(width)
        yield f"equal planes differ, {name}", *share(differ)


def floors(seed, repetitions):
    """Level floors in steps of 1 cm."""
    for noise in (0.002, 0.003, 0.004, 0.005):
        lost, held = [], []
        for i in range(repetitions):
            rng = np.random.default_rng([seed, i])
            height = rng.uniform(-0.005, 0.005)
            xy, z = rng.uniform(0, 4, (2_000, 2)), rng.normal(height, noise, 2_000)
            detector = judged(np.round(np.column_stack([xy, z]), 2))
            middle = np.array([[2.0, 2.0, height]])
            lost.append(np.mean(detector.labels_ == -1))
            held.append(abs(detector.residuals(middle)[0]) < detector.band(middle)[0][0])
        yield f"good points rejected, steps of 10 mm, noise of {1e3 * noise:.0f} mm", *share(lost)
        yield f"band holds, steps of 10 mm, noise of {1e3 * noise:.0f} mm", *share(held)


def zones(seed, repetitions, tolerance=0.02):
    """Forms whose least zone is so many times the tolerance."""
    cases = [(name, times) for name in FORMS for times in HEIGHTS[name]]
    for name, times in [*cases, ("ghost", 0.0)]:
        verdicts = []
        for i in range(repetitions):
            rng = np.random.default_rng([seed, i])
            xy = rng.uniform(0, 1, (8_000, 2)) * SIZE
            z = FORMS["flat" if name == "ghost" else name](rng, xy, times * tolerance)
            z = z + rng.normal(0, 0.002, 8_000)
            z[0] += 0.1 * (name == "ghost")
            X = np.column_stack([xy, z])
            verdicts.append(flatness(judged(X), X, tolerance).verdict)
        for verdict in ("kept", "exceeded"):
            is_so = [one == verdict for one in verdicts]
            yield f"{verdict}, {name}, {times:g} of the tolerance", *share(is_so)


def sides(seed, repetitions):
    """Batters point to their outer side, which is up."""
    for slope in (4, 10, 16):
        for facing in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            normal = np.array([*facing, 1 / slope]) / np.hypot(1, 1 / slope)
            axes, outside = np.linalg.svd(normal[None])[2][1:], []
            for i in range(repetitions):
                rng = np.random.default_rng([seed, i])
                X = rng.uniform(-2, 2, (300, 2)) @ axes + rng.normal(0, NOISE, (300, 3))
                outside.append(judged(X).normal_ @ normal > 0)
            yield f"batter of {slope} : 1 to {facing} has its outer side", *share(outside)


def rows(seed, repetitions):
    """Ground in rows so many usual spacings apart, with 50 neighbors: do errors cover?"""
    for steps in (4, 5, 6):
        covered, warned, n_rows, each = [], [], 50 // steps, 50 * steps
        for i in range(min(repetitions, 5)):
            rng = np.random.default_rng([seed, i])
            x = np.tile(np.arange(each) / steps, n_rows) + rng.uniform(-0.05, 0.05, n_rows * each)
            y = np.repeat(np.arange(n_rows) * float(steps), each)
            X = np.column_stack([x, y, rng.normal(0, 0.1, len(x))])
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                estimator = RobustNormalEstimator(random_state=0).fit(X)
            off = np.degrees(np.arccos(np.minimum(np.abs(estimator.normals_[:, 2]), 1)))
            covered.append(np.mean(off <= 1.73 * estimator.normal_error_))
            warned.append(any("row of the scan" in str(one.message) for one in caught))
        yield f"errors of normals cover, rows {steps} spacings apart", *share(covered)
        yield f"warned of, rows {steps} spacings apart", *share(warned)


def weights(seed, repetitions):
    """A clean wall seen from aside, whose noise grows with range and incidence."""
    flagged = []
    for i in range(repetitions):
        rng = np.random.default_rng([seed, i])
        X = rng.uniform((0, 0, 0), (4, 0, 2.5), (2_000, 3))
        instrument = {"range_error": 0.002, "range_ppm": 300, "angle_error": 0.03}
        told = scan_weights(X, STATION, normal=[0, 1, 0], **instrument)
        X[:, 1] += rng.normal(0, told.deviations)
        flagged.append([(judged(X, p).labels_ == -1).any() for p in (None, told.weights)])
    for name, values in zip(("no", "those of the scan"), np.transpose(flagged), strict=True):
        yield f"a clean wall seen from aside has a flag, weights: {name}", *share(values)


TABLES = (bands, floors, zones, sides, rows, weights)
