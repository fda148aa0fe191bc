"""A public benchmark as its authors define it: their table, with ours and our peers in it.

    python benchmarks/bench_public.py roofs_ntnu ../shared/data/roofs_ntnu --output docs/benchmarks
    python benchmarks/bench_public.py pcpnet FOLDER
    python benchmarks/bench_public.py wads FOLDER
    python benchmarks/bench_public.py evops ../shared/data

These data judge, and never choose: no rule and no constant is changed for them. Ours are told what
the table says and nothing else; peers have their best published settings, and those that are not
installed are named. "Printed" rows are others' own figures. `_public_data.py` says what a folder
holds, the page of benchmarks where to get it. "evops" is `bench_segmentation.py peers`.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import _public_data
import _public_measures
import bench_segmentation
import numpy as np
from _public_methods import NORMALS, ROOFS, SNOW
from _tables import print_table, write_csv


class Benchmark(NamedTuple):
    """Reader, measure, methods, decimals of its numbers, and printed rows: setting and cells."""

    read: Callable
    measure: Callable
    methods: dict
    digits: int
    printed: dict


# Figures of its file evaluation_results/ablation_matrix.csv at 5623f5f, of the same 99 roofs.
ROOF_ROWS = {
    "printed: network, tuned": ("DGCNN", 0.884, 0.923, 0.918, 0.967, 0.313, 0.019, 0.039),
    "printed: network, trees": ("DGCNN", 0.875, 0.925, 0.941, 0.962, 0.212, 0.019, 0.045),
    "printed: classifier": ("softmax", 0.881, 0.913, 0.933, 0.945, 0.313, 0.040, 0.081),
    "printed: growing": ("region growing", 0.388, 0.611, 0.498, 0.568, 1.152, 0.016, 0.489),
}
# Per-shape figures of boxunion2100k by akapet00/point-cloud-central, 2026; RMSE alone.
NORMAL_ROWS = {
    "printed: PCA": ("not told here", "15.1"),
    "printed: IRLS 224": ("best of those without training", "9.3"),
}
# The abstract of arXiv:2602.05876, on frames of the whole set.
SNOW_ROWS = {"printed: IDSOR": ("intensity and distance", "above 90", "above 90")}

BENCHMARKS = {
    "roofs_ntnu": Benchmark(_public_data.roofs, _public_measures.roof_scores, ROOFS, 3, ROOF_ROWS),
    "pcpnet": Benchmark(
        _public_data.shapes, _public_measures.normal_scores, NORMALS, 1, NORMAL_ROWS
    ),
    "wads": Benchmark(_public_data.frames, _public_measures.snow_scores, SNOW, 1, SNOW_ROWS),
}


def measured(benchmark, folder):
    """Scores of each method, by kind and measure a list over the parts; and its seconds."""
    scores, seconds = defaultdict(lambda: defaultdict(list)), defaultdict(float)
    methods = {name: m for name, m in benchmark.methods.items() if find_spec(m.package)}
    for i, part in enumerate(benchmark.read(folder)):
        for name, method in methods.items():
            for _ in range(1 + (i == 0)):  # the first compiles and loads
                start = time.process_time()
                answer = method.run(part)
                spent = time.process_time() - start
            seconds[name] += spent
            for measure, value in benchmark.measure(part, answer).items():
                scores[name][part.kind, measure].append(value)
        print(f"{part.kind}, {len(part.X):,} points", flush=True)
    if not scores:
        raise FileNotFoundError(f"{folder} holds none of the files that _public_data.py names")
    return scores, seconds


def table(benchmark, scores, seconds):
    """A row for each method, means over the parts: a cell for each kind, or for each measure."""
    columns = [key for by_key in scores.values() for key in by_key]
    kinds, measures = (list(dict.fromkeys(names)) for names in zip(*columns, strict=True))
    single = len(kinds) == 1
    head = measures if single else [*kinds, "mean"]
    rows = [["method", "told", *head, "s"]]
    for name, method in benchmark.methods.items():
        if name not in scores:
            print(f"{name}: {method.package} is not installed")
            rows.append([name, method.setting, *["not installed"] * (len(head) + 1)])
            continue
        means = np.array([[np.nanmean(scores[name][k, m]) for m in measures] for k in kinds])
        means = means.T if single else np.vstack([means, means.mean(axis=0)])
        cells = ["/".join(f"{x:.{benchmark.digits}f}" for x in cell) for cell in means]
        spent = f"{seconds[name]:.{int(seconds[name] < 10)}f}"
        rows.append([name, method.setting, *cells, spent])
    for name, cells in benchmark.printed.items():
        texts = [cell if isinstance(cell, str) else f"{cell:.3f}" for cell in cells]
        rows.append([name, *texts, *[""] * (len(rows[0]) - 1 - len(texts))])
    return rows


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", choices=[*BENCHMARKS, "evops"])
    parser.add_argument("folder", type=Path, help="of the benchmark's files")
    parser.add_argument("--output", type=Path, help="folder for the table as CSV")
    options = parser.parse_args(arguments)
    if options.name == "evops":
        return bench_segmentation.main(["peers", "--data", str(options.folder)])
    benchmark = BENCHMARKS[options.name]
    head, *rows = table(benchmark, *measured(benchmark, options.folder))
    print_table(options.name, head, rows)
    if options.output:
        write_csv(options.output / f"public_{options.name}.csv", [head, *rows])


if __name__ == "__main__":
    main()
