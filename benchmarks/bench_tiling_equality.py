"""Are outputs by tiles those of memory? Tile sizes, places of cuts, engines, for three clouds.

A street, a village from the air, and a sparse cloud: a street of which a tenth of the points are
spread over a volume far larger. All in millimeters, far from the origin. What is written by tiles
must have the points and attributes of what is written in memory.

    python benchmarks/bench_tiling_equality.py
    python benchmarks/bench_tiling_equality.py --points 100_000 --verbs normals --clouds street
"""

import argparse
import tempfile
import time
import warnings
from contextlib import contextmanager, nullcontext
from itertools import product
from pathlib import Path
from unittest.mock import patch

import joblib
import numpy as np
from bench_tiling import ORIGIN, equal, timed
from simulators import make_airborne_scan

from sklearn_mcmd import (
    MCMDOutlierDetector,
    RegionGrowing,
    RobustNormalEstimator,
    SharpFeatureDetector,
)
from sklearn_mcmd.datasets import make_street
from sklearn_mcmd.io import PointCloud, write_points
from sklearn_mcmd.tiling import _run, process_files

VERBS = {
    "normals": (RobustNormalEstimator(random_state=0), {}),
    "denoise": (MCMDOutlierDetector(random_state=0), {"mode": "mark"}),
    "segment": (RegionGrowing(random_state=0), {}),
    "edges": (SharpFeatureDetector(random_state=0), {}),
}
IN_MEMORY = {
    "normals": ["normals"],
    "denoise": ["denoise", "--mode", "mark"],
    "segment": ["segment"],
    "edges": ["edges"],
}
# Tiles of at most these shares of the points, and where cells are divided: the origins of tiles.
SHARES, CUTS = (0.05, 0.1, 0.2, 0.4, 0.8), (0.5, 0.35, 0.6)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--verbs", nargs="+", choices=list(VERBS), default=list(VERBS))
    parser.add_argument("--clouds", nargs="+", choices=list(CLOUDS), default=list(CLOUDS))
    parser.add_argument("--engines", nargs="+", choices=list(ENGINES), default=list(ENGINES))
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    print("cloud     verb     engine  tile size    cut   tiles  seconds  output")
    n_different = 0
    with tempfile.TemporaryDirectory() as folder:
        for name in options.clouds:
            source = Path(folder) / f"{name}.laz"
            xyz = CLOUDS[name](options.points)
            write_points(source, PointCloud(np.round(xyz + ORIGIN, 3)))
            for verb in options.verbs:
                command = [*IN_MEMORY[verb], source, source.with_name(f"{name}-{verb}.laz")]
                timed([*command, "--memory", "1TB", "--n-jobs", options.processes])
        for engine in options.engines:
            with ENGINES[engine](options.processes):
                for name, verb, share, cut in product(options.clouds, options.verbs, SHARES, CUTS):
                    source = Path(folder) / f"{name}.laz"
                    n_different += compare(source, verb, engine, share, cut, options)
    print("all outputs are equal" if not n_different else f"{n_different} outputs DIFFER")
    return int(n_different > 0)


def compare(source, verb, engine, share, cut, options):
    """One line of the table; returns whether the output differs."""
    target, tile_size = source.with_name("tiles.laz"), int(share * options.points)
    begin = time.perf_counter()
    estimator, how = VERBS[verb]
    with patch.object(_run, "CUT", cut):
        report = process_files(
            source, target, estimator, tile_size=tile_size, n_jobs=options.processes, restart=True,
            **how,
        )  # fmt: skip
    seconds = time.perf_counter() - begin
    same = equal(source.with_name(f"{source.stem}-{verb}.laz"), target)
    print(
        f"{source.stem:9} {verb:8} {engine:6} {tile_size:10,} {cut:6} {report.n_tiles:7} "
        f"{seconds:8.1f}  {'equal' if same else 'DIFFERENT'}",
        flush=True,
    )
    return not same


def sparse(n):
    """A street of 9 of 10 points; the others in a volume around it, 30 times as wide."""
    street = make_street(n - n // 10, outlier_share=0.01, random_state=0).data
    low, high = street.min(axis=0), street.max(axis=0)
    middle, size = (low + high) / 2, (high - low).max()
    around = np.random.default_rng(0).uniform(-15, 15, (n // 10, 3)) * [1, 1, 0.1] * size + middle
    return np.vstack([street, around])


CLOUDS = {
    "street": lambda n: make_street(n, outlier_share=0.01, tree=True, random_state=0).data,
    "airborne": lambda n: make_airborne_scan(n, random_state=0).data,
    "sparse": sparse,
}


@contextmanager
def dask(n_processes):
    from dask import distributed

    with (
        distributed.LocalCluster(
            n_workers=n_processes, threads_per_worker=1, protocol="tcp", dashboard_address=None
        ) as cluster,
        distributed.Client(cluster),
        joblib.parallel_config(backend="dask"),
    ):
        yield


ENGINES = {"joblib": lambda n_processes: nullcontext(), "dask": dask}


if __name__ == "__main__":
    raise SystemExit(main())
