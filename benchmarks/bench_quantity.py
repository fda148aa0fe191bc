"""When much is wrong: what is found and lost where errors, or sparse things, are many. In percent.

    python benchmarks/bench_quantity.py --clouds snow street
    python benchmarks/bench_quantity.py --output docs/benchmarks

- snow: half a turn in real snowfall, whose flakes are labelled by hand; what lies on the ground is
  real. "F1, labelled" leaves out the points without a label.
- turns: two turns in simulated snow, 2.8 % of the points.
- street: a simulated street with 10 and 20 % of outliers, drawn evenly and in scan lines.
- flat: plane pieces of 25 to 70 points, as dense as the cloud there, 15 to 60 spacings off it.
- ball: 3,000 points in or on a ball, before a wall that is 2.5, 3.5 and 5 times denser.
- vegetation: a village whose plants are thinned.
- clump: a flat strip of 32 errors, or a ball of 120, 25 m under a town and under a village.

"position" knows where the sensor was, and "position, intensity" also has intensity. "told" knows
the share of outliers. The other methods are those of ``bench_real.py``. "right" is the share of
right labels, "lost" that of real points that are flagged, and so are rows named after a class of
them. Each group takes 3 minutes of one core at most.
"""

import argparse
from pathlib import Path

import _quantity_clouds as clouds
from _real_clouds import RealCloud
from _real_methods import judgment
from _tables import print_table, write_csv

from sklearn_mcmd import MCMDOutlierDetector

PEERS = ("SOR 20", "radius", "isolated voxels", "CloudCompare")
OF_RANGE = ("DROR", "DSOR", "10 over range", "10 over range, told")
OF_RANGE += ("10 over range and intensity, told",)
METHODS = ("default", "position", "position, intensity", *PEERS, *OF_RANGE)
# And what the page tells of each.
GROUPS = {
    "snow": ("F1", "F1, labelled", "found", "lost", "lying snow"),
    "turns": ("F1", "lost"),
    "street": ("right", "gaussian", "uniform", "mixed_pixel", "ghost"),
    "flat": ("found",),
    "ball": ("ball",),
    "vegetation": ("plants",),
    "clump": ("found",),
}
OF_SNOW = ("snow", "turns")


def judgments(case):
    """Name of each method that can be used, and which points it takes."""
    known = {"default": {}}
    if case.position is not None:
        known["position"] = {"sensor_origin": case.position}
    if case.intensity is not None:
        known["position, intensity"] = {**known["position"], "intensity": case.intensity}
    for name, told in known.items():
        detector = MCMDOutlierDetector(random_state=0, n_jobs=-1).fit(case.points, **told)
        yield name, detector.scores_ < detector.offset_
    at_origin = case.position is not None and not case.position.any()
    cloud = RealCloud(case.name, case.points, None, None, at_origin, case.intensity)
    for name in (*PEERS, *OF_RANGE):
        result = judgment(name, cloud, case.outlier.mean() or None)
        if result is not None:
            yield name, result[0] == -1


def f1(flagged, outlier):
    return 2 * (flagged & outlier).sum() / max(flagged.sum() + outlier.sum(), 1)


def measures(case, flagged):
    """Numbers in percent by their names."""
    found = {"lost": flagged[~case.outlier].mean()}
    if case.outlier.any():
        found["F1"], found["found"] = f1(flagged, case.outlier), flagged[case.outlier].mean()
        found["right"] = (flagged == case.outlier).mean()
    found |= {name: flagged[part].mean() for name, part in case.parts.items()}
    if case.known is not None:
        found["F1, labelled"] = f1(flagged[case.known], case.outlier[case.known])
    return {name: 100 * float(value) for name, value in found.items()}


def rows_of(group, options):
    """A line for each number that is told of a cloud, by the method."""
    for case in getattr(clouds, group)(options):
        found = {name: measures(case, flagged) for name, flagged in judgments(case)}
        for measure in GROUPS[group]:
            cells = (found.get(method, {}).get(measure) for method in METHODS)
            numbers = ["" if cell is None else f"{cell:.1f}" for cell in cells]
            if any(numbers):
                yield [f"{case.name}: {measure.replace('_', ' ')}", *numbers]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--clouds", nargs="+", choices=GROUPS, default=list(GROUPS))
    parser.add_argument("--limit", type=int, help="crop clouds to so many points")
    parser.add_argument("--seed", type=int, default=0, help="of crops and of what is put in")
    parser.add_argument("--output", type=Path, help="folder for the tables as CSV")
    options = parser.parse_args(arguments)
    for title in ("quantity_snow", "quantity"):
        groups = [g for g in options.clouds if (g in OF_SNOW) == (title == "quantity_snow")]
        rows = [row for group in groups for row in rows_of(group, options)]
        filled = [i for i in range(1 + len(METHODS)) if not i or any(row[i] for row in rows)]
        table = [[row[i] for i in filled] for row in (["", *METHODS], *rows)]
        if rows:
            print_table(title, table[0], table[1:])
        if rows and options.output:
            write_csv(options.output / f"{title}.csv", table)


if __name__ == "__main__":
    main()
