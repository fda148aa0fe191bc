"""When much is wrong: what is found and lost where errors, or sparse things, are many. In percent.

    python benchmarks/bench_quantity.py --clouds snow street
    python benchmarks/bench_quantity.py --limit 60000 --table quantity.md

- snow: half a turn in real snowfall, whose flakes are labelled by hand; what lies on the ground is
  real. "F1, labelled" leaves out the points without a label.
- turns: two turns in simulated snow, 2.8 % of the points.
- street: a simulated street with 10 and 20 % of outliers, drawn evenly and in scan lines.
- flat: plane pieces of 25 to 70 points, as dense as the cloud there, 15 to 60 spacings off it.
- ball: 3,000 points in or on a ball, before a wall that is 2.5, 3.5 and 5 times denser.
- vegetation: a village whose plants are thinned.
- clump: a flat strip of 32 errors, or a ball of 120, 25 m under a town and under a village.
- luck: the flags that only one of two runs has, whose seeds differ, of all flags of both.

"position" knows where the sensor was, and "position, intensity" also has intensity. "told" knows
the share of outliers. The other methods are those of ``bench_real.py``. "right" is the share of
right labels, "lost" that of real points that are flagged, and so are columns named after a class of
them. Each group takes 3 minutes of one core at most. ``--page`` prints the tables of limits.rst.
"""

import argparse
from itertools import combinations

import _quantity_clouds as clouds
import _real_methods
import numpy as np
from _real_clouds import RealCloud
from bench_real import write

from sklearn_mcmd import MCMDOutlierDetector

PEERS = ("SOR 20", "radius", "isolated voxels", "CloudCompare")
OF_RANGE = ("DROR", "DSOR", "10 over range", "10 over range, told")
OF_RANGE += ("10 over range and intensity, told",)
N_SEEDS = 3


def flags(case, position=None, intensity=None, random_state=0):
    """Which points the detector takes."""
    known = {"sensor_origin": position, "intensity": intensity}
    known = {name: value for name, value in known.items() if value is not None}
    detector = MCMDOutlierDetector(random_state=random_state, n_jobs=_real_methods.N_JOBS)
    detector.fit(case.points, **known)
    return detector.scores_ < detector.offset_


def judgments(case):
    """Name of each method that can be used, and which points it takes."""
    yield "default", flags(case)
    if case.position is not None:
        yield "position", flags(case, case.position)
    if case.intensity is not None and "position, intensity" in _real_methods.METHODS:
        yield "position, intensity", flags(case, case.position, case.intensity)
    at_origin = case.position is not None and not case.position.any()
    cloud = RealCloud(case.name, case.points, None, None, at_origin, case.intensity)
    for name in (*PEERS, *OF_RANGE):
        result = _real_methods.judgment(name, cloud, case.outlier.mean() or None)
        if result is not None:
            yield name, result[0] == -1


def f1(flagged, outlier):
    return 2 * (flagged & outlier).sum() / max(flagged.sum() + outlier.sum(), 1)


def row_of(case, method, flagged):
    """A line of the table: numbers in percent by their columns."""
    row, real = {}, ~case.outlier
    if case.outlier.any():
        row = {"F1": f1(flagged, case.outlier), "found": flagged[case.outlier].mean()}
        row["right"] = (flagged == case.outlier).mean()
    row["lost"] = flagged[real].mean()
    row |= {name: flagged[part].mean() for name, part in case.parts.items()}
    if case.known is not None:
        row["F1, labelled"] = f1(flagged[case.known], case.outlier[case.known])
    return {"cloud": case.name, "method": method} | {k: 100 * float(v) for k, v in row.items()}


def changed(one, other):
    """Flags that only one of two runs has, over the flags of both."""
    return (one != other).sum() / max(one.sum() + other.sum(), 1)


def row_of_luck(case):
    runs = [flags(case, random_state=seed) for seed in range(N_SEEDS)]
    shares = [100 * float(changed(*pair)) for pair in combinations(runs, 2)]
    counts = {"flags": f"{np.mean([run.sum() for run in runs]):.0f}"}
    return {"cloud": case.name} | counts | {"changed": np.mean(shares), "worst": max(shares)}


# And what the page tells of each.
GROUPS = {
    "snow": ("F1", "F1, labelled", "found", "lost", "lying snow"),
    "turns": ("F1", "lost"),
    "street": ("right", "gaussian", "uniform", "mixed_pixel", "ghost"),
    "flat": ("found",),
    "ball": ("ball",),
    "vegetation": ("plants",),
    "clump": ("found",),
    "luck": ("flags", "changed", "worst"),
}


def rows_of(group, options):
    """Lines of a group's table: texts and numbers by their columns."""
    if group == "luck":
        yield from map(row_of_luck, clouds.clean(options))
        return
    for case in getattr(clouds, group)(options):
        for method, flagged in judgments(case):
            yield row_of(case, method, flagged)


def table(title, rows):
    """Markdown."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    cells = [[row.get(name, "") for name in columns] for row in rows]
    lines = [[c if isinstance(c, str) else f"{c:.1f}" for c in line] for line in cells]
    lines = [columns, ["---"] * len(columns), *lines]
    return "\n".join([f"## {title}", "", *(f"| {' | '.join(line)} |" for line in lines), ""])


def page(rows, measures):
    """A table in reStructuredText, with a line for each number that is told of a cloud."""
    rows = [{"method": "default", **row} for row in rows]
    order = ("default", "position", "position, intensity", *PEERS, *OF_RANGE)
    methods = [method for method in order if any(row["method"] == method for row in rows)]
    told = {(r["cloud"], m, r["method"]): r[m] for r in rows for m in measures if m in r}
    lines = [["cloud", *methods]]
    for cloud, measure in dict.fromkeys(key[:2] for key in told):
        cells = [told.get((cloud, measure, method), "") for method in methods]
        lines.append([f"{cloud}: {measure.replace('_', ' ')}", *cells])
    texts = [[c if isinstance(c, str) else f"{c:.1f}" for c in line] for line in lines]
    texts = [", ".join(f'"{c}"' if "," in c or not c else c for c in line) for line in texts]
    return "\n".join([".. csv-table::", "   :header-rows: 1", "", *(f"   {t}" for t in texts), ""])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--clouds", nargs="+", choices=GROUPS, default=list(GROUPS))
    parser.add_argument("--limit", type=int, help="crop clouds to so many points")
    parser.add_argument("--seed", type=int, default=0, help="of crops and of what is put in")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--page", action="store_true", help="tables for the page of limits")
    parser.add_argument("--table", help="file, which is written anew after each group")
    options = parser.parse_args()
    _real_methods.N_JOBS = options.jobs
    done = []
    for name in options.clouds:
        rows = list(rows_of(name, options))
        done.append(page(rows, GROUPS[name]) if options.page else table(name, rows))
        print(done[-1], flush=True)
        if options.table:
            write(options.table, "\n".join(done))


if __name__ == "__main__":
    main()
