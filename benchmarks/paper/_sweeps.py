"""Figures 5 to 7: mean bias angles against outliers, sizes and variances."""

from dataclasses import replace

import numpy as np

from benchmarks.paper import _draw
from benchmarks.paper._clouds import contaminated_planes
from benchmarks.paper._methods import METHODS, PEERS
from benchmarks.paper._printed import BREAKDOWN, VARIANCES, Z_VARIANCES
from benchmarks.paper._report import Report, Table
from benchmarks.paper._runs import Steps, affordable, bias_angles, stream

# A run has failed if its plane is off by more than FAILURE degrees. A method has broken down if
# BREAKDOWN_SHARE of its runs have failed.
FAILURE, BREAKDOWN_SHARE = 5.0, 0.05
NOT_ROBUST = ("PCA", "qSp")
# Sweeps leave out MSAC, as in the paper, and scikit-learn's detectors, which would take hours. Slow
# methods get the shares EFFORT of the runs.
LEFT_OUT = ("MSAC", "RPCA rrcov", *PEERS)
EFFORT = {"RPCA": 0.2, "uLSIF": 0.05}
SHOWN = (1, 5, 10, 20, 30, 40, 45, 48, 49, 50, 55, 60, 64, 70, 74, 75, 76, 78, 80)


def swept(*left_out):
    return [
        replace(method, effort=EFFORT.get(name, method.effort))
        for name, method in METHODS.items()
        if name not in (*LEFT_OUT, *left_out)
    ]


def figure5(runs=1000, *, seed=0, percentages=range(1, 81)):
    """Figure 5: breakdown points, by clustered outliers among 100 points.

    `results` has "percentages", ("mean", method), ("error", method) and ("failed", method),
    arrays over the percentages, and ("breakdown", method): the first percentage with at least 5
    % of the runs off by more than 5 degrees, None if there is none.
    """
    methods = swept()
    percentages = np.array(sorted(percentages))
    steps = Steps(len(percentages) * sum(affordable(m, runs) for m in methods))
    results = {"percentages": percentages}
    sweep = _sweep(methods, runs, 100, percentages, (seed, "figure5"), steps)
    for name, (mean, error, failed) in sweep.items():
        results |= {("mean", name): mean, ("error", name): error, ("failed", name): failed}
        broken = percentages[failed >= BREAKDOWN_SHARE]
        results["breakdown", name] = int(broken[0]) if len(broken) else None

    rows = []
    for method in methods:
        found = results["breakdown", method.name]
        printed = BREAKDOWN.get(method.name)
        rows.append(
            (
                method.name,
                "" if printed is None else str(printed),
                f"none up to {percentages[-1]}" if found is None else str(found),
            )
        )
    tables = [Table("breakdown, percentage of outliers", ("method", "paper", "ours"), rows)]
    shown = [i for i, p in enumerate(percentages) if p in SHOWN] or range(len(percentages))
    tables.append(
        _mean_table("mean bias angle, degrees", methods, results, percentages, shown, "%")
    )
    notes = [
        "Ours is the first percentage at which 5 % of the runs are off by more than 5 degrees. "
        "The paper reads its own numbers off the figure.",
        "The paper's abstract says that RANSAC and RPCA break down at 47 and 64 % (swapped) and "
        "that MCMD_MD tolerates 75 %. Its text says 64, 47 and 74.",
        "MCMD_MD needs h = (1 - e) n for the true share e. With the text's h = .5 n it breaks "
        "down at 51 %.",
        "MCMD_Z breaks down at 50 % for any h, because the median and the MAD do.",
        "The text gives uLSIF 3.626 degrees at 1 % of outliers. It does not say on which points "
        "uLSIF was trained, and none of the readings tried gives its curve.",
    ]

    def draw(figure):
        robust = [m.name for m in methods if m.name not in NOT_ROBUST]
        panels = {
            "(a) all methods": [m.name for m in methods],
            "(b) without PCA and qSp": robust,
            "(c) without PCA, qSp and uLSIF": [name for name in robust if name != "uLSIF"],
        }
        axes = figure.subplots(1, 3)
        for ax, (title, names) in zip(axes, panels.items(), strict=True):
            _line_panel(ax, percentages, results, names, title, "outliers, %")
        for name, value in BREAKDOWN.items():
            if name in robust:
                ax.axvline(value, color=_draw.color(name), linestyle="-.", linewidth=0.8)
        figure.legend(
            *axes[0].get_legend_handles_labels(),
            loc="outside right center",
            title="dash-dotted:\nthe paper's\nbreakdown",
        )

    title = f"Figure 5: clustered outliers among 100 points, {runs} runs for each percentage"
    return Report("figure5", title, tables, notes, results, draw, (16.0, 5.0))


def figure6(runs=1000, *, seed=0, percentages=range(1, 46)):
    """Figure 6: bias angles by sample size and percentage of clustered outliers.

    `results` has "percentages", ("mean", n, method) and ("error", n, method).
    """
    methods = swept(*NOT_ROBUST)
    names = [m.name for m in methods]
    percentages = np.array(sorted(percentages))
    sizes = (20, 50, 200)
    steps = Steps(len(sizes) * len(percentages) * sum(affordable(m, runs) for m in methods))
    results, tables = {"percentages": percentages}, []
    for n in sizes:
        sweep = _sweep(methods, runs, n, percentages, (seed, "figure6", n), steps)
        for name, (mean, error, _) in sweep.items():
            results |= {("mean", n, name): mean, ("error", n, name): error}
        shown = [i for i, p in enumerate(percentages) if p % 5 == 0] or range(len(percentages))
        caption = f"n = {n}: mean bias angle, degrees"
        own = _of_sweep(results, n, names)
        tables.append(_mean_table(caption, methods, own, percentages, shown, "%"))
    notes = [
        "The paper prints no numbers. It says that MCMD_Z and MCMD_MD are always better than RPCA, "
        "RANSAC and uLSIF, that MCMD_Z is the best, and that for n = 20 RPCA breaks down at 40 % "
        "and RANSAC is erratic from 30 % on.",
        "This is confirmed for MCMD_Z against RPCA and RANSAC. MCMD_MD is not better than RPCA "
        "from 15 % of outliers on for n = 200, and from 40 % on for n = 50.",
        "With the text's h = .5 n MCMD_MD is worse than RPCA for n = 50 and 200.",
    ]

    def draw(figure):
        for ax, n in zip(figure.subplots(1, 3), sizes, strict=True):
            own = _of_sweep(results, n, names)
            _line_panel(ax, percentages, own, names, f"n = {n}", "outliers, %")
        ax.legend(fontsize=8)

    title = f"Figure 6: clustered outliers among 20, 50 and 200 points, {runs} runs each"
    return Report("figure6", title, tables, notes, results, draw, (16.0, 5.0))


def figure7(runs=1000, *, seed=0):
    """Figure 7: bias angles by point density (Table 2) and by roughness.

    `results` has ("mean", sweep, method) and ("error", sweep, method), where sweep is "density"
    or "roughness".
    """
    methods = swept()
    names = [m.name for m in methods]
    steps = Steps((len(VARIANCES) + len(Z_VARIANCES)) * sum(affordable(m, runs) for m in methods))
    sweeps = {
        "density": {name: _densities(runs, name, seed) for name in VARIANCES},
        "roughness": {
            f"{variance:g}": contaminated_planes(
                runs,
                50,
                20,
                stream(seed, "roughness", variance),
                regular_variances=(6.0, 6.0, variance),
            )
            for variance in Z_VARIANCES
        },
    }
    results, tables = {}, []
    for sweep, settings in sweeps.items():
        for method in methods:
            summaries = [
                _summary(bias_angles(method, clouds, stream(seed, sweep, key, method.name), steps))
                for key, clouds in settings.items()
            ]
            mean, error, _ = np.array(summaries).T
            results |= {("mean", sweep, method.name): mean, ("error", sweep, method.name): error}
        caption = {
            "density": "by data set of Table 2: mean bias angle, degrees",
            "roughness": "by the variance along z: mean bias angle, degrees",
        }[sweep]
        own, shown = _of_sweep(results, sweep, names), range(len(settings))
        tables.append(_mean_table(caption, methods, own, list(settings), shown, ""))
    notes = [
        "The paper prints no numbers. Its order, MCMD_Z < MCMD_MD < RPCA < RANSAC, holds if "
        "MCMD_MD has h = (1 - e) n. With h = .5 n MCMD_MD comes after RPCA.",
    ]

    def draw(figure):
        robust = [name for name in names if name not in (*NOT_ROBUST, "uLSIF")]
        panels = [
            ("density", "(a) all methods", names),
            ("density", "(b) robust methods", robust),
            ("roughness", "(c) all methods", names),
            ("roughness", "(d) robust methods", robust),
        ]
        for ax, (sweep, title, chosen) in zip(figure.subplots(2, 2).flat, panels, strict=True):
            own = _of_sweep(results, sweep, chosen)
            if sweep == "density":
                _line_panel(ax, range(len(VARIANCES)), own, chosen, title, "variances of Table 2")
                ax.set_xticks(range(len(VARIANCES)), list(VARIANCES))
            else:
                _line_panel(ax, Z_VARIANCES, own, chosen, title, "variance along z")
            ax.legend(fontsize=8)

    title = f"Figure 7: 50 points, 10 of them clustered outliers, {runs} runs each"
    return Report("figure7", title, tables, notes, results, draw, (13.0, 9.0))


def _densities(runs, name, seed):
    regular, outlying = VARIANCES[name]
    return contaminated_planes(
        runs,
        50,
        20,
        stream(seed, "density", name),
        regular_variances=(regular, regular, 0.01),
        outlier_variances=(outlying, outlying, 1.5),
    )


def _sweep(methods, runs, n, percentages, labels, steps):
    """`_summary` of each method at each percentage of outliers: name -> (3, percentages)."""
    summaries = {method.name: [] for method in methods}
    for percentage in percentages:
        clouds = contaminated_planes(runs, n, percentage, stream(*labels, percentage))
        for method in methods:
            state = stream(*labels, percentage, method.name)
            summaries[method.name].append(_summary(bias_angles(method, clouds, state, steps)))
    return {name: np.array(found).T for name, found in summaries.items()}


def _of_sweep(results, sweep, names):
    """The curves (kind, method) of one sweep, from (kind, sweep, method)."""
    return {
        (kind, name): results[kind, sweep, name] for kind in ("mean", "error") for name in names
    }


def _summary(angles):
    """Mean, its standard error, and the share of runs that failed."""
    error = angles.std(ddof=1) / np.sqrt(len(angles)) if len(angles) > 1 else np.nan
    return angles.mean(), error, np.mean(angles > FAILURE)


def _mean_table(caption, methods, results, labels, shown, unit):
    rows = [
        (
            method.name,
            *(
                f"{results['mean', method.name][i]:.2f} ± {results['error', method.name][i]:.2f}"
                for i in shown
            ),
        )
        for method in methods
    ]
    return Table(caption, ("method", *(f"{labels[i]}{unit}" for i in shown)), rows)


def _line_panel(ax, x, results, names, title, xlabel):
    curves = {name: results["mean", name] for name in names}
    errors = {name: results["error", name] for name in names}
    _draw.lines(ax, x, curves, title, xlabel, errors=errors)
