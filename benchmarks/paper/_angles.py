"""Table 1: bias angles of 50 points with clustered or uniform outliers."""

import numpy as np

from benchmarks.paper._clouds import contaminated_planes
from benchmarks.paper._methods import METHODS
from benchmarks.paper._printed import ANGLES, OUTLIERS, STATISTICS
from benchmarks.paper._report import Report, paired_rows
from benchmarks.paper._runs import Steps, affordable, bias_angles, bootstrap_error, stream

N_POINTS = 50


def describe(angles):
    """The six statistics of Table 1, and their Monte-Carlo errors (NaN for the extremes)."""
    functions = {"mean": np.mean, "median": np.median, "StD": _deviation, "QR": _quartile_range}
    extremes = {"min": np.min, "max": np.max}
    values = [(functions | extremes)[name](angles[None], axis=1)[0] for name in STATISTICS]
    errors = [
        bootstrap_error(angles, functions[name]) if name in functions else np.nan
        for name in STATISTICS
    ]
    return np.array(values), np.array(errors)


def table1(runs=1000, *, seed=0):
    """Table 1: bias angles of all methods, with 10 outliers among 50 points.

    `results` maps (law, method) to the angles in degrees, (runs,).
    """
    methods = list(METHODS.values())
    steps = Steps(len(OUTLIERS) * sum(affordable(m, runs) for m in methods))
    angles, tables = {}, []
    for law in OUTLIERS:
        clouds = contaminated_planes(runs, N_POINTS, 20, stream(seed, law), outliers=law)
        rows = []
        for method in methods:
            of_method = bias_angles(method, clouds, stream(seed, law, method.name), steps)
            angles[law, method.name] = of_method
            rows += _table_1_rows(method, law, of_method)
        header = ("method", "", "runs", *STATISTICS, "mean off by")
        tables.append((f"{law} outliers, bias angle in degrees", header, rows))
    notes = [
        "± is the Monte-Carlo error of our numbers, by the bootstrap; minimum and maximum have "
        "none. The paper's error is as large. 'Mean off by' is the difference of the means over "
        "its standard error.",
        *(f"{method.name}: {method.reading}" for method in methods),
    ]
    title = f"Table 1: bias angles (degrees) of 50 points, 10 of them outliers, {runs} runs"
    return Report("table1", title, tables, notes, angles)


def _table_1_rows(method, law, angles):
    values, errors = describe(angles)
    label, count = method.name, str(len(angles))
    ours = [f"{value:.3f}" for value in values]
    spread = [f"{error:.3f}" if np.isfinite(error) else "" for error in errors]
    paper, off_by = None, ""
    if method.in_paper:
        printed = ANGLES[label][law]
        paper = ("1000", *(f"{value:.3f}" for value in printed), "")
        # The mean of the paper's 1000 runs has an error as well.
        off = (values[0] - printed[0]) / np.hypot(errors[0], printed[4] / np.sqrt(1000))
        off_by = f"{off:+.1f} s.e."
    return [*paired_rows(label, (count, *ours, off_by), paper), ("", "±", "", *spread, "")]


def _deviation(values, axis):
    return np.std(values, axis=axis, ddof=1)


def _quartile_range(values, axis):
    low, high = np.percentile(values, [25, 75], axis=axis)
    return high - low
