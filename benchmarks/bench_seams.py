"""What differs where cells of a large cloud meet? Real clouds in small cells, beside one cell.

One cell has the results of memory, which a test holds. Flags, normals that turn by a degree, and
edge labels are counted. Regions have their adjusted Rand index (ARI) to those of one cell, and so
have those of another seed in one cell. Of the 20 largest regions, the least share that one region
of cells holds, and how many times their points it has at most.

    python benchmarks/bench_seams.py --data ../shared/data --output docs/benchmarks
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from _real_clouds import cloud_paths, read_cloud
from _tables import print_table, write_csv
from sklearn.metrics import adjusted_rand_score

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.io import PointCloud, read_points, write_points
from sklearn_mcmd.tiling import process_files

FEWEST = 45_000  # points of a cloud
AT_ONCE = 25_000  # points of a cell
LARGEST = 20  # regions that are looked at
VERBS = {
    "flags": (MCMDOutlierDetector, {"mode": "mark"}),
    "normals": (RobustNormalEstimator, {}),
    "edges": (SharpFeatureDetector, {"colors": False}),
    "regions": (RegionGrowing, {"colors": False}),
}
HEAD = (
    *("cloud", "points", "flags", "flags that differ", "normals turned", "edge labels that differ"),
    *("regions' ARI", "ARI of another seed", "20 largest: kept", "times their points", "proven %"),
)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default="../shared/data", help="folder of real clouds")
    parser.add_argument("--clouds", nargs="+", help="names of folders; all by default")
    parser.add_argument("--cell", type=int, default=AT_ONCE, help="points of a cell, at most")
    parser.add_argument("--output", help="folder of seams.csv")
    options = parser.parse_args(arguments)
    rows = []
    for name, path in cloud_paths(options.data).items():
        if name.split("/")[0] in (options.clouds or [name.split("/")[0]]):
            points = read_cloud(name, path).points
            points = points[points.any(axis=1)]  # without silent rays
            if len(points) >= FEWEST:
                rows.append((name, *seams_of(points, options.cell)))
                print(*rows[-1], flush=True)
    print_table("", HEAD, rows, digits=3)
    if options.output:
        cells = [[f"{cell:.5g}" if isinstance(cell, float) else cell for cell in r] for r in rows]
        write_csv(Path(options.output) / "seams.csv", [HEAD, *cells])


def seams_of(points, at_once):
    """A row of the table, without the name of the cloud."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "cloud.las"
        write_points(source, PointCloud(points, {}))
        results = {}
        for verb in VERBS:
            whole, _ = results_of(source, verb, len(points))
            results[verb] = whole, *results_of(source, verb, at_once)
        other, _ = results_of(source, "regions", len(points), seed=1)
    (flags, cells_flags, proven), (normals, cells_normals, _) = results["flags"], results["normals"]
    cosines = np.abs(np.einsum("nd,nd->n", normals, cells_normals))
    turned = points[cosines < np.cos(np.radians(1))]
    regions, cells_regions, _ = results["regions"]
    return (
        *(len(points), int(flags.sum()), int((flags != cells_flags).sum())),
        len(np.unique(turned, axis=0)),  # copies count once
        int((results["edges"][0] != results["edges"][1]).sum()),
        adjusted_rand_score(regions, cells_regions),
        adjusted_rand_score(regions, other),
        *largest_kept(regions, cells_regions),
        100 * proven,
    )


def results_of(source, verb, at_once, seed=0):
    """What a verb finds in cells of so many points, and the share of points that are proven."""
    kind, how = VERBS[verb]
    target = source.with_name("out.las")
    report = process_files(source, target, kind(random_state=seed), tile_size=at_once, **how)
    made = read_points(target).attributes
    if verb == "flags":
        values = np.isin(made["classification"], (7, 18))
    elif verb == "normals":
        values = np.stack([made[f"normal_{axis}"] for axis in "xyz"], axis=1).astype(float)
    else:
        values = made["edge" if verb == "edges" else "region"]
    return values, report.n_proven / report.n_points


def largest_kept(regions, others):
    """Of the largest regions, the least share that one of the others holds, and the most points of
    this as a multiple of theirs."""
    labels, sizes = np.unique(regions[regions > 0], return_counts=True)
    shares, times = [], []
    for label in labels[np.argsort(-sizes)[:LARGEST]]:
        there = others[regions == label]
        held, counts = np.unique(there, return_counts=True)
        shares.append(counts.max() / len(there))
        times.append(np.count_nonzero(others == held[counts.argmax()]) / len(there))
    return min(shares, default=1.0), max(times, default=1.0)


if __name__ == "__main__":
    main()
