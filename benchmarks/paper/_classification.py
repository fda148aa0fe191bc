"""Table 4: the methods as classifiers of 100 points."""

import numpy as np

from benchmarks.paper._clouds import contaminated_planes
from benchmarks.paper._methods import METHODS
from benchmarks.paper._printed import CLASSIFICATION, RATES, SHARES
from benchmarks.paper._report import Report, paired_rows
from benchmarks.paper._runs import Steps, affordable, flag_counts, stream

N_POINTS = 100


def rates(counts, n_outliers):
    """The five rates of Eqs. 20-24 in percent, of each run: (runs, 5).

    `counts` are outliers found and regular points kept, as from `flag_counts`.
    """
    n_regular = N_POINTS - n_outliers
    found, kept = 100.0 * counts[:, 0] / n_outliers, 100.0 * counts[:, 1] / n_regular
    accuracy = 100.0 * counts.sum(axis=1) / N_POINTS
    return np.column_stack([found, kept, 100.0 - kept, 100.0 - found, accuracy])


def flagged_in_paper(name, percentage):
    """The average number of points, of 100, that a method flagged by its printed rates.

    It is a whole number only for uLSIF and qSp, which flag a given number.
    """
    found, kept = _printed(name, percentage)[:2]
    if np.isnan(found):
        return None
    n_outliers = N_POINTS * percentage // 100
    return round((found * n_outliers + (100.0 - kept) * (N_POINTS - n_outliers)) / 100.0)


def labeling_methods():
    """All methods but PCA, which labels no points, as in the paper."""
    return [method for method in METHODS.values() if method.name != "PCA"]


def counts_of(method, clouds, random_state, steps):
    """Outliers found and regular points kept in each cloud, with the paper's number of flags."""
    n_flagged = flagged_in_paper(method.name, clouds.n_outliers * 100 // N_POINTS)
    return flag_counts(method, clouds, random_state, steps, n_flagged)


def table4(runs=1000, *, seed=0):
    """Table 4: outliers found and inliers kept among 100 points.

    `results` maps (percentage, method) to the rates TPR, TNR, FPR, FNR and accuracy of each run
    in percent, (runs, 5).
    """
    methods = labeling_methods()
    steps = Steps(len(SHARES) * sum(affordable(m, runs) for m in methods))
    results, tables = {}, []
    for percentage in SHARES:
        clouds = contaminated_planes(runs, N_POINTS, percentage, stream(seed, "table4", percentage))
        rows = []
        for method in methods:
            state = stream(seed, "table4", percentage, method.name)
            shares = rates(counts_of(method, clouds, state, steps), clouds.n_outliers)
            results[percentage, method.name] = shares
            rows += _table_4_rows(method, percentage, shares)
        header = ("method", "", "runs", *RATES)
        tables.append((f"{percentage} % of outliers, rates in %", header, rows))
    notes = [
        "± is the Monte-Carlo error of our numbers. The paper's error is as large, and it prints "
        "TPR to FNR to a tenth.",
        "uLSIF and qSp flag fixed numbers of points, which follow from the printed rates: 7, 23, "
        "46 and 8, 30, 40 of 100.",
        *(f"{method.name}: {method.reading}" for method in methods),
    ]
    title = f"Table 4: classification of 100 points, {runs} runs for each percentage"
    return Report("table4", title, tables, notes, results)


def _table_4_rows(method, percentage, shares):
    count = len(shares)
    mean = shares.mean(axis=0)
    error = shares.std(axis=0, ddof=1) / np.sqrt(count) if count > 1 else np.full(5, np.nan)
    ours = (str(count), *map("{:.2f}".format, mean))
    printed, paper = _printed(method.name, percentage), None
    if not np.isnan(printed[0]):
        paper = ("1000", *map("{:.1f}".format, printed[:4]), f"{printed[4]:.2f}")
    spread = ("", "±", "", *map("{:.2f}".format, error))
    return [*paired_rows(method.name, ours, paper), spread]


def _printed(name, percentage):
    """The paper's five rates, NaN if it has no such row."""
    return CLASSIFICATION.get(name, {}).get(percentage, (np.nan,) * len(RATES))
